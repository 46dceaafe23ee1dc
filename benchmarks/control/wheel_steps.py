# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Steps of the wheel speeds: rise, overshoot and settling, for several rates of the readings."""

from __future__ import annotations

from collections import deque
import itertools
from typing import NamedTuple

from benchmarks.control.closed_loop import run_closed_loop, WheelHost
from benchmarks.scoring import Errors, Run
import numpy as np
from smart_tire.arrays import Array
from smart_tire.parameters import RobotParams, SimulatorParams
from smart_tire.parameters.control import WheelControllerParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.parameters.simulation import SurfaceParams
from smart_tire.samples import Four, NS_PER_S, Sample, WheelSample
from smart_tire.simulation.plant import Plant

MAX_LATENESS = 0.015                      # s, of readings on a host that is busy
SET_POINTS = (6.0, 12.0, 3.0, -6.0, 0.0)  # rad/s
START, STEP_TIME = 0.5, 2.0               # s, of the first step and between steps
NEXT_MARGIN = 0.1                         # s before the next step that are not scored
END_MARGIN = 0.4                          # s before the next step; a later settling is none
BAND = 0.05                               # of the step, within which the speed has settled
AIR = SurfaceParams(names=('air',), friction=(0.0,), stiffness=(1e-3,), drag=(0.0,), base='air',
                    patches=())
LIFTED_MASS = 0.01                        # kg: nearly no load on wheels off the ground
GROUNDS = {'concrete': (SurfaceParams(base='concrete', patches=()), 10.9),
           'lifted wheels': (AIR, LIFTED_MASS)}


class Readings(NamedTuple):
    """Rates [Hz] of the readings and of the duties, and largest lateness of the former [s]."""

    rate: float
    control_rate: float
    lateness: float = 0.0

    def __str__(self) -> str:
        late = f', up to {1e3 * self.lateness:g} ms late' if self.lateness else ''
        return f'{self.rate:g} Hz{late}'


READINGS = (Readings(4.0, 16.0), Readings(16.0, 16.0), Readings(100.0, 100.0),
            Readings(100.0, 100.0, MAX_LATENESS))


RESPONSE = 'rise', 'overshoot', 'settling', 'settled'


class _LateHost(WheelHost):
    """Wheel control that gets its readings late, but in order."""

    def __init__(self, readings: Readings, seed: int) -> None:
        super().__init__(WheelControllerParams(rate=readings.control_rate), _set_points)
        self._rng, self._lateness = np.random.default_rng(seed), readings.lateness
        self._arriving = deque[tuple[int, WheelSample]]()

    def receive(self, topic: str, sample: Sample, now_ns: int) -> None:
        """Keep the wheel speeds until they arrive."""
        if isinstance(sample, WheelSample):
            late_ns = round(self._lateness * self._rng.random() * NS_PER_S)
            last_ns = self._arriving[-1][0] if self._arriving else 0
            self._arriving.append((max(now_ns + late_ns, last_ns), sample))

    def duty(self, now_ns: int) -> Four:
        """Return the duties after the readings that have arrived."""
        while self._arriving and self._arriving[0][0] <= now_ns:
            arrived_ns, sample = self._arriving.popleft()
            super().receive('wheel_states', sample, arrived_ns)
        return super().duty(now_ns)


def _set_points(time: float) -> Four:
    """Return the set points [rad/s] at a time [s] since the first duty."""
    step = int((time - START + STEP_TIME) / STEP_TIME)
    return (SET_POINTS[min(step, len(SET_POINTS)) - 1] if step else 0.0,) * 4


def wheel_steps(ground: str, readings: Readings, seed: int) -> Run:
    """
    Return the responses of four wheels to all steps of one run.

    Rise is from 10 % to 90 % [s], overshoot a share of the step, settling the time [s] until the
    speed stays within ``BAND``, settled whether it does before the next step.
    """
    params, mass = GROUNDS[ground]
    robot = RobotParams(film=TreadFilmParams(wheels=()), mass=mass)
    speeds: list[list[float]] = []

    def watch(plant: Plant) -> None:
        speeds.append([plant.time_ns / NS_PER_S, *plant.wheel_speed])

    run_closed_loop(
        SimulatorParams(seed=seed, ground=params, robot=robot),
        _LateHost(readings, seed), START + STEP_TIME * len(SET_POINTS),
        wheel_rate=readings.rate, control_rate=readings.control_rate, watch=watch)
    time, *wheels = np.array(speeds).T
    steps = [_response(time - begin, wheel, before, after)
             for wheel in wheels
             for begin, (before, after) in zip(
                 _step_times(readings.control_rate), itertools.pairwise((0.0, *SET_POINTS)))]
    return Run(f'{ground}, {readings}', seed, {
        name: Errors.without_sigma(values) for name, values in zip(RESPONSE, zip(*steps))})


def _step_times(control_rate: float) -> list[float]:
    """Return the times of the steps [s]: the first duty is computed after one period."""
    grid = [START + STEP_TIME * index for index in range(len(SET_POINTS))]
    return [float(np.ceil(time * control_rate - 1e-6) + 1.0) / control_rate for time in grid]


def _response(time: Array, speed: Array, before: float, after: float) -> tuple[float, ...]:
    """Return the ``RESPONSE`` of a wheel to the step at time zero [s]."""
    during = (time >= 0.0) & (time < STEP_TIME - NEXT_MARGIN)
    time, share = time[during], (speed[during] - before) / (after - before)
    tenth, most = (float(time[np.argmax(share > level)]) for level in (0.1, 0.9))
    outside = np.flatnonzero(np.abs(share - 1.0) > BAND)
    settling = float(time[outside[-1]]) if len(outside) else 0.0
    return (most - tenth, max(float(share.max()) - 1.0, 0.0), settling,
            float(settling < STEP_TIME - END_MARGIN))
