# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulated robot: plant, motors, and IMU, films and ground truth, each sampled at its rate."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.samples import ImuSample, NS_PER_S
from smart_tire.simulation.device_emulators import SensorNodeEmulator
from smart_tire.simulation.films import FilmBatch, FilmSampler
from smart_tire.simulation.plant import Plant, STEP_NS, SurfaceMap
from smart_tire.simulation.sensors import ImuModel, Motors
from smart_tire.simulation.truth import CrossingTruth, true_odometry, true_slip, Truth

Observation = ImuSample | FilmBatch | Truth

TRUTH_RATE = 100.0  # Hz, of the ground truth topics (docs/topics.md)


class PeriodicTimer:
    """Timer with a fixed period [ns] on a grid that starts at 0."""

    def __init__(self, period_ns: float) -> None:
        self._period_ns, self._count = period_ns, 1

    @property
    def next_ns(self) -> float:
        """Return the next time of the grid."""
        return self._count * self._period_ns

    def expired(self, time_ns: int) -> bool:
        """Return whether the next time of the grid is reached; then advance by one period."""
        if time_ns < self.next_ns:
            return False
        self._count += 1
        return True


class Robot:
    """Plant, motors, IMU, films and ground truth; all times are since the start."""

    def __init__(self, params: SimulatorParams, plant: type[Plant] = Plant) -> None:
        robot = params.robot
        seeds = np.random.SeedSequence(params.seed).spawn(1 + len(robot.film.wheels))
        imu_rng, *film_rngs = map(np.random.default_rng, seeds)
        self.motors = Motors(params)
        self.plant = plant(robot, params.drive, SurfaceMap(params.ground), params.start,
                           self.motors.friction_scale)
        self.sensor_nodes = {wheel: _sensor_node(wheel, params, rng)
                             for wheel, rng in zip(robot.film.wheels, film_rngs)}
        self._params = robot
        self._imu = ImuModel(robot, params.errors, imu_rng)
        self._films = [FilmSampler(wheel, node, params, rng)
                       for (wheel, node), rng in zip(self.sensor_nodes.items(), film_rngs)]
        self._crossings = [[CrossingTruth(films, robot, group) for group in robot.film_groups]
                           for films in self._films]
        self._imu_due = PeriodicTimer(NS_PER_S / params.imu_rate)
        self._truth_due = PeriodicTimer(NS_PER_S / TRUTH_RATE)

    @property
    def next_ns(self) -> int:
        """Return the time of the next step that yields an observation."""
        due = min(self._imu_due.next_ns, self._truth_due.next_ns,
                  *(films.full_ns for films in self._films))
        return math.ceil(due / STEP_NS) * STEP_NS

    def step(self, duty: Sequence[float]) -> list[Observation]:
        """Advance by one step of the plant; return its observations."""
        plant, observations = self.plant, list[Observation]()
        plant.step(duty)
        now_ns = plant.time_ns
        if self._imu_due.expired(now_ns):
            observations.append(ImuSample(now_ns, *self._imu.read(plant)))
        if self._truth_due.expired(now_ns):
            observations += true_odometry(plant, now_ns), true_slip(plant, self._params, now_ns)
        for films, groups in zip(self._films, self._crossings):
            if films.due_ns <= now_ns:
                for batch in films.observe(plant):
                    observations.append(batch)
                    for crossings in groups:
                        observations += crossings.ended_in(batch.trace)
        return observations


def _sensor_node(wheel: str, params: SimulatorParams,
                 rng: np.random.Generator) -> SensorNodeEmulator:
    """Return the sensor node of ``wheel`` with random clock error and phase."""
    period_us = round(1e6 / params.robot.film.sample_rate)
    return SensorNodeEmulator(params.address_of()[wheel], period_us=period_us,
                              clock_error=rng.normal(0.0, params.radio.clock_error),
                              first_us=int(rng.integers(period_us)))
