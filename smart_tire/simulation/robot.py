"""The simulated robot as its devices see it: the plant, and whatever looks at it in time."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.samples import ImuSample, NS_PER_S
from smart_tire.simulation.device_emulators import SensorNodeEmulator
from smart_tire.simulation.films import FilmBatch, FilmSampler
from smart_tire.simulation.plant import Plant, STEP_NS
from smart_tire.simulation.sensors import InertialUnit
from smart_tire.simulation.surfaces import Ground
from smart_tire.simulation.truth import PassageTruth, true_odometry, true_slip, Truth

Observation = ImuSample | FilmBatch | Truth

TRUTH_RATE = 100.0  # Hz, INTERFACES


class Periodic:
    """Tells when a period [ns] has passed, without drift."""

    def __init__(self, period_ns: float) -> None:
        self._period_ns, self._count = period_ns, 1

    @property
    def next_ns(self) -> float:
        """Return the next instant of the grid."""
        return self._count * self._period_ns

    def passed(self, time_ns: int) -> bool:
        """Return whether the next instant of the grid has come."""
        if time_ns < self.next_ns:
            return False
        self._count += 1
        return True


class Robot:
    """Plant, inertial unit, films and ground truth; all time is since the start."""

    def __init__(self, params: SimulatorParams) -> None:
        robot = params.robot
        seeds = np.random.SeedSequence(params.seed).spawn(1 + len(robot.film.wheels))
        imu_rng, *film_rngs = map(np.random.default_rng, seeds)
        self.plant = Plant(robot, params.drive, Ground(params.ground), params.start)
        self.units = {wheel: _sensor_node(wheel, params, rng)
                      for wheel, rng in zip(robot.film.wheels, film_rngs)}
        self._params = robot
        self._imu = InertialUnit(robot, params.errors, imu_rng)
        self._films = [FilmSampler(wheel, unit, params, rng)
                       for (wheel, unit), rng in zip(self.units.items(), film_rngs)]
        self._passages = [[PassageTruth(films, robot, group) for group in robot.film_groups]
                          for films in self._films]
        self._imu_due = Periodic(NS_PER_S / params.imu_rate)
        self._truth_due = Periodic(NS_PER_S / TRUTH_RATE)

    @property
    def next_ns(self) -> int:
        """Return the first step at which something will be observed."""
        due = min(self._imu_due.next_ns, self._truth_due.next_ns,
                  *(films.full_ns for films in self._films))
        return math.ceil(due / STEP_NS) * STEP_NS

    def step(self, duty: Sequence[float]) -> list[Observation]:
        """Advance by one step of the plant; return what was observed in it."""
        plant, seen = self.plant, list[Observation]()
        plant.step(duty)
        now_ns = plant.time_ns
        if self._imu_due.passed(now_ns):
            seen.append(ImuSample(now_ns, *self._imu.read(plant)))
        if self._truth_due.passed(now_ns):
            seen += true_odometry(plant, now_ns), true_slip(plant, self._params, now_ns)
        for films, groups in zip(self._films, self._passages):
            if films.due_ns <= now_ns:
                for batch in films.observe(plant):
                    seen.append(batch)
                    for passages in groups:
                        seen += passages.update(batch.trace)
        return seen


def _sensor_node(wheel: str, params: SimulatorParams,
                 rng: np.random.Generator) -> SensorNodeEmulator:
    """Return the unit of ``wheel`` with a clock of its own."""
    period_us = round(1e6 / params.robot.film.sample_rate)
    return SensorNodeEmulator(params.address_of()[wheel], period_us=period_us,
                     clock_error=rng.normal(0.0, params.radio.clock_error),
                     first_us=int(rng.integers(period_us)))
