# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Typed topics of nodes: only if smart_tire_msgs is installed, and while someone subscribes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from importlib import import_module
from pathlib import Path
import sys
from typing import Any

import pytest
import rclpy
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.highlevel import AnyReader
from smart_tire.bags import BagWriter, SampleDecoder
from smart_tire.bags.cdr import definition, empty, SampleEncoder
from smart_tire.messages import TYPED
from smart_tire.nodes import base
from smart_tire.nodes.compat import installed_class, message_class, new_executor, RCLError
from smart_tire.nodes.recorder import Recorder
from smart_tire.nodes.robot_simulator import RobotSimulator
from smart_tire.nodes.slip_estimator import SlipEstimatorNode
from smart_tire.recording import Faults
from smart_tire.samples import TireSamples, WheelSlip
from support.ros_classes import importable, missing
from support.samples import SAMPLES, STAMP
from support.virtual_node import virtual
from support.waiting import wait_for

pytestmark = pytest.mark.processes

SLIP = WheelSlip(STAMP, (0.1, -1.0, 0.0, 1.0), (1.5, -2.0, 3.0, 0.0), (0.01, 0.02, 1.0, 0.5))
NAME = TYPED['wheel_slip'].name
compiled = pytest.mark.skipif(bool(missing()), reason=missing())


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch, isolated_ros: None) -> None:
    """Use messages without ROS in place of those of smart_tire_msgs."""
    monkeypatch.setattr(base, 'installed_class', lambda name: partial(empty, name))


@pytest.fixture
def classes(isolated_ros: None) -> Iterator[None]:
    """Make smart_tire_msgs importable, as after a build."""
    with importable():
        yield


def test_samples_are_published_in_both_forms_only_while_someone_subscribes(stand_in):
    with virtual(SlipEstimatorNode) as node:
        for count in (0, 1, 2, 0):
            node.subscribers[NAME] = count
            node.publish_estimate(SLIP)
    assert node.samples('wheel_slip') == [SLIP] * 4
    assert [TYPED['wheel_slip'].from_msg(msg) for msg in node.received[NAME]] == [SLIP] * 2
    assert node.profiles[NAME] == node.profiles['wheel_slip']


def test_frames_have_the_names_of_the_robot(stand_in):
    with virtual(SlipEstimatorNode, base_frame='body', frame_prefix='r1/') as node:
        node.subscribers[NAME] = 1
        node.publish_estimate(SLIP)
    assert [msg.header.frame_id for name in (NAME, 'wheel_slip') for msg in node.received[name]] \
        == ['r1/body'] * 2


def test_a_message_that_is_not_published_is_counted_for_its_topic(stand_in):
    with virtual(SlipEstimatorNode) as node:
        node.subscribers[NAME] = 1
        node.failures[NAME].append(RCLError('full'))
        node.publish_estimate(SLIP)
        health = node.health()
    assert f'1 messages on {NAME} not published' in health.message
    assert (len(node.received[NAME]), len(node.received['wheel_slip'])) == (0, 1)


def test_the_simulator_publishes_the_truth_in_both_forms(stand_in):
    with virtual(RobotSimulator) as node:
        topics = {topic.topic_name for topic in node.publishers}
    assert {f'/ground_truth/{name}' for name in (
        'wheel_slip', 'wheel_slip/typed', 'tire_friction', 'tire_friction/typed')} <= topics


def test_nothing_is_typed_where_the_package_is_not_installed(isolated_ros, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2]))
    import_module('smart_tire_msgs.msg')  # of a checkout: a folder without classes
    assert installed_class(TYPED['wheel_slip'].type) is None
    monkeypatch.setitem(sys.modules, 'smart_tire_msgs', None)
    monkeypatch.setitem(sys.modules, 'smart_tire_msgs.msg', None)
    assert installed_class(TYPED['wheel_slip'].type) is None
    with virtual(SlipEstimatorNode) as node:
        node.subscribers[NAME] = 1
        node.publish_estimate(SLIP)
    assert (len(node.received['wheel_slip']), len(node.received[NAME])) == (1, 0)
    assert not [name for name in node.profiles if name.endswith('/typed')]


@compiled
def test_the_bytes_of_rclpy_are_read_and_ours_are_read_by_it(classes):
    batch = TireSamples(STAMP, 'rear_left', 2_500_001, ((1.65, 2.5), (0.0, 3.3)), saturated=True)
    for name, topic in TYPED.items():
        cls = message_class(topic.type)
        sample: Any = next(one for one in (*SAMPLES, batch) if type(one) is topic.sample)
        theirs = serialize_message(topic.to_msg(cls(), sample))
        expected = sample.samples if sample is batch else [sample]
        assert [*SampleDecoder(name, Faults(), type_name=topic.type)(theirs)] == expected
        ours = SampleEncoder(topic)(sample)
        assert topic.from_msg(deserialize_message(ours, cls)) == sample


@compiled
def test_a_recording_has_both_forms_and_the_definitions(classes, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, 'argv', ['node'])
    rclpy.init(args=[])
    with BagWriter(tmp_path / 'bag') as writer:
        node, recorder = SlipEstimatorNode(), Recorder(writer, ['wheel_slip', NAME])
        executor = new_executor()
        for one in (node, recorder):
            executor.add_node(one)
        recorder.start()

        def work() -> None:
            node.publish_estimate(SLIP)
            executor.spin_once(timeout_sec=0.02)

        wait_for(lambda: writer.counts.keys() == {'/wheel_slip', f'/{NAME}'}, work)
        (publisher,) = node.get_publishers_info_by_topic(NAME)
        assert str(publisher.topic_type_hash) == definition(TYPED['wheel_slip'].type)[1]
        for one in (node, recorder):
            executor.remove_node(one)
            one.destroy_node()
        executor.shutdown()
    rclpy.try_shutdown()
    with AnyReader([tmp_path / 'bag']) as reader:
        found = [reader.deserialize(data, connection.msgtype) for connection, _, data in
                 reader.messages([one for one in reader.connections if one.topic == f'/{NAME}'])]
    assert found
    assert found[0].slip_velocity.tolist() == [*SLIP.slip_velocity]
