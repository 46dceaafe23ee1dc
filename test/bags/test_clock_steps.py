# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Clocks that are set while a bag is recorded."""

from __future__ import annotations

from operator import itemgetter

import numpy as np
import pytest
from smart_tire.bags import Bag, BagWriter
from smart_tire.bags.clock_steps import (
    ClockStep, ClockSteps, Corrector, has_pause, host_steps, stamp_steps, Times, WheelTurns)
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample

START_NS = 1_700_000_000 * NS_PER_S
DELAY_NS, PERIOD_NS = 2_000_000, 10_000_000
SPEED = 6.0  # rad/s


def times(step=0.0, at=5.0, rate=100.0, seconds=10.0, stamps=True, receive=True, jitter=0.0):
    """Return the times of a topic whose clocks step by ``step`` [s] at ``at`` [s]."""
    true = np.arange(round(seconds * rate)) / rate
    jump = np.rint(np.where(true >= at, step, 0.0) * NS_PER_S).astype(np.int64)
    true_ns = START_NS + np.rint(true * NS_PER_S).astype(np.int64)
    late = np.abs(np.random.default_rng(1).normal(0.0, jitter, len(true)))
    return Times(true_ns + DELAY_NS + np.rint(late * NS_PER_S).astype(np.int64)
                 + jump * receive, true_ns + jump * stamps)


def turns(step=0.0, speed=SPEED, at=5.0, rate=16.0):
    """Return wheels that turn on over the time that passes, not over that of the clock."""
    found = times(step, at, rate)
    angle = speed * np.arange(len(found.receive_ns)) / rate
    return WheelTurns(found.receive_ns, np.tile(angle[:, np.newaxis], 4),
                      np.full((len(angle), 4), speed))


@pytest.mark.parametrize('step', [0.3, 2.0, 3600.0, 1.5e9, -0.15, -2.0, -3600.0])
def test_a_step_of_the_clock_of_the_host_is_found_with_its_size(step):
    found, = host_steps([times(step, jitter=1e-3), times(step, rate=16.0)], turns(step)).host
    assert found.step_ns == pytest.approx(step * NS_PER_S, abs=10e6)
    assert found.before_ns == pytest.approx(START_NS + 5.0 * NS_PER_S, abs=20e6)


@pytest.mark.parametrize('pause', [0.3, 2.0, 60.0])
def test_a_pause_in_which_the_wheels_turn_on_is_none(pause):
    wheels = turns(pause)
    gone = np.where(wheels.receive_ns > START_NS + 5.5 * NS_PER_S, 1.0, 0.0)
    after = wheels.receive_ns > START_NS + 5.0 * NS_PER_S
    moved = WheelTurns(wheels.receive_ns, wheels.angle + SPEED * pause * after[:, np.newaxis],
                       wheels.speed)
    steps = host_steps([times(pause)], moved)
    found, = steps.pauses
    assert not steps.host and found.turned and gone.any()
    assert found.end_ns - found.begin_ns == pytest.approx(pause * NS_PER_S, abs=20e6)


@pytest.mark.parametrize('wheels', [None, turns(2.0, speed=0.0), turns(2.0, speed=0.01)])
def test_a_pause_of_stationary_wheels_proves_no_step_forward(wheels):
    steps = host_steps([times(2.0)], wheels)
    found, = steps.pauses
    assert not steps.host and not found.turned


@pytest.mark.parametrize(('step', 'speed', 'pauses'), [
    (2.0, SPEED, 0), (3600.0, SPEED, 0), (-2.0, 0.0, 0), (-3600.0, SPEED, 0), (2.0, 0.0, 1)])
def test_a_bag_lasts_as_long_as_by_the_first_clock(tmp_path, step, speed, pauses):
    imu, wheels, drive = times(step), times(step, rate=16.0), turns(step, speed)
    events = [*(('imu/data', *row) for row in zip(
                  times().stamp_ns.tolist(), imu.receive_ns.tolist(), [ImuSample(
                      at, (0.0,) * 3, (0.0, 0.0, 9.81)) for at in imu.stamp_ns.tolist()])),
              *(('wheel_states', *row) for row in zip(
                  times(rate=16.0).stamp_ns.tolist(), wheels.receive_ns.tolist(), [
                      WheelSample(at, (speed,) * 4, tuple(angle)) for at, angle in zip(
                          wheels.stamp_ns.tolist(), drive.angle.tolist())]))]
    with BagWriter(tmp_path / 'bag') as writer:
        for topic, _, received, sample in sorted(events, key=itemgetter(1)):
            writer.write_sample(topic, received, sample)
    with Bag(tmp_path / 'bag') as bag:
        list(bag.samples(['imu/data', 'wheel_states']))
        begin, end = bag.span_ns
        assert (end - begin) / NS_PER_S == pytest.approx(10.0 + 2.0 * pauses, abs=0.03)
        assert len(bag.faults.pauses) == pauses
        assert bool(bag.faults.clock_steps) == (not pauses)


def test_a_gap_of_one_topic_is_no_pause():
    other = times(rate=16.0)
    assert not host_steps([times(2.0), other], None).pauses
    assert len(host_steps([times(2.0), times(2.0, rate=16.0)], None).pauses) == 1


@pytest.mark.parametrize('stall', [0.5, 1.0, 4.0])
def test_messages_that_wait_in_a_stall_of_the_recorder_are_no_step(stall):
    def waiting(one):
        at = START_NS + 5 * NS_PER_S
        until = at + round(stall * NS_PER_S)
        return np.where((one > at) & (one < until), until, one)
    one, wheels = times(), turns()
    stalled = WheelTurns(waiting(wheels.receive_ns), wheels.angle, wheels.speed)
    steps = host_steps([Times(waiting(one.receive_ns), one.stamp_ns)], stalled)
    assert not steps.host and not steps.pauses


def test_two_steps_are_found():
    one, other = times(2.0, seconds=20.0), times(-1.0, at=12.0, seconds=20.0)
    stepped = Times(one.receive_ns + other.receive_ns - times(seconds=20.0).receive_ns,
                    one.stamp_ns)
    first, second = host_steps([stepped], turns(2.0)).host
    assert (first.step_ns, second.step_ns) == (2 * NS_PER_S, -NS_PER_S)
    correct = Corrector(ClockSteps([first, second]))
    found = [correct('', at)[0] for at in stepped.receive_ns.tolist()]
    assert found == times(seconds=20.0).receive_ns.tolist()


@pytest.mark.parametrize('step', [0.3, 2.0, 3600.0, -0.3, -2.0, -3600.0])
@pytest.mark.parametrize('rate', [16.0, 100.0])
def test_a_step_of_the_clock_of_a_device_is_found_by_its_stamps(step, rate):
    one = times(step, rate=rate, receive=False, jitter=2e-3)
    found, = stamp_steps(one)
    assert found.step_ns == pytest.approx(step * NS_PER_S, abs=5e6)
    correct = Corrector(ClockSteps(stamps={'/imu': [found]}))
    ahead = [correct('/imu', at)[1] for at in one.receive_ns.tolist()]
    assert np.abs(one.stamp_ns - ahead - times(rate=rate).stamp_ns).max() < 5e6
    assert correct('/other', int(one.receive_ns[-1]))[1] == 0


def test_late_messages_and_gaps_are_no_steps_of_a_device():
    late, gap = times(), times()
    stalled = (late.stamp_ns > START_NS + 5 * NS_PER_S) & (
        late.stamp_ns < START_NS + 5.6 * NS_PER_S)
    received = np.where(stalled, START_NS + round(5.6 * NS_PER_S), late.receive_ns)
    assert stamp_steps(Times(received, late.stamp_ns)) == []
    assert stamp_steps(Times(gap.receive_ns[~stalled], gap.stamp_ns[~stalled])) == []


def test_stamps_that_are_wrong_throughout_are_no_steps():
    one = times()
    assert stamp_steps(Times(one.receive_ns, one.stamp_ns // NS_PER_S * NS_PER_S)) == []
    assert stamp_steps(Times(one.receive_ns, np.zeros_like(one.stamp_ns))) == []
    assert not host_steps([], None).host


def test_a_step_is_described_with_size_and_time():
    steps = ClockSteps([ClockStep(START_NS + 5 * NS_PER_S, 2 * NS_PER_S)], stamps={
        '/imu': [ClockStep(START_NS + 5 * NS_PER_S, 2 * NS_PER_S)],
        '/wheels': [ClockStep(START_NS + 8 * NS_PER_S, -NS_PER_S)]})
    assert list(steps.lines(START_NS)) == [
        'the clock was set forward by 2 s at 5.0 s; the recording is continued',
        '/wheels: the clock of its stamps was set back by 1 s at 8.0 s; they are continued']
    assert not steps.back and has_pause(times(2.0)) and not has_pause(times())
