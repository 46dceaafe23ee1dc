# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The node ``friction_mapper``: estimates to a map, in virtual time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from smart_tire.messages import TOPICS
from smart_tire.nodes.friction_mapper import FrictionMapper
from smart_tire.samples import GroundState, NS_PER_S
from smart_tire.uncertain import Uncertain
from support.ideal_robot import odometry
from support.virtual_node import virtual

pytestmark = pytest.mark.processes


@pytest.fixture
def node(isolated_ros):
    """Return a node in virtual time that publishes every two seconds."""
    with virtual(FrictionMapper, update_period=2.0, history=3.0) as made:
        yield made


def drive(node, begin=0.0, end=2.0, mu=0.4):
    """Publish the estimates of a straight drive between two places [m]."""
    for x in np.arange(begin, end, 0.004):
        node.publish('odom', odometry(round(2.0 * x * NS_PER_S), x, v_x=0.5, variance=1e-5))
    for x in np.arange(begin, end, 0.25):
        node.publish('ground_state', GroundState(
            round(2.0 * x * NS_PER_S), Uncertain(50.0, 2.0), Uncertain(mu, 0.02)))


def maps(node):
    """Return the maps that were published."""
    return [TOPICS['friction_map'].from_msg(msg) for msg in node.received['friction_map']]


def test_the_map_of_a_drive_is_published_once_until_there_are_new_estimates(node):
    node.run(2.1)
    assert not maps(node) and node.health().values['map'] == 'none yet'
    drive(node)
    node.run(6.0)
    found, = maps(node)
    assert (found.frame, found.resolution) == ('odom', pytest.approx(0.1))
    values = np.frombuffer(found.values, np.uint8)
    assert set(values) == {40, 255}
    assert (values == 40).sum() in range(34, 41)  # both tracks, until the latest estimate
    assert found.stamp_ns == pytest.approx(4 * NS_PER_S, abs=NS_PER_S)
    assert node.health().values['cells'] == str((values == 40).sum())
    drive(node, 2.0, 2.5, 0.3)
    node.run(2.1)
    assert len(maps(node)) == 2


def test_late_subscribers_get_the_map(node):
    from rclpy.qos import DurabilityPolicy
    from smart_tire.nodes.qos import publisher_qos
    assert publisher_qos('friction_map').durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_only_the_latest_part_of_a_long_drive_is_kept(node):
    drive(node, 0.0, 8.0)
    node.run(2.1)
    found, = maps(node)
    assert 2.7 <= found.columns * 0.1 <= 3.5  # poses are a little more than 0.025 m apart
    assert found.origin[0] + found.columns * 0.1 == pytest.approx(7.75, abs=0.11)


def test_the_map_begins_again_when_the_odometry_jumps(node):
    drive(node)
    node.publish('odom', odometry(20 * NS_PER_S, -3.0, variance=1e-5))
    node.run(2.1)
    assert not maps(node)
    values = node.health().values
    assert values['restarts'] == '1' and 'no friction' in values['map']


def test_poses_of_unknown_accuracy_are_not_mapped(node):
    node.publish('ground_state', GroundState(0, Uncertain(50.0, 2.0), Uncertain(0.4, math.inf)))
    node.run(2.1)
    assert not maps(node)
