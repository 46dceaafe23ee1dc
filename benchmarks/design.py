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
The bound of ``smart_tire design`` next to the errors of the friction estimator.

Robots are drawn as in ``benchmarks.robots``, by default within the model of the estimator, with
the films of each layout. Ground, torques and gains of the films are drawn from the priors of the
estimator: those that ``benchmarks.robots`` draws are closer to the nominal ones. mu and slip are
those of the crossings in the last seconds of a drive, of all wheels with films; slip of the films
and contact length are those that each crossing shows alone. Crossings in changes of wheel speed do
not count: the slip varies by more than its error while a film is in the patch, and mean and
instant differ.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
import math
import sys

from benchmarks.friction.crossings import FUSED, match_rows, true_crossings
from benchmarks.grounds import ground as surfaces
from benchmarks.harness import Benchmark, Column, figure_table, Job, percent, Rows
from benchmarks.motion import MIN_STEADY_DISTANCE
from benchmarks.robots.draws import Draw, draw, TORQUES
from benchmarks.scoring import Errors, Run
import numpy as np
from rich.table import Table
from smart_tire.arrays import Array, Instants
from smart_tire.design.drive import AVERAGED, DriveInformation, DRIVES, DriveSchedule, Ground
from smart_tire.design.layout import Accuracy, FilmLayout, LENGTH_SIGMA, Study
from smart_tire.estimation.friction.estimator import EvaluatedCrossing, FrictionEstimator
from smart_tire.estimation.friction.waveform_method import WaveformMethod
from smart_tire.estimation.friction.waveform_model import Shared
from smart_tire.estimation.ground.unknowns import HOP, MOTOR_SCALE_SIGMA, priors, Unknown
from smart_tire.models.vehicle.drive import torque_errors
from smart_tire.parameters import FrictionEstimatorParams, RobotParams
from smart_tire.samples import Friction, NS_PER_S, Sample
from smart_tire.simulation.offline import EPOCH_NS

PAPER = FilmLayout.of(RobotParams())
ROW = 'slow_turn'  # of benchmarks.robots
MAX_SIGMAS = 2.0   # of what is drawn from the priors
# properties of drawn robots that the model of the estimator does not have
AWAY = ('fall', 'relaxation_length', 'load_transfer_time', 'bump_distance', 'bump_width',
        'bump_shape')
QUANTITIES = {'friction': 'mu', 'slip': 'slip', 'film_slip': 'slip of the films',
              'contact_length': 'contact length'}
NOTES = """\
Standard deviation by the bound of smart_tire design, rms error of the estimator on robots drawn at
random, and the rms of their ratio. mu and contact length: of their logarithms; all in 0.01.
"""


@dataclass(frozen=True)
class Point:
    """A layout on a drive."""

    title: str
    layout: FilmLayout = PAPER
    drive: str = 'turn'
    torque: bool = True


POINTS: Mapping[str, Point] = {
    'paper': Point('paper B: 2 x 20 mm, 30 mm apart, 400 Hz, 10 bits'),
    'paper_fast': Point('the same, 120/60 rpm', drive='fast_turn'),
    'paper_curves': Point('the same, S-curves', drive='s_curves'),
    'paper_no_torque': Point('the same, without torque', torque=False),
    'apart': Point('2 films, 140 mm apart', replace(PAPER, spacing=0.140)),
    'one_film': Point('1 x 20 mm', replace(PAPER, films=1)),
    'two_wheels': Point('1 x 12 mm on 2 wheels', replace(PAPER, wheels=2, films=1, length=0.012)),
    'best': Point('1 x 8 mm on 2 wheels, 360 Hz, 8 bits, best of two films', replace(
        PAPER, wheels=2, films=1, length=0.008, rate=360.0, bits=8)),
    'four_wheels': Point('2 x 20 mm on 4 wheels', replace(PAPER, wheels=4)),
    'coarse': Point('2 x 20 mm, 150 Hz, 8 bits', replace(PAPER, rate=150.0, bits=8))}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the choice of robots."""
    parser.add_argument('--away', action='store_true',
                        help='also draw what the model does not have: ' + ', '.join(AWAY))


def jobs(name: str, seeds: Sequence[int], args: argparse.Namespace) -> list[Job]:
    """Return one job for each robot."""
    return [partial(run_point, name, seed, () if args.away else AWAY) for seed in seeds]


def bound(point: Point, ground: Ground) -> Accuracy:
    """Return the bound of a point on ``ground``, of the wheels with films."""
    drive = DriveInformation(RobotParams(), ground, DRIVES[point.drive], point.torque)
    return Study([drive], wheels=point.layout.names).accuracy(point.layout)


def drawn(seed: int, nominal: Sequence[str]) -> tuple[Draw, Ground]:
    """Return a robot whose ground and torques are drawn from the priors, and the ground."""
    one, rng = draw(ROW, seed, nominal), np.random.default_rng([seed, 4])
    rows = [priors(one.robot)[i] for i in (
        Unknown.STIFFNESS, Unknown.FRICTION, Unknown.RESISTANCE)]
    size = np.clip(rng.standard_normal(len(rows)), -MAX_SIGMAS, MAX_SIGMAS)
    stiffness, friction, drag = (math.exp(row.mean + row.sigma * part)
                                 for row, part in zip(rows, size.tolist()))
    ground, motor = Ground('drawn', stiffness, friction, drag), one.robot.motor
    simulator = replace(
        one.simulator, ground=surfaces(ground.name, {ground.name: (friction, stiffness, drag)}),
        errors=replace(one.simulator.errors, torque_constant=motor.torque_constant_sigma,
                       torque_constant_spread=MOTOR_SCALE_SIGMA,
                       torque_offset=torque_errors(motor)[1]))
    return replace(one, simulator=simulator), ground


def is_counted(drive: DriveSchedule, stamp_ns: Instants) -> Array:
    """Return which crossings (n,) are late and far from any change of the set points."""
    time = (stamp_ns - EPOCH_NS) / NS_PER_S
    steady = [np.abs(time - start) > MIN_STEADY_DISTANCE for start, _, _ in drive.legs]
    return np.all([time > drive.duration - AVERAGED * HOP, *steady], axis=0)


def run_point(name: str, seed: int, nominal: Sequence[str] = AWAY) -> list[Run]:
    """Return the errors with one drawn robot, with the bound as their standard deviation."""
    point = POINTS[name]
    robot, drive = point.layout.robot(RobotParams()), DRIVES[point.drive]
    one, ground = drawn(seed, nominal)
    factors = 1.0 + robot.film.stretch_gain_tolerance * np.random.default_rng(
        [seed, 3]).standard_normal(point.layout.films * point.layout.wheels)
    true = replace(one.true, film=replace(robot.film, stretch_gain=tuple(
        np.multiply(factors, robot.film.stretch_gain * point.layout.wheels).tolist())))
    radio = one.simulator.radio
    one = replace(one, simulator=replace(one.simulator, robot=true), legs=drive.legs,
                  duration=drive.duration, without=() if point.torque else (TORQUES,))
    evaluated: list[EvaluatedCrossing] = []
    estimator = FrictionEstimator(FrictionEstimatorParams(
        robot=robot, reorder_window=max(  # samples of a packet arrive with its last one
            FrictionEstimatorParams.reorder_window, radio.batch / robot.film.sample_rate
            + radio.max_delay)), evaluated.append)
    for sample in one.inputs():
        estimator.update(sample)
    estimator.finish()
    least = bound(point, ground)
    errors = _errors(one.truth(), [each.friction for each in evaluated], true, drive)
    errors['contact_length'] = np.array([value for wheel in point.layout.names
                                         for value in _lengths(evaluated, wheel, robot, drive)])
    return [Run(name, seed, {
        quantity: Errors(found, np.full(len(found), getattr(least, quantity)))
        for quantity, found in errors.items()}, {
            f'bound.{key}': value for key, value in least._asdict().items()})]


def _errors(truth: Sequence[Sample], frictions: Sequence[Friction], robot: RobotParams,
            drive: DriveSchedule) -> dict[str, Array]:
    """Return errors of ln mu and of slips at the end of the drive, of all wheels."""
    found: dict[str, list[Array]] = {'friction': [], 'slip': [], 'film_slip': []}
    for wheel in robot.film.wheels:
        rows = match_rows(true_crossings(truth, robot, wheel), frictions, wheel)
        counted = is_counted(drive, rows.stamp_ns)
        for quantity, name in ('friction', FUSED), ('slip', 'slip'), ('film_slip', 'film_slip'):
            value, true = rows.value[name][counted], rows.true[name][counted]
            found[quantity].append(
                np.log(value / true) if quantity == 'friction' else value - true)
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _lengths(evaluated: Sequence[EvaluatedCrossing], wheel: str, robot: RobotParams,
             drive: DriveSchedule) -> Iterator[float]:
    """Yield the error of ln of the contact length of each counted crossing, if it is unknown."""
    method = WaveformMethod(wheel, robot, LENGTH_SIGMA)
    own = [one for one in evaluated if one.friction.wheel == wheel]
    counted = is_counted(drive, np.array([one.crossing.stamp_ns for one in own]))
    for one, counts in zip(own, counted.tolist()):
        if (result := method.measure(one.crossing)) is not None and result.waveform and counts:
            yield result.waveform.shared(Shared.LENGTH).value


def tables(rows: Rows, args: argparse.Namespace) -> Iterator[Table]:
    """Yield the table of bounds and errors."""
    shown = [(POINTS[name].title, figures | {
        f'ratio.{one}': math.sqrt(figures[f'{one}.nees']) for one in QUANTITIES})
        for name, figures in rows.items()]
    yield figure_table('Bound and errors', shown, [column for one, title in QUANTITIES.items()
                       for column in (
                           percent(f'{title}:\nbound', f'bound.{one}', 2),
                           percent('\nrms', f'{one}.rms', 2), Column('\nratio', f'ratio.{one}', 2),
                           percent('\nknown [%]', f'{one}.finite', 0))])


DESIGN = Benchmark(
    'design', 'the bound of smart_tire design, next to the errors of the estimator', NOTES,
    {name: point.title for name, point in POINTS.items()}, jobs, tables, add_arguments)

if __name__ == '__main__':
    sys.exit(DESIGN.main())
