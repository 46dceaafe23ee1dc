# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Delay of the base: learned from its motion, and the motion after the commands under way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.control.base_response import BaseResponse
from smart_tire.control.ground_motion import Motion
from smart_tire.samples import NS_PER_S

START, PERIOD = 5 * NS_PER_S, 0.05
ARM = 0.2  # m, half of the track


def velocity(time):
    """Return speed and yaw rate that are commanded at a time [s]: starts, stops, turns."""
    phase = int(time / 1.5) % 4
    return [(0.0, 0.0), (0.5, 0.0), (0.5, 0.6), (0.0, -0.4)][phase]


class Base:
    """A base with dead time and a gain, whose odometry comes at ``rate`` [Hz]."""

    def __init__(self, delay, given=0.15, rate=20.0, gain=1.0, noise=0.0, commands=velocity):
        self.response, self.delay, self.gain = BaseResponse(given, ARM), delay, gain
        self._rate, self._noise, self._commands = rate, noise, commands
        self._rng = np.random.default_rng(1)
        self.steps = 0

    def motion(self, time):
        v_x, yaw_rate = self._commands(time - self.delay) if time >= self.delay else (0.0, 0.0)
        noise = self._noise * self._rng.standard_normal(2)
        return Motion(0.0, 0.0, 0.0, self.gain * v_x + noise[0], 0.0,
                      self.gain * yaw_rate + noise[1])

    def run(self, seconds):
        """Advance by a time."""
        for _ in range(round(seconds / PERIOD)):
            time = PERIOD * self.steps
            every = round(1.0 / (PERIOD * self._rate)) or 1
            if self.steps % every == 0:
                self.response.learn(self.motion(time), START + round(time * NS_PER_S))
            self.response.command(*self._commands(time), START + round(time * NS_PER_S))
            self.steps += 1
        return self


@pytest.mark.parametrize(('rate', 'gain', 'noise'), [
    (20.0, 1.0, 0.0), (4.0, 1.0, 0.0), (20.0, 0.8, 0.02), (20.0, 1.2, 0.05)])
@pytest.mark.parametrize('delay', [0.3, 0.45])
def test_the_delay_of_a_late_base_is_learned(delay, rate, gain, noise):
    found = Base(delay, rate=rate, gain=gain, noise=noise).run(12.0).response.delay
    assert found == pytest.approx(delay, abs=0.06 if rate > 10.0 else 0.2)


def test_a_delay_that_is_about_as_given_stays_the_given_one():
    assert Base(0.15).run(12.0).response.delay == 0.15
    assert Base(0.13, noise=0.03).run(30.0).response.delay == 0.15


def test_it_is_learned_again_after_a_change_and_not_forgotten_while_nothing_changes():
    base = Base(0.45).run(12.0)
    base._commands = lambda time: (0.5, 0.0)
    learned = base.run(60.0).response.delay
    assert learned == pytest.approx(0.45, abs=0.06)
    base._commands, base.delay = velocity, 0.2
    assert base.run(20.0).response.delay == pytest.approx(0.2, abs=0.06)


def test_without_commands_and_after_gaps_nothing_is_learned():
    response = BaseResponse(0.15, ARM)
    for step in range(200):  # driven by another source
        response.learn(Motion(0.0, 0.0, 0.0, math.sin(0.1 * step), 0.0, 0.0),
                       START + step * NS_PER_S // 20)
    assert response.delay == 0.15
    base = Base(0.45, rate=1.0).run(30.0)  # odometry at 1 Hz: no rate of change
    assert base.response.delay == 0.15


def test_a_robot_that_is_blocked_has_no_delay():
    response = BaseResponse(0.15, ARM)
    for step in range(100):
        stamp = START + step * NS_PER_S // 20
        response.learn(Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), stamp)
        response.command(0.5, 0.3, stamp)
        assert response.delay == 0.15


def test_with_the_given_delay_the_twist_is_kept_over_it():
    response, motion = BaseResponse(0.2, ARM), Motion(1.0, 2.0, 0.3, 0.4, 0.1, 0.5)
    response.command(0.9, 0.0, START)
    later = START + NS_PER_S // 10
    assert response.predicted(motion, START, later) == motion.after(0.1 + 0.2)
    response.given = 0.3
    assert response.predicted(motion, START, later) == motion.after(0.1 + 0.3)


@pytest.mark.parametrize('gain', [1.0, 0.8])
def test_commands_that_are_under_way_are_part_of_the_prediction(gain):
    base = Base(0.5, given=0.1, gain=gain).run(12.0)
    base.response._learned = 0.5
    now = PERIOD * (base.steps - 1)
    for stamp in (now, now - 0.1):
        x, yaw = 0.0, 0.0
        for step in range(round((now + 0.5 - stamp) / 1e-3)):
            v_x, yaw_rate = velocity(stamp + 1e-3 * step - 0.5)
            x, yaw = x + 1e-3 * v_x * math.cos(yaw), yaw + 1e-3 * yaw_rate
        found = base.response.predicted(
            base.motion(stamp), *(START + round(time * NS_PER_S) for time in (stamp, now)))
        if gain == 1.0:
            assert (found.x, found.yaw) == pytest.approx((x, yaw), abs=0.02)
        assert found.v_x == pytest.approx(velocity(now - 0.1)[0], abs=0.2 * abs(1.0 - gain) + 1e-9)


def test_a_base_that_is_faster_than_given_is_predicted_over_its_own_delay():
    base = Base(0.0, given=0.4).run(12.0)
    assert base.response.delay < 0.06
    motion = base.motion(3.5)
    stamp = START + round(3.5 * NS_PER_S)
    found = base.response.predicted(motion, stamp, stamp)
    assert found == motion.after(base.response.delay)
