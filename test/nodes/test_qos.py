# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Quality of service of publishers and subscriptions, as listed in docs/topics.md."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from rclpy.qos import (
    DurabilityPolicy, HistoryPolicy, qos_check_compatible, QoSCompatibility, QoSProfile,
    ReliabilityPolicy)
from rosbag2_qos import rosbag2_overrides
from smart_tire.messages import ALL_TOPICS
from smart_tire.nodes.qos import (
    LATCHED, publisher_qos, replayer_qos, subscriber_qos, volatile_qos)
import yaml

pytestmark = pytest.mark.processes

OVERRIDES = Path(__file__).resolve().parents[2] / 'config' / 'rosbag2_qos.yaml'


VOLATILE = [*(name for name in ALL_TOPICS if name not in LATCHED), 'tf', 'diagnostics']


@pytest.mark.parametrize('name', VOLATILE)
def test_every_publisher_is_reliable_and_volatile_so_any_subscription_matches(name):
    profile = publisher_qos(name)
    assert profile.reliability == ReliabilityPolicy.RELIABLE
    assert profile.durability == DurabilityPolicy.VOLATILE
    assert profile.history == HistoryPolicy.KEEP_LAST


@pytest.mark.parametrize(('name', 'depth'), [
    ('imu/data', 200), ('wheel_states', 32), ('tire_samples', 800), ('odom', 250), ('icr', 250),
    ('tire_friction', 250), ('ground_state', 250), ('motor_commands', 1), ('cmd_vel', 1),
    ('ground_truth/odom', 100), ('/diagnostics', 100)])
def test_publisher_depths_follow_the_kind_of_topic(name, depth):
    assert publisher_qos(name).depth == depth


def test_publisher_depths_grow_with_sources_and_rate():
    assert publisher_qos('tire_samples', wheels=4).depth == 3200
    assert publisher_qos('wheel_states', rate=100.0).depth == 200
    assert publisher_qos('wheel_states', rate=4.0).depth == 32


@pytest.mark.parametrize(('name', 'depth'), [
    ('imu/data', 1000), ('wheel_states', 160), ('tire_samples', 4000), ('wheel_slip', 1250),
    ('odom', 1250), ('cmd_vel', 1)])
def test_own_subscriptions_hold_two_seconds_at_five_times_the_rate(name, depth):
    profile = subscriber_qos(name)
    assert profile.depth == depth
    assert profile.reliability == ReliabilityPolicy.RELIABLE


def test_best_effort_subscriptions_serve_other_publishers():
    profile = subscriber_qos('imu/data', reliability='best_effort')
    assert profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert profile.depth == 1000


@pytest.mark.parametrize('name', ['path', 'friction_map', '/tf_static'])
def test_topics_published_on_change_are_transient_local(name):
    profile = publisher_qos(name)
    assert profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert profile.depth == 1


def test_the_subscription_to_an_order_matches_any_reliable_publisher():
    profile = volatile_qos('path')
    assert profile.durability == DurabilityPolicy.VOLATILE
    assert profile.reliability == ReliabilityPolicy.RELIABLE
    assert profile.depth == 1
    assert publisher_qos('path').durability == DurabilityPolicy.TRANSIENT_LOCAL  # not changed


def test_the_file_for_rosbag2_is_current():
    assert OVERRIDES.read_text(encoding='utf-8') == rosbag2_overrides(), 'run: make config'


def test_rosbag2_gets_a_complete_profile_of_every_volatile_topic():
    overrides = yaml.safe_load(OVERRIDES.read_text(encoding='utf-8'))
    assert overrides.keys() == {f'/{name}' for name in VOLATILE}
    assert not overrides.keys() & {f'/{name}' for name in LATCHED}
    for name, policies in overrides.items():
        # as ros2bag parses it: short keys of policies, a number for the depth
        profile = QoSProfile(
            history=HistoryPolicy.get_from_short_key(policies.pop('history')),
            depth=policies.pop('depth'),
            reliability=ReliabilityPolicy.get_from_short_key(policies.pop('reliability')),
            durability=DurabilityPolicy.get_from_short_key(policies.pop('durability')))
        assert not policies
        offered = publisher_qos(name.lstrip('/'))
        assert qos_check_compatible(offered, profile)[0] != QoSCompatibility.ERROR
        assert profile.depth >= subscriber_qos(name.lstrip('/')).depth
        assert profile.depth >= 100


def test_queues_of_rosbag2_hold_two_seconds_of_four_wheels_at_five_times_the_rate():
    overrides = yaml.safe_load(OVERRIDES.read_text(encoding='utf-8'))
    assert overrides['/tire_samples']['depth'] == 16000
    assert overrides['/imu/data']['depth'] >= 1000


@pytest.mark.parametrize(('name', 'is_kept', 'messages', 'rate', 'depth'), [
    ('/map', True, 0, 1.0, 1), ('/map', True, 7, 1.0, 7), ('/map', True, 2000, 1.0, 1000),
    ('/chatter', False, 5, 1.0, 1000), ('/imu/data', False, 5, 1.0, 1000),
    ('/tire_samples', False, 5, 0.5, 3200), ('/tire_samples', False, 5, 3.0, 9600)])
def test_the_queue_of_a_replay_holds_what_was_kept_and_bursts(
        name, is_kept, messages, rate, depth):
    channel = SimpleNamespace(topic=name, qos='transient_local' * is_kept)
    profile = replayer_qos(name, channel, messages, rate)
    assert profile.depth == depth
    assert (profile.durability == DurabilityPolicy.TRANSIENT_LOCAL) == is_kept
