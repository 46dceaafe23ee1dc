# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Messages and definitions written without ROS agree with ROS."""

from __future__ import annotations

from importlib import import_module

import pytest

from smart_tire.bags.cdr import definition, empty, Encoder
from smart_tire.messages import topic_of, TOPICS
from smart_tire.samples import (
    Friction, FRICTION_QUANTITIES, Icr, NAN, PlannedPath, TireSample)
from smart_tire.uncertain import Uncertain

SAMPLES = [
    TireSample(1_700_000_000_123_456_789, 'rear_left', (1.65, 2.5)),
    Icr(5, 0.02, -1.5),
    Friction(7, 'rear_right', **dict.fromkeys(FRICTION_QUANTITIES, Uncertain(0.5, 0.25))),
    PlannedPath(8, 'odom', ((1.0, -2.5, 0.0), (1.5, 0.25, NAN))),
]


@pytest.mark.parametrize('sample', SAMPLES, ids=lambda sample: type(sample).__name__)
def test_rclpy_decodes_our_messages(sample):
    serialization = pytest.importorskip('rclpy.serialization')
    topic = TOPICS[topic_of(sample)]
    package, kind, name = topic.type.split('/')
    cls = getattr(import_module(f'{package}.{kind}'), name)
    raw = Encoder(topic.type)(topic.to_msg(empty(topic.type), sample))
    assert topic.from_msg(serialization.deserialize_message(raw, cls)) == sample


@pytest.mark.parametrize('type_name', sorted({topic.type for topic in TOPICS.values()}))
def test_a_definition_contains_all_nested_types(type_name):
    text, type_hash = definition(type_name)
    assert type_hash.startswith('RIHS01_')
    assert 'MSG: std_msgs/Header' in text
    assert 'MSG: builtin_interfaces/Time' in text


def test_type_hashes_equal_those_of_ros():
    # As `ros2 topic info -v` of Jazzy prints it.
    assert definition('builtin_interfaces/msg/Time')[1] == (
        'RIHS01_b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197')


def test_an_unknown_type_has_no_definition():
    assert definition('strange_msgs/msg/Thing') == ('', '')
