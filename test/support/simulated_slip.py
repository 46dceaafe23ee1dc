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

"""Slip estimator on simulated runs with unmodeled forces and faults, and its errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.state import State
from smart_tire.estimation.slip.stiffness_prior import StiffnessPrior
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.parameters.robot import FilmParams, RobotParams
from smart_tire.parameters.simulation import GroundParams, SimulatorParams
from smart_tire.samples import Friction, NS_PER_S, Odometry, WHEELS, WheelSample, WheelSlip
from smart_tire.simulation.host import EPOCH_NS
from smart_tire.simulation.offline import simulate
from smart_tire.simulation.plant import Plant, TIME_STEP
from smart_tire.uncertain import Uncertain

CONCRETE = GroundParams(base='concrete', patches=())
SAND = GroundParams(base='sand', patches=())
TURNS = ((3.0, 90.0, 90.0), (6.0, 100.0, 60.0), (11.0, 80.0, 80.0), (14.0, 60.0, 100.0),
         (18.0, 90.0, 90.0), (20.0, 0.0, 0.0))  # start time [s], rpm of both sides
DURATION = 21.0   # s
FILM_SIGMAS = 0.004, 0.02  # of film slip and adhesion ratio
FILM_DELAY_NS = 400_000_000

Events = list[tuple[int, str, object]]
Disturbance = Callable[[Plant, float, float], tuple[float, float]]


@dataclass
class Errors:
    """Errors of a run, and the standard deviations reported with them."""

    time: np.ndarray         # s, of the slips
    slip: np.ndarray         # (n, 2) of both sides
    slip_sigma: np.ndarray
    speed: np.ndarray        # (m,) m/s, v_x
    speed_sigma: np.ndarray
    lateral: np.ndarray      # (m,) m/s, v_y
    lateral_sigma: np.ndarray
    stiffness: np.ndarray    # (k,) ln C_x while moving
    stiffness_sigma: np.ndarray

    def rms(self) -> dict[str, float]:
        """Return the rms errors."""
        return {name: float(np.sqrt(np.mean(getattr(self, name) ** 2)))
                for name in ('slip', 'speed', 'lateral', 'stiffness')}

    def normalized(self, name: str) -> np.ndarray:
        """Return errors over reported standard deviations."""
        return getattr(self, name) / getattr(self, f'{name}_sigma')

    def share(self, name: str, sigmas: float = 3.0) -> float:
        """Return the share of errors within so many reported standard deviations."""
        return float(np.mean(np.abs(self.normalized(name)) < sigmas))


def pooled(runs: list[Errors]) -> Errors:
    """Return the errors of all runs together."""
    names = Errors.__dataclass_fields__
    return Errors(*(np.concatenate([getattr(run, name) for run in runs]) for name in names))


def with_plant(step_body: Callable[[Plant], None] | None = None,
               update_wheels: Callable[[Plant], None] | None = None) -> type[Plant]:
    """Return a plant with a change before each step of the body, or after that of the wheels."""
    class Disturbed(Plant):

        def _step_body(self) -> None:
            forces = self.acceleration
            if step_body:
                step_body(self)
            super()._step_body()
            if getattr(self, 'gravity', False):
                self.acceleration = forces  # the IMU measures specific force

        def _update_wheels(self) -> None:
            super()._update_wheels()
            if update_wheels:
                update_wheels(self)
    return Disturbed


def pushed(force_x: float, force_y: float, begin: float, end: float) -> type[Plant]:
    """Return a plant pushed with a force [N] at the center of mass between two times [s]."""
    def push(plant: Plant) -> None:
        if begin < plant.steps * TIME_STEP < end:
            mass = plant._robot.mass
            plant.acceleration = (plant.acceleration[0] + force_x / mass,
                                  plant.acceleration[1] + force_y / mass)
    return with_plant(push)


def sloped(slope: float) -> type[Plant]:
    """Return a plant on ground that rises by ``slope`` [rad] along x of the world."""
    def gravity(plant: Plant) -> None:
        plant.gravity = True
        down = -GRAVITY * math.sin(slope)
        plant.acceleration = (plant.acceleration[0] + down * math.cos(plant.yaw),
                              plant.acceleration[1] - down * math.sin(plant.yaw))
    return with_plant(gravity)


def lifted(wheel: int, begin: float, end: float) -> type[Plant]:
    """Return a plant with a wheel in the air: those of the other diagonal carry the robot."""
    def lift(plant: Plant) -> None:
        if begin < plant.steps * TIME_STEP < end:
            weight = plant._robot.mass * GRAVITY
            plant.load = [0.01 * weight if i in (wheel, 3 - wheel) else 0.49 * weight
                          for i in range(4)]
            plant.load[wheel] = 0.0
    return with_plant(update_wheels=lift)


def run(ground: GroundParams = CONCRETE, seed: int = 1, *, legs=TURNS, duration: float = DURATION,
        robot: RobotParams | None = None, plant: type[Plant] = Plant) -> Events:
    """Return the events of a simulated run."""
    robot = replace(robot or RobotParams(), film=FilmParams(wheels=()))
    return simulate(SimulatorParams(seed=seed, ground=ground, robot=robot), legs, duration,
                    plant=plant)


def with_efforts(events: Events, change: Callable[[tuple], tuple | None]) -> Events:
    """Return the events with changed motor torques."""
    return [(at, topic, replace(sample, effort=change(sample.effort))
             if isinstance(sample, WheelSample) and sample.effort is not None else sample)
            for at, topic, sample in events]


def without_torque(events: Events) -> Events:
    """Return the events of motor boards that measure no current."""
    return with_efforts(events, lambda effort: None)


def with_films(events: Events, ground: GroundParams, seed: int) -> Events:
    """Add film slips and adhesion ratios of the front wheels, once per revolution, with noise."""
    rng, robot = np.random.default_rng([seed, 9]), RobotParams()
    kind = ground.names.index(ground.base)
    ratio = ground.friction[kind] / ground.stiffness[kind]
    critical = 3.0 * ratio * 0.25 * robot.mass * GRAVITY
    films, rolled, motion, last = [], [0.1, 0.35], None, None
    for _, topic, sample in events:
        if topic == 'ground_truth/odom':
            motion = sample
        if topic != 'ground_truth/wheel_slip' or motion is None:
            continue
        dt, last = 0.0 if last is None else (sample.stamp_ns - last) / NS_PER_S, sample.stamp_ns
        for i in range(2):
            slip, v_y = sample.ratio[i], _lateral_speed(motion)
            rolling = _ground_speed(motion, i) / (1.0 - slip) if abs(slip) < 0.9 else 0.0
            rolled[i] += abs(rolling) * dt / (math.tau * robot.wheel_radius)
            if rolled[i] < 1.0 or abs(rolling) < 0.2:
                continue
            rolled[i] -= 1.0
            adhesion = 1.0 - min(math.hypot(slip, v_y / rolling) / critical, 1.0)
            noise = rng.standard_normal(2) * FILM_SIGMAS
            films.append((sample.stamp_ns + FILM_DELAY_NS, 'tire_friction', Friction(
                sample.stamp_ns, WHEELS[i], film_slip=Uncertain(slip + noise[0], FILM_SIGMAS[0]),
                adhesion_ratio=Uncertain(adhesion + noise[1], FILM_SIGMAS[1]))))
    return sorted([*events, *films], key=lambda event: event[0])


def _ground_speed(motion: Odometry, side: int) -> float:
    """Return v_x [m/s] of the wheel centers of a side, 0 left or 1 right."""
    half = 0.5 * RobotParams().track_width * motion.angular[2]
    return motion.linear[0] + (half if side else -half)


def _lateral_speed(motion: Odometry) -> float:
    """Return v_y [m/s] of the centers of the front wheels."""
    return motion.linear[1] + 0.5 * RobotParams().wheelbase * motion.angular[2]


def estimate(events: Events, begin: float = 4.0, end: float = DURATION, stiffness: float = 0.0,
             **values) -> tuple[Errors, list]:
    """
    Return errors between ``begin`` and ``end`` [s], and all estimates.

    ``stiffness`` is the true ln C_x over that of the parameters.
    """
    params = build(SlipEstimatorParams, values)
    estimator, prior = SlipEstimator(params), StiffnessPrior(params)
    limits = EPOCH_NS + begin * NS_PER_S, EPOCH_NS + end * NS_PER_S
    ground, out = [], []
    for _, topic, sample in events:
        if topic not in ('imu/data', 'wheel_states', 'tire_friction'):
            continue
        out += estimator.update(sample)
        if topic == 'wheel_states' and limits[0] < sample.stamp_ns < limits[1]:
            inner, row = estimator._segment.filter, State.LN_STIFFNESS
            x, P = prior.condition(inner.x, inner.P)
            ground.append((x[row] - stiffness, math.sqrt(P[row, row])))
    found = {(type(item), item.stamp_ns): item for item in out}
    truth = [sample for _, topic, sample in events
             if topic in ('ground_truth/odom', 'ground_truth/wheel_slip')
             and limits[0] < sample.stamp_ns < limits[1]]
    pairs = [(found[key], sample) for sample in truth
             if (key := (type(sample), sample.stamp_ns)) in found]
    slip = np.array([_slip_errors(*pair) for pair in pairs if isinstance(pair[0], WheelSlip)])
    twist = np.array([_twist_errors(*pair) for pair in pairs if isinstance(pair[0], Odometry)])
    slip = slip[np.isfinite(slip).all(axis=1)]
    return Errors(slip[:, 0], slip[:, 1:3], slip[:, 3:5], *twist.T, *np.array(ground).T), out


def _slip_errors(found: WheelSlip, truth: WheelSlip) -> list[float]:
    """Return time [s], errors and standard deviations of both sides."""
    error = np.array(found.ratio) - np.array(truth.ratio)
    return [(truth.stamp_ns - EPOCH_NS) / NS_PER_S, *0.5 * (error[:2] + error[2:]),
            *found.sigma[:2]]


def _twist_errors(found: Odometry, truth: Odometry) -> list[float]:
    """Return errors and standard deviations of v_x and v_y [m/s]."""
    return [found.linear[0] - truth.linear[0], math.sqrt(found.twist_covariance[0]),
            found.linear[1] - truth.linear[1], math.sqrt(found.twist_covariance[7])]
