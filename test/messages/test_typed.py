# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages of smart_tire_msgs: the same samples as in JointState messages, and the same checks."""

from __future__ import annotations

from dataclasses import replace
import math
from pathlib import Path
import re
from types import SimpleNamespace
from typing import Any

from hypothesis import given, strategies as st
import pytest
from rosbags.typesys import get_types_from_msg
from smart_tire.bags import SampleDecoder
from smart_tire.bags.cdr import empty, SampleEncoder
from smart_tire.control.trajectory_control import PathState
from smart_tire.errors import MessageError
from smart_tire.messages import ALL_TOPICS, definitions, find_topic, forms_of, TOPICS, TYPED
from smart_tire.messages.typed import FORMS
from smart_tire.recording import Faults
from smart_tire.samples import (
    Friction, FRICTION_QUANTITIES, GroundState, NAN, NS_PER_S, PathProgress, Sample, TireSample,
    TireSamples, WHEELS, WheelSlip)
from smart_tire.uncertain import Uncertain
from support.samples import FOUR, SAMPLES, STAMP

PACKAGE = Path(__file__).resolve().parents[2] / 'smart_tire_msgs'
BATCH = TireSamples(STAMP, 'rear_left', 2_500_001, ((1.65, 2.5), (0.0, 3.3), (0.1, 0.2)), True)
SPARSE = (WheelSlip(STAMP, (NAN,) * 4, FOUR, (1.0,) * 4), GroundState(STAMP, Uncertain(25.0, 1.5)),
          Friction(STAMP, 'front_left'), PathProgress(STAMP, NAN, NAN, 0))


def message(name: str, sample: Any) -> Any:
    """Return the message with ``sample`` on the typed topic of ``name``."""
    topic = TYPED[name]
    return topic.to_msg(empty(topic.type), sample)


def same(one: Sample, other: Sample) -> bool:
    """Return whether samples are equal; NaN equals NaN."""
    return repr(one) == repr(other)


@pytest.mark.parametrize(('name', 'sample'), [
    (name, one) for name in sorted(TYPED) for one in (*SAMPLES, *SPARSE)
    if type(one) is TOPICS[name].sample and type(one) in FORMS])
def test_a_typed_message_and_a_joint_state_carry_the_same_sample(name, sample):
    for kind, topic in forms_of(name).items():
        faults = Faults()
        (found,) = SampleDecoder(name, faults, type_name=kind)(SampleEncoder(topic)(sample))
        assert same(found, sample)
        assert faults.frames[name] == {topic.frame or sample.wheel: 1}


def test_every_form_is_used_by_a_topic_of_each_of_its_samples():
    assert {topic.sample for topic in TYPED.values()} == {*FORMS, TireSamples}
    assert TYPED.keys() - {'tire_samples'} == {
        name for name, topic in TOPICS.items() if topic.sample in FORMS}


def test_a_batch_is_read_as_its_samples_to_the_nanosecond():
    data = SampleEncoder(TYPED['tire_samples'])(BATCH)
    samples = SampleDecoder('tire_samples', Faults(), type_name=TYPED['tire_samples'].type)(data)
    assert samples == [TireSample(STAMP + index * 2_500_001, 'rear_left', volts)
                       for index, volts in enumerate(BATCH.volts)]


@given(st.integers(1, NS_PER_S), st.integers(1, 2**31 * NS_PER_S), st.integers(1, 4),
       st.integers(1, 40), st.booleans())
def test_every_batch_is_read_as_it_was_written(period_ns, stamp_ns, films, count, saturated):
    batch = TireSamples(stamp_ns, 'front_left', period_ns, tuple(
        tuple(0.1 * (index * films + film) for film in range(films)) for index in range(count)),
        saturated)
    assert TYPED['tire_samples'].from_msg(message('tire_samples', batch)) == batch


def test_films_and_wheels_are_found_by_name():
    batch = message('tire_samples', BATCH)
    batch.name, volts = batch.name[::-1], list(batch.volts)
    batch.volts = volts[3:] + volts[:3]
    assert TYPED['tire_samples'].from_msg(batch) == BATCH
    slip = message('wheel_slip', WheelSlip(STAMP, FOUR, FOUR, (0.1, 0.2, 0.3, 0.4)))
    slip.name = WHEELS[::-1]
    found = TYPED['wheel_slip'].from_msg(slip)
    assert (found.ratio, found.slip_velocity) == (FOUR[::-1], FOUR[::-1])
    assert found.sigma == (0.4, 0.3, 0.2, 0.1)


@pytest.mark.parametrize(('name', 'changes', 'reason'), [
    ('tire_samples', {'volts': [1.0] * 5}, '5 numbers'),
    ('tire_samples', {'volts': []}, '0 numbers'),
    ('tire_samples', {'volts': [1.0, math.inf]}, 'finite'),
    ('tire_samples', {'name': ['rear_left_pvdf_2']}, 'rear_left_pvdf_1'),
    ('tire_samples', {'name': []}, 'rear_left_pvdf_1'),
    ('tire_samples', {'sample_period': 0.0}, 'sample_period'),
    ('tire_samples', {'sample_period': -0.0025}, 'sample_period'),
    ('tire_samples', {'sample_period': 0.4e-9}, 'sample_period'),
    ('tire_samples', {'sample_period': 1.1}, 'sample_period'),
    ('tire_samples', {'sample_period': NAN}, 'finite'),
    ('tire_samples', {'header.frame_id': 'base_link'}, 'rear_left'),
    ('tire_samples', {'header.stamp': SimpleNamespace(sec=0, nanosec=0)}, 'header.stamp'),
    ('wheel_slip', {'ratio': [0.0] * 3}, '3 numbers'),
    ('wheel_slip', {'sigma': [0.1, 0.1, 0.1, NAN]}, 'sigma'),
    ('wheel_slip', {'slip_velocity': [0.1, 0.1, 0.1, math.inf]}, 'finite'),
    ('wheel_slip', {'name': ['front_left'] * 4}, 'front_right'),
    ('tire_friction', {'header.frame_id': 'base_link'}, 'rear_left'),
    ('ground_state', {'stiffness.sigma': NAN}, 'sigma'),
    ('path_progress', {'state': 5}, 'state is 5'),
    ('path_progress', {'remaining_distance': math.inf}, 'finite'),
])
def test_invalid_messages_are_rejected(name, changes, reason):
    msg = message(name, BATCH if name == 'tire_samples' else next(
        sample for sample in SAMPLES if isinstance(sample, TYPED[name].sample)))
    for path, value in changes.items():
        *parts, last = path.split('.')
        owner = msg
        for part in parts:
            owner = getattr(owner, part)
        setattr(owner, last, value)
    with pytest.raises(MessageError, match=re.escape(reason)):
        TYPED[name].from_msg(msg)


def test_the_limit_of_the_sample_period_is_valid():
    batch = replace(BATCH, period_ns=NS_PER_S)
    assert TYPED['tire_samples'].from_msg(message('tire_samples', batch)) == batch


def test_states_have_the_names_of_the_controller():
    assert FORMS[PathProgress].constants == tuple(state.name for state in PathState)
    assert [state.value for state in PathState] == list(range(len(PathState)))


def test_the_package_builds_what_the_bags_declare():
    files = {f'smart_tire_msgs/msg/{path.stem}': path.read_text(encoding='utf-8')
             for path in (PACKAGE / 'msg').iterdir()}
    assert {name: get_types_from_msg(text, name)[name] for name, text in files.items()} == {
        name: get_types_from_msg(text, name)[name] for name, text in definitions().items()}
    built = re.findall(r'"msg/(\w+)\.msg"', (PACKAGE / 'CMakeLists.txt').read_text('utf-8'))
    assert sorted(built) == sorted(name.rpartition('/')[2] for name in definitions())


def test_the_quantities_are_fields():
    msg = empty(TYPED['tire_friction'].type)
    assert [*vars(msg)] == ['header', *FRICTION_QUANTITIES]
    assert [*vars(msg.slip)] == ['value', 'sigma']


def test_typed_topics_are_found_in_any_namespace():
    for topic in TYPED.values():
        assert find_topic(f'/robot/{topic.name}') is topic is ALL_TOPICS[topic.name]
        assert topic.standard in TOPICS
    assert find_topic('/robot/odom/typed') is None
