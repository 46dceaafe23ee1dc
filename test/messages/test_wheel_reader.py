# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""JointStates of other robots: what is missing in a message is completed from those before it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from smart_tire.errors import MessageError
from smart_tire.messages.wheel_reader import WheelReader
from smart_tire.samples import NS_PER_S, WHEELS

SPEEDS = np.array([5.0, 6.0, 5.0, 6.0])  # rad/s


def joint_state(time, position=(), velocity=(), effort=()):
    """Return a message of ``time`` [s]."""
    sec, nanosec = divmod(round(time * NS_PER_S) + NS_PER_S, NS_PER_S)
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id=''),
        name=list(WHEELS), position=list(position), velocity=list(velocity), effort=list(effort))


def ramp(time):
    """Return angles and speeds of a start with 5 and 6 rad/s2, then at constant speed."""
    before = min(time, 1.0)
    return SPEEDS * (0.5 * before ** 2 + max(time - 1.0, 0.0)), SPEEDS * before


def drive(rate=16.0, seconds=4.0, change=lambda angles, speeds: (angles, speeds)):
    """Return the reader and the samples of a drive whose messages ``change`` makes."""
    read, found = WheelReader(), []
    for k in range(round(seconds * rate)):
        found.append(read(joint_state(k / rate, *change(*ramp(k / rate)))))
    return read, [one for one in found if one is not None]


def errors(samples):
    """Return the largest errors of angles [rad] and speeds [rad/s]; begins at 1 s."""
    wanted = [ramp((one.stamp_ns - NS_PER_S) / NS_PER_S) for one in samples]
    angle, speed = (np.array([getattr(one, name) for one in samples])
                    for name in ('position', 'velocity'))
    return (np.abs(angle - [one for one, _ in wanted]).max(),
            np.abs(speed - [one for _, one in wanted]).max())


def test_complete_messages_are_unchanged():
    read, samples = drive()
    assert len(samples) == 64 and errors(samples) == (0.0, 0.0)
    assert not +read.completed


WRAPS = [lambda a: (a + math.pi) % math.tau - math.pi, lambda a: a % math.tau,
         lambda a: np.fmod(a, math.tau)]


@pytest.mark.parametrize('rate', [5.0, 16.0, 50.0])
@pytest.mark.parametrize('wrap', WRAPS)
def test_angles_that_wrap_are_continued(wrap, rate):
    read, samples = drive(rate, change=lambda angles, speeds: (wrap(angles), speeds))
    assert errors(samples)[0] < 1e-9 and read.completed['wrapped'] >= 2


@pytest.mark.parametrize('unit', [1.0 / math.tau, 0.087])
def test_velocities_of_a_larger_unit_wrap_no_angles(unit):
    """A period at 60 rpm, taken for rad/s, and at 16 Hz is nearly a turn, but none backwards."""
    read, _ = drive(change=lambda angles, speeds: (unit * angles, 10.0 * 30.0 / math.pi * (
        speeds > 0.0)))
    assert not read.completed['wrapped']


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize('wrap', [lambda a: a, *WRAPS])
def test_a_velocity_that_is_missing_is_the_change_of_the_angles(wrap, sign):
    read, samples = drive(change=lambda angles, speeds: (wrap(sign * angles), ()))
    assert len(samples) == 63 == read.completed['missing_velocity']  # the first has none
    speeds = np.array([one.velocity for one in samples])
    assert np.abs(speeds[20:] - sign * SPEEDS).max() < 1e-9
    assert np.abs(speeds[10] - sign * ramp(10.5 / 16.0)[1]).max() < 1e-9  # mean of the period


def test_a_velocity_of_zero_is_not_used_if_the_angle_changes():
    read, samples = drive(change=lambda angles, speeds: (angles, 0.0 * speeds))
    assert errors(samples[20:])[1] < 1e-9
    assert read.completed['zero_velocity'] > 55


def test_a_stationary_wheel_has_a_velocity_of_zero_whatever_its_angle():
    read = WheelReader()
    for time, angle in enumerate([0.0, 0.0, -37.0, -37.0, 0.0, 0.0, 1e-3, 2e-3]):  # resets, noise
        sample = read(joint_state(time / 16.0, [angle] * 4, [0.0] * 4))
        assert sample.velocity == (0.0,) * 4 and sample.position == (angle,) * 4
    assert not +read.completed


@pytest.mark.parametrize('reset', [-37.0, -411.8, 205.9])
def test_a_reset_of_the_angles_is_no_speed(reset):
    read = WheelReader()
    for k in range(40):
        sample = read(joint_state(k / 16.0, SPEEDS * k / 16.0 + (reset if k >= 20 else 0.0)))
        assert k == 0 or np.abs(np.array(sample.velocity) - SPEEDS).max() < 1e-9


@pytest.mark.parametrize('rate', [200.0, 1000.0, 2000.0])
@pytest.mark.parametrize('velocity', [True, False])
def test_messages_in_quick_succession_are_merged(rate, velocity):
    read, samples = drive(rate, change=lambda angles, speeds: (angles, speeds * velocity
                                                               if velocity else ()))
    steps = np.diff([one.stamp_ns for one in samples]) / NS_PER_S
    assert steps.min() == steps.max() and 0.0159 < steps[0] < 0.0202
    angle, speed = errors(samples)
    assert angle < 1e-9 and speed < 6.0 * 0.5 * 0.021  # the mean over 16 to 20 ms
    assert read.completed['merged'] > 0.6 * rate * 4.0


@pytest.mark.parametrize('rate', [4.0, 16.0, 50.0, 100.0])
def test_other_messages_are_not_merged(rate):
    read, samples = drive(rate)
    assert len(samples) == round(4.0 * rate) and read.completed['merged'] == 0


@pytest.mark.parametrize('gap', [20e-9, 5e-6, 190e-6, 210e-6, 1e-3])
def test_messages_that_are_repeated_a_little_later_add_nothing(gap):
    once, twice = WheelReader(), WheelReader()
    for k in range(40):
        angles, speeds = ramp(k / 16.0)
        values = angles, speeds, [0.1 * k] * 4
        expected, found = (read(joint_state(k / 16.0, *values)) for read in (once, twice))
        assert found.stamp_ns == expected.stamp_ns and found.position == expected.position
        # the mean over a period of 62.5 ms
        assert found.velocity == pytest.approx(expected.velocity, abs=gap / 0.0625 * 0.5)
        assert found.effort == pytest.approx(expected.effort, abs=gap / 0.0625 * 0.1 + 1e-12)
        if k:
            assert twice(joint_state(k / 16.0 + gap, *values)) is None
    assert twice.completed['merged'] == 39


def test_a_message_that_is_set_back_in_time_ends_what_is_merged():
    read = WheelReader()
    for k in range(8):
        read(joint_state(1.0 + 1e-3 * k, SPEEDS, SPEEDS, [float(k)] * 4))
    found = read(joint_state(0.5, SPEEDS, SPEEDS, [9.0] * 4))
    assert found.effort == (9.0,) * 4 and found.velocity == tuple(SPEEDS)


def test_stamps_of_another_unit_are_not_merged():
    read = WheelReader()
    assert all(read(joint_state(k * 62.5e-6, SPEEDS, SPEEDS)) for k in range(20))


def test_the_effort_of_merged_messages_is_their_mean():
    read = WheelReader()
    found = [read(joint_state(1e-3 * k, SPEEDS, SPEEDS, [float(k)] * 4)) for k in range(17)]
    assert found[0].effort == (0.0,) * 4 and found[1:16] == [None] * 15
    assert found[16].effort == pytest.approx((8.5,) * 4)


def test_fields_of_another_length_are_left_out():
    read = WheelReader()
    sample = read(joint_state(0.0, [1.0], SPEEDS, [1.0, 2.0]))
    assert sample.position is None and sample.effort is None
    assert sample.velocity == tuple(SPEEDS) and read.completed['other_length'] == 1


@pytest.mark.parametrize('velocity, message', [
    ([], 'velocity has 0 numbers'), ([1.0], 'velocity has 1 numbers'),
    ([math.nan] * 4, 'expected finite'), ([2e3] * 4, 'rad/s')])
def test_without_angles_the_velocity_must_be_complete(velocity, message):
    with pytest.raises(MessageError, match=message):
        WheelReader()(joint_state(0.0, (), velocity))


def test_angles_of_one_time_have_no_rate():
    read = WheelReader()
    assert read(joint_state(0.0, SPEEDS)) is None
    with pytest.raises(MessageError, match='no time since'):
        read(joint_state(0.0, SPEEDS))
