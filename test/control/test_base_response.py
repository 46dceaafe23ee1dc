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


def reached(time, lags):
    """Return speed and yaw rate at ``time`` [s], from rest, with first-order ``lags`` [s]."""
    values, start = [0.0, 0.0], 0.0
    while start < time:
        end = min(start + 1.5, time)
        values = [command + (value - command) * math.exp((start - end) / lag)
                  for value, command, lag in zip(values, velocity(start + 1e-6), lags)]
        start = end
    return values


class Base:
    """A base with dead time, lags and a gain, whose odometry comes at ``rate`` [Hz]."""

    def __init__(self, delay, given=0.15, rate=20.0, gain=1.0, noise=0.0, lags=(1e-6, 1e-6),
                 commands=velocity):
        self.response, self.delay, self.gain = BaseResponse(given, ARM), delay, gain
        self._rate, self._noise, self._lags, self._commands = rate, noise, lags, commands
        self._rng = np.random.default_rng(1)
        self.steps = 0

    def motion(self, time):
        late = time - self.delay
        v_x, yaw_rate = (reached(late, self._lags) if self._commands is velocity
                         else self._commands(late))
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


@pytest.mark.parametrize('lags', [(0.05, 0.2), (0.2, 0.05), (0.1, 0.3)])
def test_dead_time_and_lags_of_speed_and_yaw_rate_are_learned(lags):
    base = Base(0.3, lags=lags, noise=0.01).run(25.0)
    assert base.response.delay == pytest.approx(0.3 + lags[0], abs=0.03)
    row, *columns = base.response._present()
    times = 24.0 + 0.1 * np.arange(10)  # from a start on
    found = base.response._modeled(START + np.round(
        (times - 0.025 * row) * NS_PER_S).astype(int))[:, (0, 1), columns]
    expected = [reached(time - 0.3, lags) for time in times]
    assert found == pytest.approx(np.array(expected), abs=0.06)


def test_a_delay_that_is_about_as_given_stays_the_given_one():
    assert Base(0.1, lags=(0.05, 0.2)).run(12.0).response.delay == 0.15
    assert Base(0.08, lags=(0.05, 0.2), noise=0.03).run(30.0).response.delay == 0.15


def test_it_is_learned_again_after_a_change_and_not_forgotten_while_nothing_changes():
    base = Base(0.45).run(12.0)
    base._commands = lambda time: velocity(min(time, 14.0))
    learned = base.run(60.0).response.delay
    assert learned == pytest.approx(0.45, abs=0.06)
    base = Base(0.45).run(12.0)
    base.delay = 0.2
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


@pytest.mark.parametrize('gain', [0.3, 1.7])
def test_slip_that_is_not_known_yet_is_no_delay(gain):
    base = Base(0.1, lags=(0.05, 0.2), gain=gain)
    for _ in range(24):
        assert base.run(0.25).response.delay == 0.15


def test_commands_count_over_their_factors_in_the_prediction():
    base = Base(0.5, given=0.1, gain=0.5, lags=(0.025, 0.025))
    base.response.factors[:] = 2.0
    base.run(18.4)  # from -0.2 rad/s on; the stop has not reached the base
    now = START + round(PERIOD * (base.steps - 1) * NS_PER_S)
    motion = base.motion(PERIOD * (base.steps - 1))
    assert motion.yaw_rate == pytest.approx(-0.2)
    found = base.response.predicted(motion, now, now)
    assert (found.v_x, found.yaw_rate) == pytest.approx((0.0, 0.0), abs=0.02)


def test_with_the_given_delay_the_twist_is_kept_over_it():
    response, motion = BaseResponse(0.2, ARM), Motion(1.0, 2.0, 0.3, 0.4, 0.1, 0.5)
    response.command(0.9, 0.0, START)
    later = START + NS_PER_S // 10
    assert response.predicted(motion, START, later) == motion.after(0.1 + 0.2)
    response.given = 0.3
    assert response.predicted(motion, START, later) == motion.after(0.1 + 0.3)


@pytest.mark.parametrize(('gain', 'delay', 'lags'), [
    (1.0, 0.5, (0.025, 0.025)), (0.8, 0.5, (0.025, 0.025)), (1.0, 0.4, (0.05, 0.3))])
def test_commands_that_are_under_way_are_part_of_the_prediction(gain, delay, lags):
    given = 0.1
    base = Base(delay, given=given, gain=gain, lags=lags).run(18.4)
    now = PERIOD * (base.steps - 1)  # 0.35 s after a change, which has not reached the base
    horizon = base.response.delay - given
    for stamp in (now, now - 0.1):
        x, yaw, step = 0.0, 0.0, 1e-3
        for number in range(round((now + horizon - stamp) / step)):
            v_x, yaw_rate = reached(stamp - delay + step * number, lags)
            x, yaw = x + step * gain * v_x * math.cos(yaw), yaw + step * gain * yaw_rate
        found = base.response.predicted(
            base.motion(stamp), *(START + round(time * NS_PER_S) for time in (stamp, now)))
        kept = found.after(-given)
        limit = 0.02 if gain == 1.0 else 0.05
        assert (kept.x, kept.yaw) == pytest.approx((x, yaw), abs=limit)
        assert found.v_x == pytest.approx(gain * reached(now + horizon - delay, lags)[0], abs=0.1)


def test_a_base_that_is_faster_than_given_is_predicted_over_the_given_delay():
    base = Base(0.0, given=0.4).run(12.0)
    assert base.response.delay == 0.4
    motion = base.motion(3.5)
    stamp = START + round(3.5 * NS_PER_S)
    assert base.response.predicted(motion, stamp, stamp) == motion.after(0.4)


def test_a_steady_error_of_the_commanded_velocity_is_part_of_the_prediction():
    response, period = BaseResponse(0.1, ARM), NS_PER_S // 20
    for step in range(120):  # starts after 0.5 s at nine tenths, and turns without a command
        stamp = START + step * period
        v_x = 0.45 if step >= 10 else 0.0
        response.learn(Motion(0.0, 0.0, 0.0, v_x, 0.0, 0.1 * (step >= 10)), stamp)
        response.command(0.5, 0.0, stamp)
    assert response.delay > 0.4
    found = response.predicted(Motion(0.0, 0.0, 0.0, 0.45, 0.0, 0.1), stamp, stamp)
    assert (found.v_x, found.yaw_rate) == pytest.approx((0.45, 0.1), abs=0.01)


@pytest.mark.parametrize(('rate', 'least', 'most'), [(200, 36, 41), (125, 29, 32), (30, 29, 30)])
def test_the_delay_is_learned_each_25_ms_at_most(rate, least, most, monkeypatch):
    elapsed = []
    monkeypatch.setattr(BaseResponse, '_correlate', lambda *given: elapsed.append(given[-1]))
    response = BaseResponse(0.15, ARM)
    response.command(0.5, 0.0, START)
    for number in range(rate + 1):
        response.learn(Motion(0.0, 0.0, 0.0, 0.5, 0.0, 0.0), START + number * NS_PER_S // rate)
    assert least <= len(elapsed) <= most
    assert sum(elapsed) == pytest.approx(1.0, abs=0.025)  # no time is left out
