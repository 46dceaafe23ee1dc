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
Benchmark of ``smart_tire calibrate``: consistency of values and standard errors, and refusals.

``demo`` is the route of ``smart_tire demo``: turns on concrete, then on sand, in one recording.
``guided`` are the recordings of the steps that ``smart_tire calibrate --drive`` drives, on one
ground; latency, jitter, stiffness and the scale of the measured forward acceleration (pitching of
the body) differ between seeds. No wheel has films.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate
import math
from pathlib import Path
import sys
from tempfile import TemporaryDirectory

from benchmarks.harness import Benchmark, Column, figure_table, Job, percent, Range, Rows
from benchmarks.scoring import Errors, Figures, part_of, Run
import numpy as np
from rich.table import Table
from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.arrays import Array
from smart_tire.bags import BagWriter
from smart_tire.calibration.guide import Leg, LEGS
from smart_tire.calibration.priors import PRIORS
from smart_tire.identification.calibrate import calibrate_bags
from smart_tire.parameters import build, SimulatorParams
from smart_tire.samples import ImuSample, NS_PER_S, Odometry, WheelSlip
from smart_tire.simulation.offline import EPOCH_NS, Event, simulate
from smart_tire.simulation.robot import Robot

TRUTH_STREAM = 7            # of random numbers, not one of the simulator
SAND_DISTANCE = 6.2         # m in x or y, where the demo begins to turn on the sand
MAX_TRANSFER = 12.0         # s
TURNS: tuple[Leg, ...] = ((9.0, 120.0, 60.0), (9.0, 60.0, 120.0))
MAX_LATENCY = 0.03          # s, of the guided recordings
JITTER_RANGE = (0.0005, 0.002)  # s
STIFFNESS_SIGMA = 0.15      # of ln C_x
MIN_YAW_RATE = 0.1          # rad/s, of a turn
MIN_TRUE = 1e-9             # of a true value, for relative standard errors
TOPICS = ('imu/data', 'wheel_states')

NOTES = """\
Errors over standard errors of the identified parameters. identified: share of the seeds; NEES:
mean of the squared errors; 2 s.: share within two standard errors.
"""
POOLED = 'all, pooled'
RANGES = (Range('calibration: values within two standard errors, guided', 0.9, 1.0),
          Range('calibration: NEES of all values, guided', 0.2, 1.3))
SCORES = (percent('identified\n[%]', 'identified', 0), percent('2 s.\n[%]', 'within_two', 0),
          Column('NEES', 'nees', 2), Column('mean error\n[sigma]', 'mean', 2))


def leg_schedule(legs: Sequence[Leg]) -> tuple[list[Leg], float]:
    """Return legs as (start time [s], left, right), and the end time [s]."""
    times = list(accumulate((leg[0] for leg in legs), initial=0.0))
    return [(time, left, right) for time, (_, left, right) in zip(times, legs)], times[-1]


@dataclass(frozen=True)
class Simulated:
    """Recordings of the steps of a calibration, and the true values of the parameters."""

    events: dict[str, list[Event]]  # step -> messages
    truth: dict[str, float]


def demo(seed: int) -> Simulated:
    """Return the route of the demo as one recording."""
    first = _demo_legs(MAX_TRANSFER)
    time = first[1]
    scout = simulate(_params(seed), first[0], time)
    turned = leg_schedule(((2.5, 0.0, 0.0), *TURNS))[1]
    reached = next(_seconds(sample.stamp_ns) for _, _, sample in scout
                   if isinstance(sample, Odometry) and _seconds(sample.stamp_ns) > turned
                   and max(map(abs, sample.position)) > SAND_DISTANCE)
    legs, end = _demo_legs(reached - turned)
    params = _params(seed)
    events = simulate(params, legs, end)
    return Simulated({'mixed': events}, _truth(params, events))


def _demo_legs(transfer: float) -> tuple[list[Leg], float]:
    return leg_schedule(((2.5, 0.0, 0.0), *TURNS, (transfer, 120.0, 120.0), *TURNS,
                         (1.5, 0.0, 0.0)))


def guided(seed: int) -> Simulated:
    """Return the recordings of rest, straight and turns on one ground."""
    rng = np.random.default_rng([seed, TRUTH_STREAM])
    stiffness = 52.7 * math.exp(STIFFNESS_SIGMA * float(rng.standard_normal()))
    params = _params(seed, **{
        'encoder.latency': float(rng.uniform(0.0, MAX_LATENCY)),
        'encoder.stamp_jitter': float(rng.uniform(*JITTER_RANGE)),
        'ground.names': ['ground'], 'ground.friction': [0.47], 'ground.stiffness': [stiffness],
        'ground.drag': [0.015], 'ground.base': 'ground', 'ground.patches.names': []})
    steps = {'rest': LEGS['rest'], 'straight': (*LEGS['straight'], (1.0, 0.0, 0.0)),
             'turns': (*LEGS['turns'], (1.0, 0.0, 0.0))}
    legs, end = leg_schedule([leg for step in steps.values() for leg in step])
    scale = 1.0 + PRIORS['acceleration on straight lines'].sigma * float(rng.standard_normal())
    events = [_pitched(event, scale) for event in simulate(params, legs, end)]
    ends = np.cumsum([leg_schedule(step)[1] for step in steps.values()])
    parts = {name: [event for event in events if begin <= _seconds(event[2].stamp_ns) < end]
             for name, begin, end in zip(steps, (0.0, *ends[:-1]), (*ends[:-1], math.inf))}
    truth = _truth(params, parts['turns'])
    truth['imu.accel_noise'] *= math.sqrt(0.5 * (1.0 + scale ** 2))  # both axes, one scaled
    return Simulated(parts, truth)


ROUTES = {'demo': demo, 'guided': guided}


def write_bags(folder: Path, run: Simulated) -> dict[str, list[Path]]:
    """Write the recordings without ground truth to ``folder``; return step -> bags."""
    for step, events in run.events.items():
        with BagWriter(folder / step) as writer:
            for received, topic, sample in events:
                if topic in TOPICS:
                    writer.write_sample(topic, received, sample)
    return {step: [folder / step] for step in run.events}


def _params(seed: int, **values: object) -> SimulatorParams:
    return build(SimulatorParams, {'seed': seed, 'film.wheels': [], **values})


def _seconds(stamp_ns: int) -> float:
    return (stamp_ns - EPOCH_NS) / NS_PER_S


def _pitched(event: Event, scale: float) -> Event:
    """Return an event with the forward acceleration of a pitching body."""
    received, topic, sample = event
    if not isinstance(sample, ImuSample):
        return event
    x, y, z = sample.acceleration
    return received, topic, replace(sample, acceleration=(scale * x, y, z))


def _truth(params: SimulatorParams, events: Sequence[Event]) -> dict[str, float]:
    """Return the true value of each parameter; track and S are those of ``events``."""
    robot, own = params.robot, Robot(params)
    constants = own.motors._torque_constant
    yaw_rate, lateral, difference = _motion(events, params)
    turning = np.abs(yaw_rate) > MIN_YAW_RATE
    W = yaw_rate[turning]
    return {
        'imu.gyro_noise': robot.imu.gyro_noise, 'imu.accel_noise': robot.imu.accel_noise,
        'encoder.latency': robot.encoder.latency,
        'encoder.stamp_jitter': robot.encoder.stamp_jitter,
        'effective_track': float(np.sum(np.abs(difference[turning])) / np.sum(np.abs(W))),
        'icr_x': float(-np.sum(W * lateral[turning]) / np.sum(W * W)),
        'motor.torque_constant': float(np.mean(constants)),
        'tire.longitudinal_stiffness': params.ground.stiffness[0]}


def _motion(events: Sequence[Event], params: SimulatorParams) -> tuple[Array, Array, Array]:
    """Return true yaw rate, lateral speed, and difference of the surface speeds of the sides."""
    poses = {sample.stamp_ns: sample for _, _, sample in events if isinstance(sample, Odometry)}
    slips = {sample.stamp_ns: sample for _, _, sample in events if isinstance(sample, WheelSlip)}
    stamps = sorted(poses.keys() & slips.keys())
    yaw_rate = np.array([poses[stamp].angular[2] for stamp in stamps])
    lateral = np.array([poses[stamp].linear[1] for stamp in stamps])
    velocity = np.array([slips[stamp].slip_velocity for stamp in stamps])
    slip = 0.5 * (velocity[:, 1] + velocity[:, 3] - velocity[:, 0] - velocity[:, 2])
    return yaw_rate, lateral, slip + params.robot.track_width * yaw_rate


def calibrated_run(route: str, seed: int) -> list[Run]:
    """Return the errors of a simulated calibration, and why parameters were kept."""
    run = ROUTES[route](seed)
    with TemporaryDirectory() as folder:
        found = calibrate_bags(write_bags(Path(folder), run), EstimatorParams(), '').calibration
    errors: dict[str, Errors] = {}
    values: dict[str, float] = {}
    for name, true in run.truth.items():
        one = found.found.get(name)
        values[f'{name}.identified'] = float(one is not None and one.sigma is not None)
        if one is not None and one.sigma is not None:
            sigma = np.atleast_1d(one.sigma)
            errors[name] = Errors((np.atleast_1d(one.value) - true) / sigma, np.ones(1))
            values[f'{name}.sigma'] = float(sigma[0]) / max(abs(true), MIN_TRUE)
    return [Run(route, seed, errors, values, {
        name: why for name, why in found.kept.items() if name in run.truth})]


def jobs(route: str, seeds: Sequence[int], args: argparse.Namespace) -> list[Job]:
    """Return one job for each seed."""
    return [partial(calibrated_run, route, seed) for seed in seeds]


def tables(rows: Rows, args: argparse.Namespace) -> Iterator[Table]:
    """Yield the scores of each parameter and of all pooled, by route."""
    for route, figures in rows.items():
        lines = by_parameter(figures)
        yield figure_table(route, [*lines.items(), (POOLED, pooled(list(lines.values())))], SCORES)


def by_parameter(figures: Figures) -> dict[str, Figures]:
    """Return the figures of each parameter."""
    return {name.removesuffix('.identified'): part_of(figures, name.removesuffix('.identified'))
            for name in figures if name.endswith('.identified')}


def in_ranges(rows: Rows) -> list[tuple[Range, float]]:
    """Return the scores of the guided calibration, if it was run, with their ranges."""
    if 'guided' not in rows:
        return []
    found = pooled(list(by_parameter(rows['guided']).values()))
    return list(zip(RANGES, (found['within_two'], found['nees'])))


def pooled(parts: Sequence[Figures]) -> Figures:
    """Return the scores of all values; those of a parameter are means over its values."""
    known = [one for one in parts if one['identified']]
    weights = [one['identified'] for one in known]
    return {name: float(np.average([one[name] for one in known], weights=weights))
            for name in ('within_two', 'nees', 'mean')} if known else {}


CALIBRATION = Benchmark(
    'calibration', 'consistency and refusals of smart_tire calibrate', NOTES,
    {'demo': 'route of the demo', 'guided': 'steps of a guided calibration'}, jobs, tables,
    in_ranges=in_ranges)

if __name__ == '__main__':
    sys.exit(CALIBRATION.main())
