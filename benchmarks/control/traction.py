# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Starts and stops on slippery ground, with and without traction control.

The estimators and the wheel controller run in the loop (``closed_loop``). Ground that
was measured before is that of a gentle lap with films; unknown ground is the first start of a
robot without films. With a fault, estimates are replaced by wrong ones. The other robot has tires
with a falling friction curve and another mass; the software does not know.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import accumulate
import math

from benchmarks.control.closed_loop import run_closed_loop
from benchmarks.control.other_plant import other_robot, OtherPlant, peak_slip
from benchmarks.control.robot_stack import RobotStack
from benchmarks.control.wrong_estimates import FAULTS
from benchmarks.scoring import Run
import numpy as np

from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.arrays import Array
from smart_tire.models.tire.brush_tire import critical_slip
from smart_tire.parameters import (
    FrictionEstimatorParams, RobotParams, SimulatorParams, SlipEstimatorParams,
    WheelControllerParams)
from smart_tire.parameters.control import TractionParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.parameters.simulation import PatchParams, SurfaceParams
from smart_tire.samples import Four, GRAVITY, NS_PER_S, VelocityCommand
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
SCORED_SPEED = 1.2     # m/s, up to which starts count; then the command limits the slip
MIN_SLIDING_SPEED, MIN_SPEED = 0.05, 0.2  # m/s, of the tread and of the robot, for slip to count
TURNING_SPEED = 0.05   # m/s, rolling speed of a wheel that turns


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
    ground: SurfaceParams
    films: bool = True        # whether the wheels of the front axle have films
    wheel_rate: float = 16.0  # Hz, of wheel_states and of the controller
    seed: int = 1
    traction: bool = True     # whether traction control is enabled
    other: bool = False       # whether the plant is the other robot
    fault: str = ''           # key of FAULTS: wrong estimates

    @property
    def robot(self) -> RobotParams:
        """Return the parameters of the robot."""
        return RobotParams(film=TreadFilmParams(wheels=FILM_WHEELS if self.films else ()))


@dataclass(frozen=True)
class TractionHistory:
    """True motion; arrays over (time,) or (time, wheel)."""

    time: Array       # s
    x: Array          # m
    y: Array          # m
    yaw: Array        # rad
    v_x: Array        # m/s
    rolling: Array    # m/s, r w
    wheel_v_x: Array  # m/s
    wheel_v_y: Array  # m/s
    friction: Array   # -
    critical_slip: Array  # -, of full sliding, or of the largest force

    @property
    def slip(self) -> Array:
        """Return the magnitude of the slip; 0 where the wheels do not turn."""
        return self.tread_speed / np.maximum(np.abs(self.rolling), 1e-3)

    @property
    def tread_speed(self) -> Array:
        """Return the speed [m/s] of the treads over the ground."""
        return np.hypot(self.rolling - self.wheel_v_x, self.wheel_v_y)

    def between(self, begin: float, end: float) -> TractionHistory:
        """Return the part of the history between two times [s]."""
        chosen = (self.time >= begin) & (self.time < end)
        return TractionHistory(*(getattr(self, one.name)[chosen] for one in fields(self)))


class PlantLog:
    """Adds the state of the plant at every second call."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []
        self._count = 0

    def __call__(self, plant: Plant) -> None:
        """Add the present state of the plant at every LOG_STEPS-th call."""
        self._count += 1
        if self._count % LOG_STEPS == 0:
            self.rows.append((
                1e-9 * plant.time_ns, plant.x, plant.y, plant.yaw, plant.v_x, *plant.wheel_speed,
                *plant.wheel_v_x, *plant.wheel_v_y, *plant.load,
                *(surface.friction for surface in plant.surface),
                *(surface.stiffness for surface in plant.surface)))

    def history(self, radius: float, critical: Callable[[Array, Array, Array], Array]
                ) -> TractionHistory:
        """Return the logged states; ``critical`` gives the slip of the largest force."""
        table = np.array(self.rows)
        omega, v_x, v_y, load, friction, stiffness = table[:, 5:].reshape(
            len(table), 6, 4).transpose(1, 0, 2)
        time, x, y, yaw, speed = table[:, :5].T
        return TractionHistory(time, x, y, yaw, speed, radius * omega, v_x, v_y, friction,
                               critical(friction, load, stiffness))


class TractionStack(RobotStack):
    """Software of the robot, driven by the legs of a scenario."""

    def __init__(self, scenario: TractionScenario) -> None:
        robot = scenario.robot
        super().__init__(
            EstimatorParams(SlipEstimatorParams(robot=robot),
                            FrictionEstimatorParams(robot=robot)),
            WheelControllerParams(rate=scenario.wheel_rate, robot=robot,
                                  traction=TractionParams(enabled=scenario.traction)),
            fault=FAULTS[scenario.fault])
        self._legs = scenario.legs
        self._ends = list(accumulate(leg.duration for leg in scenario.legs))
        self._start_ns: int | None = None
        self.begins: list[float] = []  # s, first control step of each leg, since the start

    def duty(self, now_ns: int) -> Four:
        """Return the duties for the command in force."""
        time = self._elapsed(now_ns)
        number = sum(end <= time for end in self._ends)
        leg = self._legs[min(number, len(self._legs) - 1)]
        if len(self.begins) <= number:
            self.begins.append(time)
        command = VelocityCommand(now_ns, leg.v_x, leg.yaw_rate)
        return self._wheels.follow(command, now_ns, now_ns)[1]

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


def run(scenario: TractionScenario) -> TractionRun:
    """Return a run of a scenario."""
    stack, log = TractionStack(scenario), PlantLog()
    robot = other_robot(scenario.robot) if scenario.other else scenario.robot
    simulator = SimulatorParams(seed=scenario.seed, ground=scenario.ground, robot=robot)
    run_closed_loop(simulator, stack, sum(leg.duration for leg in scenario.legs) + 1.0,
                    wheel_rate=scenario.wheel_rate, control_rate=scenario.wheel_rate, watch=log,
                    plant=OtherPlant if scenario.other else Plant)
    return TractionRun(scenario, tuple(stack.begins[:len(scenario.legs)]), log.history(
        scenario.robot.wheel_radius, peak_slip if scenario.other else critical_slip))


def traction_runs(scenario: TractionScenario) -> Iterator[Run]:
    """Yield the scores of each start and stop of a run."""
    found = run(scenario)
    for leg, part in found.legs():
        if leg.kind in ('start', 'stop'):
            drift, turn = _drift(part)
            against, beyond, stopped = _bounds(leg, part)
            kind = 'with' if scenario.traction else 'without'
            yield Run(f'{scenario.title}, {scenario.wheel_rate:g} Hz, {kind} traction control: '
                      f'{leg.kind}', scenario.seed, {}, {
                          'distance': _distance(found, leg, part), 'drift': drift,
                          'sliding': longest_sliding(part), 'turn': abs(turn),
                          'against': against, 'beyond': beyond, 'stopped': stopped})


def longest_sliding(part: TractionHistory) -> float:
    """Return the longest time [s] for which one wheel is above its critical slip."""
    sliding = ((part.slip > part.critical_slip) & (part.tread_speed > MIN_SLIDING_SPEED)
               & (np.abs(part.v_x) > MIN_SPEED)[:, np.newaxis])
    return float(max(map(_longest, sliding.T)) * np.median(np.diff(part.time)))


def _longest(flags: Array) -> int:
    """Return the length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    return int(max(edges[1::2] - edges[::2], default=0))


def _bounds(leg: Leg, part: TractionHistory) -> tuple[int, float, float]:
    """Return how often wheels turn against the command, how far beyond it, and until when."""
    forward = part.rolling * np.sign(leg.v_x or part.v_x[0])
    wrong = (forward < -TURNING_SPEED).astype(int)
    against = int(np.sum(np.diff(wrong, axis=0) > 0))
    beyond = float((forward - (abs(leg.v_x) or forward[0])).max())
    if leg.v_x:
        return against, beyond, math.nan
    turning = np.flatnonzero((np.abs(part.rolling) > TURNING_SPEED).any(axis=1))
    last = int(turning[-1]) if len(turning) else 0
    return against, beyond, float(part.time[last] - part.time[0])


def _distance(result: TractionRun, leg: Leg, part: TractionHistory) -> float:
    """Return the distance of a start over that of full friction; the inverse for a stop."""
    friction = float(part.friction.mean())
    if leg.kind == 'stop':
        shortest = part.v_x[0] ** 2 / (2.0 * GRAVITY * (friction + result.scenario.ground.drag[0]))
        return float(shortest / max(_path(part)[-1], 1e-6))
    acceleration = GRAVITY * (part.friction.mean(axis=1) - result.scenario.ground.drag[0])
    speed = np.cumsum(acceleration[:-1] * np.diff(part.time))
    end = int(np.searchsorted(speed, SCORED_SPEED))
    if end >= len(speed):
        return math.nan
    return float(_path(part)[end] / np.sum(speed[:end] * np.diff(part.time)[:end]))


def _path(part: TractionHistory) -> Array:
    """Return the distance [m] traveled since the beginning."""
    steps = np.hypot(np.diff(part.x), np.diff(part.y))
    return np.concatenate(([0.0], np.cumsum(steps)))


def _drift(part: TractionHistory) -> tuple[float, float]:
    """Return the largest lateral deviation [m] and the change of heading [rad]."""
    yaw = part.yaw[0]
    lateral = math.cos(yaw) * (part.y - part.y[0]) - math.sin(yaw) * (part.x - part.x[0])
    return float(np.abs(lateral).max()), float(part.yaw[-1] - yaw)


def ground(friction: float, stiffness: float, drag: float, *, right: float | None = None,
           beyond: float | None = None) -> SurfaceParams:
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
    return SurfaceParams(names=('base', 'other'), friction=(friction, other),
                         stiffness=(stiffness,) * 2, drag=(drag,) * 2, base='base',
                         patches=tuple(patches))


def legs(*parts: tuple[str, float, float, float]) -> tuple[Leg, ...]:
    """Return legs from (kind, duration [s], v_x [m/s], yaw rate [rad/s])."""
    return tuple(Leg(*part) for part in parts)


KNOWN, UNKNOWN = legs(WAIT, LAP, REST, START, STOP), legs(WAIT, START, STOP)
SHUTTLED = legs(WAIT, *SHUTTLE, *SHUTTLE, START, STOP)
SLIPPERY, SOFT = ground(0.2, 52.7, 0.015), ground(0.2, 30.0, 0.05)
SPLIT = ground(0.2, 52.7, 0.015, right=SPLIT_FRICTION)
ICE, SAND = ground(0.1, 52.7, 0.015), ground(0.35, 30.0, 0.16)
SCENARIOS = tuple(
    TractionScenario(name=name, title=title, legs=parts, ground=surface, films=parts != UNKNOWN,
                     other=name.startswith('other'))
    for name, title, parts, surface in (
        ('slippery', 'mu 0.2, measured', KNOWN, SLIPPERY),
        ('slippery_unknown', 'mu 0.2, unknown', UNKNOWN, SLIPPERY),
        ('soft', 'mu 0.2, soft, measured', KNOWN, SOFT),
        ('soft_unknown', 'mu 0.2, soft, unknown', UNKNOWN, SOFT),
        ('split', 'mu 0.2 left, 0.17 right, measured', SHUTTLED, SPLIT),
        ('split_unknown', 'mu 0.2 left, 0.17 right, unknown', UNKNOWN, SPLIT),
        ('change', 'mu 0.47, then 0.2, unknown', UNKNOWN,
         ground(0.47, 52.7, 0.015, beyond=0.2)),
        ('ice_unknown', 'mu 0.1, unknown', UNKNOWN, ICE),
        ('sand_unknown', 'sand, mu 0.35, unknown', UNKNOWN, SAND),
        ('other_unknown', 'mu 0.2, unknown, other robot', UNKNOWN, SLIPPERY),
        ('other_ice', 'mu 0.1, unknown, other robot', UNKNOWN, ICE)))
CONCRETE = ground(0.47, 52.7, 0.015)
HOSTILE = TractionScenario(
    name='concrete', title='concrete', ground=CONCRETE,
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
