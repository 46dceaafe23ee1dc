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

"""
Starts and stops on slippery ground, with and without traction control.

The estimators and the wheel controller run in the loop (``closed_loop``). Ground that
was measured before is that of a gentle lap with films; unknown ground is the first start of a
robot without films. With a fault, estimates are replaced by wrong ones. The other robot has tires
with a falling friction curve and another mass; the software does not know.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate

from benchmarks.control.closed_loop import run_closed_loop
from benchmarks.control.other_plant import other_robot, OtherPlant, peak_slip
from benchmarks.control.wrong_estimates import FAULTS
import numpy as np

from smart_tire.analysis.pipeline import EstimatorParams, Pipeline
from smart_tire.arrays import Array
from smart_tire.control.wheel_control import WheelControl
from smart_tire.models.tire.brush_tire import brush_force
from smart_tire.parameters import (
    FrictionEstimatorParams, RobotParams, SimulatorParams, SlipEstimatorParams,
    WheelControllerParams)
from smart_tire.parameters.control import TractionParams
from smart_tire.parameters.robot import FilmParams
from smart_tire.parameters.simulation import GroundParams, PatchParams
from smart_tire.samples import (
    Four, GroundState, NS_PER_S, Odometry, Sample, VelocityCommand, WheelSample)
from smart_tire.simulation.plant import Plant


WAIT = 'wait', 3.0, 0.0, 0.0         # kind, duration [s], v_x [m/s], yaw rate [rad/s]
LAP = 'lap', 12.0, 0.5, 0.6          # gentle, with films
REST = 'rest', 1.5, 0.0, 0.0
START, STOP = ('start', 2.0, 1.6, 0.0), ('stop', 2.5, 0.0, 0.0)
SHUTTLE = (('there', 1.2, 0.8, 0.0), REST, ('back', 1.2, -0.8, 0.0), REST)  # on a straight line
LOG_STEPS = 2         # steps of the plant between logged states
FILM_WHEELS = ('front_left', 'front_right')
SPLIT_FRICTION = 0.17  # -, on the right of the ground with two sides
CHANGE_AT = 0.1        # m, from the start to the patch with less friction
FIELD = 50.0           # m, half the size of a patch


@dataclass(frozen=True)
class Leg:
    """A command for some time."""

    kind: str        # 'start' and 'stop' are scored
    duration: float  # s
    v_x: float       # m/s
    yaw_rate: float  # rad/s


@dataclass(frozen=True, kw_only=True)
class TractionScenario:
    """A robot on ground, and the commands it gets."""

    name: str
    title: str
    legs: tuple[Leg, ...]
    ground: GroundParams
    films: bool = True        # whether the wheels of the front axle have films
    wheel_rate: float = 16.0  # Hz, of wheel_states and of the controller
    seed: int = 1
    traction: bool = True     # whether traction control is enabled
    other: bool = False       # whether the plant is the other robot
    fault: str = ''           # key of FAULTS: wrong estimates

    @property
    def robot(self) -> RobotParams:
        """Return the parameters of the robot."""
        return RobotParams(film=FilmParams(wheels=FILM_WHEELS if self.films else ()))


@dataclass
class PlantLog:
    """True states of a run; arrays over (time,) or (time, wheel)."""

    peaks: bool = False  # whether the friction curve falls beyond a peak
    rows: list[tuple[float, ...]] = field(default_factory=list)
    count: int = 0

    def __call__(self, plant: Plant) -> None:
        """Add the present state of the plant at every LOG_STEPS-th call."""
        self.count += 1
        if self.count % LOG_STEPS:
            return
        self.rows.append((
            1e-9 * plant.time_ns, plant.x, plant.y, plant.yaw, plant.v_x, *plant.wheel_speed,
            *plant.wheel_v_x, *plant.wheel_v_y, *plant.load,
            *(surface.friction for surface in plant.surface),
            *(surface.stiffness for surface in plant.surface)))

    def history(self, radius: float) -> TractionHistory:
        """Return the logged states."""
        table = np.array(self.rows)
        wheels = table[:, 5:].reshape(len(table), 6, 4).transpose(1, 0, 2)
        omega, v_x, v_y, load, friction, stiffness = wheels
        critical = (peak_slip if self.peaks else critical_slip)(friction, load, stiffness)
        time, x, y, yaw, speed = table[:, :5].T
        return TractionHistory(time, x, y, yaw, speed, radius * omega, v_x, v_y, load, friction,
                               stiffness, critical)


def critical_slip(friction: Array, load: Array, stiffness: Array) -> Array:
    """Return the slip at which the whole contact patch of a brush tire slides."""
    return 3.0 * friction * load / stiffness


@dataclass(frozen=True)
class TractionHistory:
    """True motion, slips and forces; arrays over (time,) or (time, wheel)."""

    time: Array       # s
    x: Array          # m
    y: Array          # m
    yaw: Array        # rad
    v_x: Array        # m/s
    rolling: Array    # m/s, r w
    wheel_v_x: Array  # m/s
    wheel_v_y: Array  # m/s
    load: Array       # N
    friction: Array   # -
    stiffness: Array  # N
    critical_slip: Array  # -, of full sliding, or of the largest force

    @property
    def slip(self) -> tuple[Array, Array]:
        """Return the slip vectors (s_x, s_y); 0 where the wheels do not turn."""
        scale = np.maximum(np.abs(self.rolling), 1e-3)
        return (self.rolling - self.wheel_v_x) / scale, -self.wheel_v_y / scale

    @property
    def forces(self) -> tuple[Array, Array]:
        """Return F_x and F_y [N] of the ground on each wheel."""
        return brush_force(*self.slip, self.friction, self.load, self.stiffness)

    def between(self, begin: float, end: float) -> TractionHistory:
        """Return the part of the history between two times [s]."""
        chosen = (self.time >= begin) & (self.time < end)
        return TractionHistory(*(getattr(self, name)[chosen]
                                 for name in self.__dataclass_fields__))


class TractionStack:
    """Estimators and wheel controller, driven by the legs of a scenario."""

    def __init__(self, scenario: TractionScenario, traction: TractionParams) -> None:
        robot = scenario.robot
        self._pipeline = Pipeline(EstimatorParams(
            SlipEstimatorParams(robot=robot), FrictionEstimatorParams(robot=robot)))
        self.control = WheelControl(WheelControllerParams(
            rate=scenario.wheel_rate, robot=robot, traction=traction))
        self._legs, self._fault = scenario.legs, FAULTS[scenario.fault]
        self._ends = list(accumulate(leg.duration for leg in scenario.legs))
        self._start_ns: int | None = None
        self.begins: list[float] = []  # s, first control step of each leg, since the start
        self.trace: list[tuple[float, ...]] = []

    def receive(self, topic: str, sample: Sample, now_ns: int) -> None:
        """Process a message."""
        if topic.startswith('ground_truth/'):
            return
        if isinstance(sample, WheelSample):
            self.control.add_reading(sample.velocity, now_ns, sample.stamp_ns,
                                            sample.position)
            self.control.traction.add_wheels(sample)
        for estimate in self._fault(self._pipeline.update(sample)):
            if isinstance(estimate, Odometry):
                self.control.traction.add_odometry(estimate)
            elif isinstance(estimate, GroundState):
                self.control.traction.set_ground(estimate)

    def duty(self, now_ns: int) -> Four:
        """Return the duties for the command in force."""
        time = self._elapsed(now_ns)
        number = sum(end <= time for end in self._ends)
        leg = self._legs[min(number, len(self._legs) - 1)]
        if len(self.begins) <= number:
            self.begins.append(time)
        command = VelocityCommand(now_ns, leg.v_x, leg.yaw_rate)
        set_points, duties = self.control.follow(command, now_ns, now_ns)
        self.trace.append((time, *set_points))
        return duties

    def finished(self, now_ns: int) -> bool:
        """Return whether all legs are over."""
        return self._elapsed(now_ns) >= self._ends[-1]

    def _elapsed(self, now_ns: int) -> float:
        if self._start_ns is None:
            self._start_ns = now_ns - now_ns % NS_PER_S
        return (now_ns - self._start_ns) / NS_PER_S


@dataclass(frozen=True)
class TractionRun:
    """History of a run, and the times at which its legs began."""

    scenario: TractionScenario
    begins: tuple[float, ...]  # s
    history: TractionHistory

    def legs(self) -> list[tuple[Leg, TractionHistory]]:
        """Return each leg with its history."""
        ends = (*self.begins[1:], self.history.time[-1] + 1.0)
        return [(leg, self.history.between(begin, end)) for leg, begin, end
                in zip(self.scenario.legs, self.begins, ends)]


def run(scenario: TractionScenario, params: TractionParams | None = None) -> TractionRun:
    """Return a run of a scenario, by default with the default parameters."""
    stack = TractionStack(
        scenario, replace(params or TractionParams(), enabled=scenario.traction))
    log = PlantLog(scenario.other)
    robot = other_robot(scenario.robot) if scenario.other else scenario.robot
    simulator = SimulatorParams(seed=scenario.seed, ground=scenario.ground, robot=robot)
    run_closed_loop(simulator, stack, sum(leg.duration for leg in scenario.legs) + 1.0,
                    wheel_rate=scenario.wheel_rate, control_rate=scenario.wheel_rate, watch=log,
                    plant=OtherPlant if scenario.other else Plant)
    return TractionRun(scenario, tuple(stack.begins[:len(scenario.legs)]),
                       log.history(scenario.robot.wheel_radius))


def ground(friction: float, stiffness: float, drag: float, *, right: float | None = None,
           beyond: float | None = None) -> GroundParams:
    """
    Return ground of one friction, on the right (y < 0) that of ``right`` instead.

    With ``beyond``, ``friction`` ends after CHANGE_AT, where that of ``beyond`` begins.
    """
    patches = []
    if right is not None:
        patches.append(PatchParams(name='right', surface='other', x=(-FIELD, FIELD),
                                   y=(-FIELD, 0.0)))
    if beyond is not None:
        patches.append(PatchParams(name='beyond', surface='other', x=(CHANGE_AT, FIELD),
                                   y=(-FIELD, FIELD)))
    other = next((value for value in (right, beyond) if value is not None), friction)
    return GroundParams(names=('base', 'other'), friction=(friction, other),
                        stiffness=(stiffness,) * 2, drag=(drag,) * 2, base='base',
                        patches=tuple(patches))


def legs(*parts: tuple[str, float, float, float]) -> tuple[Leg, ...]:
    """Return legs from (kind, duration [s], v_x [m/s], yaw rate [rad/s])."""
    return tuple(Leg(*part) for part in parts)


KNOWN, UNKNOWN = legs(WAIT, LAP, REST, START, STOP), legs(WAIT, START, STOP)
SHUTTLED = legs(WAIT, *SHUTTLE, *SHUTTLE, START, STOP)
SLIPPERY, SOFT = ground(0.2, 52.7, 0.015), ground(0.2, 30.0, 0.05)
SPLIT = ground(0.2, 52.7, 0.015, right=SPLIT_FRICTION)
SCENARIOS = (
    TractionScenario(name='slippery', title='mu 0.2, measured', legs=KNOWN, ground=SLIPPERY),
    TractionScenario(name='slippery_unknown', title='mu 0.2, unknown', legs=UNKNOWN,
                     ground=SLIPPERY, films=False),
    TractionScenario(name='soft', title='mu 0.2, soft, measured', legs=KNOWN, ground=SOFT),
    TractionScenario(name='soft_unknown', title='mu 0.2, soft, unknown', legs=UNKNOWN,
                     ground=SOFT, films=False),
    TractionScenario(name='split', title='mu 0.2 left, 0.17 right, measured', legs=SHUTTLED,
                     ground=SPLIT),
    TractionScenario(name='split_unknown', title='mu 0.2 left, 0.17 right, unknown',
                     legs=UNKNOWN, ground=SPLIT, films=False),
    TractionScenario(name='change', title='mu 0.47, then 0.2, unknown', legs=UNKNOWN,
                     ground=ground(0.47, 52.7, 0.015, beyond=0.2), films=False),
    TractionScenario(name='ice_unknown', title='mu 0.1, unknown', legs=UNKNOWN,
                     ground=ground(0.1, 52.7, 0.015), films=False),
    TractionScenario(name='sand_unknown', title='sand, mu 0.35, unknown', legs=UNKNOWN,
                     ground=ground(0.35, 30.0, 0.16), films=False),
    TractionScenario(name='other_unknown', title='mu 0.2, unknown, other robot', legs=UNKNOWN,
                     ground=SLIPPERY, films=False, other=True),
    TractionScenario(name='other_ice', title='mu 0.1, unknown, other robot', legs=UNKNOWN,
                     ground=ground(0.1, 52.7, 0.015), films=False, other=True))
CONCRETE = ground(0.47, 52.7, 0.015)
HOSTILE = TractionScenario(
    name='concrete', title='concrete', films=False, ground=CONCRETE,
    legs=legs(('wait', 1.5, 0.0, 0.0), ('start', 1.5, 1.0, 0.0), ('stop', 2.5, 0.0, 0.0)))
RATES = (16.0, 100.0)  # Hz


def scenarios(seeds: Sequence[int]) -> list[TractionScenario]:
    """Return all runs of the benchmark: each scenario with and without traction control."""
    return [replace(scenario, wheel_rate=rate, seed=seed, traction=traction)
            for scenario in SCENARIOS for rate in RATES for traction in (False, True)
            for seed in seeds] + [
                replace(HOSTILE, wheel_rate=rate, seed=seed, fault=fault,
                        title=f'concrete, {fault}')
                for fault in FAULTS if fault for rate in RATES for seed in seeds]
