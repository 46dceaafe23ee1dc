# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wheel control of the simulated robot: stable and well damped at all rates of the readings."""

from __future__ import annotations

import math

from benchmarks.control.closed_loop import run_closed_loop, WheelHost
import numpy as np
import pytest
from smart_tire.parameters.control import PidParams, WheelControllerParams
from smart_tire.samples import NS_PER_S
from support.cases import long
from support.motors import simulator

START = 0.3  # s, of the step of the set points
RATES = [(16.0, 16.0), (4.0, 16.0), (100.0, 100.0)]  # Hz, of readings and duties
AHEAD = (6.0,) * 4

every_rate = pytest.mark.parametrize(
    'rates', [RATES[0], *long(*((rates,) for rates in RATES[1:]))], ids=str)


class Robot(WheelHost):
    """Simulated robot whose wheels follow set points after ``START``."""

    def __init__(self, rates, seed, *, set_points=AHEAD, lifted=False, lost=(), **params):
        super().__init__(WheelControllerParams(rate=rates[1], **params),
                         lambda time: set_points if time >= START else (0.0,) * 4)
        self._lost, self._states, self.duties, self.released = lost, [], [], math.inf
        self._rates, self._simulator = rates, simulator(seed, lifted=lifted)

    def receive(self, topic, sample, now_ns):
        """Take wheel speeds that are not lost."""
        since = self.elapsed(now_ns)
        if not any(begin <= since < end for begin, end in self._lost):
            super().receive(topic, sample, now_ns)

    def duty(self, now_ns):
        """Return the duties."""
        if self.elapsed(now_ns) >= self.released:
            self.control.set_params(WheelControllerParams(rate=self._rates[1]))
        self.duties.append(super().duty(now_ns))
        return self.duties[-1]

    def run(self, duration=2.5):
        """Return times [s] since the step (n,), and true wheel speeds [rad/s] (n, 4)."""
        run_closed_loop(
            self._simulator, self, duration, wheel_rate=self._rates[0],
            control_rate=self._rates[1],
            watch=lambda plant: self._states.append([plant.time_ns / NS_PER_S,
                                                     *plant.wheel_speed]))
        states = np.array(self._states)
        return states[:, 0] - START - 1.0 / self._rates[1], states[:, 1:]


@pytest.mark.parametrize('seed', [1, *long(2)])
@pytest.mark.parametrize('rates', RATES, ids=str)
def test_the_wheels_reach_their_set_points_without_overshoot(rates, seed):
    time, speeds = Robot(rates, seed).run()
    assert speeds.max() < 1.06 * AHEAD[0]
    assert speeds[time > (0.9 if rates[0] < 16.0 else 0.5)].min() > 0.94 * AHEAD[0]


@every_rate
def test_lifted_wheels_with_much_less_inertia_are_stable_with_the_same_gains(rates):
    time, speeds = Robot(rates, 3, lifted=True).run()
    assert np.abs(speeds[time > 1.2] - 6.0).max() < 0.5
    assert speeds.max() < 1.3 * 6.0


@every_rate
@pytest.mark.parametrize('factor', [0.8, 1.2])
def test_a_feed_forward_that_is_wrong_is_corrected_without_oscillation(rates, factor):
    pid = PidParams(feed_forward=0.045 * factor, stall_torque=5.0 / factor)
    time, speeds = Robot(rates, 4, pid=pid).run(3.5)
    late = speeds[time > 2.0]
    assert np.abs(late - 6.0).max() < 0.4
    assert speeds.max() < 1.15 * 6.0


@every_rate
def test_gains_that_are_too_high_for_the_delay_are_stable(rates):
    pid = PidParams(proportional=0.5, integral=10.0)
    time, speeds = Robot(rates, 5, pid=pid).run(3.5)
    assert np.abs(speeds[time > 1.5] - 6.0).max() < 0.6


def test_the_tires_scrub_in_a_turn_and_the_wheels_reach_their_set_points():
    set_points = (-4.0, 4.0, -4.0, 4.0)
    time, speeds = Robot(RATES[0], 6, set_points=set_points).run()
    assert np.abs(speeds[time > 1.0] - set_points).max() < 0.4


@every_rate
def test_readings_that_are_missing_for_a_while_cause_no_jump(rates):
    robot = Robot(rates, 7, lost=[(1.5, 1.9)])
    time, speeds = robot.run(3.0)
    assert np.abs(speeds[time > 1.0] - 6.0).max() < 0.5
    assert (0.0,) * 4 not in robot.duties[math.ceil(1.0 * rates[1]):]


@every_rate
def test_wheels_held_back_by_a_limit_are_released_without_overshoot(rates):
    robot = Robot(rates, 8, pid=PidParams(limit=0.2))
    robot.released = 1.8  # s
    time, speeds = robot.run(3.5)
    assert speeds[time < 1.5].max() < 4.5
    assert speeds.max() < 1.06 * AHEAD[0]
    assert speeds[time > 2.6].min() > 0.94 * AHEAD[0]
