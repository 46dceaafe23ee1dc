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
Benchmark of friction: errors, ratio to the Cramer-Rao bound, and consistency.

Crossings synthesized from the exact model are estimated with the true slip, by the waveform and by
the method of paper B. Simulated runs are estimated by the complete pipeline with the default
parameters, with motor torques and with the efforts removed from the same messages.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from functools import partial
import math
import time

from benchmarks.events import inputs_of, truth_of, without_efforts
from benchmarks.friction.crossings import (
    absolute_errors, bounded_errors, convergence, COUNTED_FROM, FUSED, match_rows, on_one_surface,
    ratio_errors, relative_errors, revolutions_on_ground, Rows as Crossings, SINGLE,
    true_crossings, Truths)
from benchmarks.friction.grid import all_cases, Case, quick_cases
from benchmarks.friction.monte_carlo import run_case
from benchmarks.friction.paper_method import friction_from_peaks, MAPS
from benchmarks.friction.scenarios import GROUND_SCENARIOS, SURFACE_SCENARIOS
from benchmarks.harness import Benchmark, Column, figure_table, Job, milli, percent, Rows
from benchmarks.motion import (
    as_estimate, as_truth, Estimate, in_motion, Mask, slip_errors, speed_errors, steady_sides,
    Truth)
from benchmarks.scenarios import Scenario
from benchmarks.scoring import Errors, part_of, pooled, Run
import numpy as np
from rich.table import Table
from smart_tire.analysis.pipeline import EstimatorParams, Pipeline
from smart_tire.estimation import streams
from smart_tire.parameters import FrictionEstimatorParams, RobotParams, SlipEstimatorParams
from smart_tire.parameters.simulation import GroundParams
from smart_tire.reproduction.printed import two_peaks
from smart_tire.samples import Friction, NS_PER_S, Sample
from smart_tire.simulation.offline import Event

CROSSINGS = 'crossings'        # name of the synthesized crossings among the runs
COUNT, QUICK_COUNT = 400, 150  # crossings per case: 6 and 9 % error of a spread from quartiles
COUNTED_FROM_JUMP = 4          # revolution; the surfaces of mu_jumps are too short for five
NO_TORQUE, TORQUE = VARIANTS = 'no torque', 'torque'
MAX_STRAIGHT_RATE = 0.02       # rad/s, yaw rate while cruising straight
SCENARIOS = {**SURFACE_SCENARIOS, **GROUND_SCENARIOS}

NOTES = """\
Errors of mu and C_x are relative: median / 90 % quantile of absolute errors. bound: Cramer-Rao
bound of the standard deviation of mu from one crossing; sd: standard deviation from the
interquartile range, over the bound where that is below 10 %; 2 s.: share within two sigma; NEES:
normalized error squared, 1 if consistent, of single crossings for mu F_z / C_x without the sigmas
of C_x and load. revs: revolutions until the fused mu is within 10 %. Crossings on two surfaces are
not scored one by one. Two peaks: method of paper B without rejection, film 1, raw samples. With
and without torque crossings count from the fifth revolution after the start and after each change
of ground (mu jumps: from the fourth). v_y: rms while moving; slip: rms while steady; straight: rms
of the mean slip of both sides while cruising straight.
"""
CASES = (
    percent('bound\n[%]', 'bound'), percent('found\n[%]', 'found', 0),
    percent('finite\n[%]', 'single.finite', 0), percent('bias\n[%]', 'single.bias'),
    Column('sd over\nbound', 'bounded.spread', 2), Column('\nNEES', 'single.nees', 2),
    Column('\nms', 'ms'), *(
        column for which in MAPS for column in (
            percent(f'{which} map:\nbias [%]', f'{which}.bias', 0),
            percent('\n90 % [%]', f'{which}.q90', 0))))
SINGLES = (
    Column('true\nslip', 'slip', 2), percent('found\n[%]', 'found', 2),
    Column('\nfalse', 'false', 0), percent('single:\nmedian [%]', 'single.median'),
    percent('\n90 %', 'single.q90'), percent('\nfinite', 'single.finite', 0),
    percent('bound:\nbias [%]', 'bounded.bias'), Column('\nsd over', 'bounded.spread', 2),
    percent('fused:\nmedian [%]', 'fused.median'), percent('\n90 %', 'fused.q90'),
    Column('NEES:\nsingle', 'ratio.nees', 2), Column('\nfused', 'critical_slip.nees', 2),
    Column('adhe-\nsion', 'adhesion_ratio.nees', 2), Column('film\nslip', 'film_slip.nees', 2),
    Column('revs:\nstart', 'start.median', 0), Column('jump\nmost', 'jump.max', 0), *(
        column for which in MAPS for column in (
            percent(f'{which} map:\nbias [%]', f'{which}.bias', 0),
            percent('\n90 % [%]', f'{which}.q90', 0))))
FORCES = (
    percent('mu:\nmedian [%]', 'mu.median'), percent('\n90 %', 'mu.q90'),
    percent('\n2 s.', 'mu.within_two', 0), Column('\nNEES', 'mu.nees'),
    percent('C_x:\nmedian [%]', 'stiffness.median'), percent('\n90 %', 'stiffness.q90'),
    percent('\nbias', 'stiffness.bias'), percent('\n2 s.', 'stiffness.within_two', 0),
    Column('\nNEES', 'stiffness.nees'), milli('v_y\n[mm/s]', 'v_y.rms'),
    Column('slip:\nleft', 'slip_left.rms', 4), Column('\nright', 'slip_right.rms', 4),
    Column('\nstraight', 'straight.rms', 4), Column('revs:\nmedian', 'jump.median', 0),
    Column('\nmost', 'jump.max', 0), milli('CPU\n[ms/s]', 'load', 0))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the choice of methods."""
    parser.add_argument('--forces-only', action='store_true',
                        help='only estimates without and with torque, no comparison of methods')


def jobs(name: str, seeds: Sequence[int], args: argparse.Namespace) -> list[Job]:
    """Return the jobs of a scenario, or of the synthesized crossings."""
    if name != CROSSINGS:
        compare = not args.forces_only and name in SURFACE_SCENARIOS
        return [partial(run_scenario, name, seed, compare=compare) for seed in seeds]
    count = QUICK_COUNT if args.quick else COUNT
    return [partial(run_cases, title, case, count) for title, case in cases(args.quick)]


def cases(quick: bool) -> Iterator[tuple[str, Case]]:
    """Yield the title and the parameters of the synthesized crossings."""
    for group, found in (quick_cases() if quick else all_cases()).items():
        for case in found:
            yield (f'{group}: slip {case.slip:+.2f}, mu {case.mu:.2f}, {case.rpm:.0f} rpm, '
                   f'{1e3 * case.noise:.0f} mV'), case


def run_cases(title: str, case: Case, count: int) -> list[Run]:
    """Return the scores of a case."""
    return [run_case(f'{CROSSINGS}/{title}', case, count)]


def run_scenario(name: str, seed: int, *, compare: bool) -> list[Run]:
    """Simulate one run and score it without and with torque."""
    scenario = SCENARIOS[name]
    events, robot = scenario.events(seed), scenario.robot
    records = truth_of(events)
    truths = {wheel: true_crossings(records, robot, wheel) for wheel in robot.film.wheels}
    truth, found = as_truth(records, robot), list[Run]()
    for variant in VARIANTS:
        samples = inputs_of(events)
        begin = time.thread_time()
        estimates = _estimates(samples if variant == TORQUE else without_efforts(samples), robot)
        spent = (time.thread_time() - begin) / ((events[-1][0] - events[0][0]) / NS_PER_S)
        frictions = [one for one in estimates if isinstance(one, Friction)]
        rows = {wheel: match_rows(true, frictions, wheel) for wheel, true in truths.items()}
        found += force_runs(scenario, seed, variant, list(rows.values()),
                            motion_errors(as_estimate(estimates), truth, _first(name)), spent)
    if compare:
        found += [single_run(name, seed, own, truths[wheel], robot, wheel, events)
                  for wheel, own in rows.items()]  # with torque, the last of VARIANTS
    return found


def _first(name: str) -> int:
    return COUNTED_FROM_JUMP if name == 'mu_jumps' else COUNTED_FROM


def _estimates(samples: Sequence[Sample], robot: RobotParams) -> list[Sample]:
    pipeline = Pipeline(EstimatorParams(
        SlipEstimatorParams(robot=robot), FrictionEstimatorParams(robot=robot)))
    found = [estimate for sample in samples for estimate in pipeline.update(sample)]
    return [*found, *pipeline.finish()]


def force_runs(scenario: Scenario, seed: int, variant: str, wheels: Sequence[Crossings],
               motion: dict[str, Errors], load: float) -> Iterator[Run]:
    """Yield errors of mu and C_x of a run, with its motion, and on each of several grounds."""
    counted = [revolutions_on_ground(rows) >= _first(scenario.name) for rows in wheels]
    present = [name for name in scenario.ground.names if any(
        (mask & _on(scenario.ground, name, rows)).any() for mask, rows in zip(counted, wheels))]
    jumps = [revolutions for rows in wheels for revolutions in convergence(rows)[1:]]
    for name in ('', *(present if len(present) > 1 else ())):
        errors = {what: pooled([
            relative_errors(rows, quantity, mask & _on(scenario.ground, name, rows))
            for rows, mask in zip(wheels, counted)])
            for what, quantity in (('mu', FUSED), ('stiffness', 'stiffness'))}
        if not name:
            errors |= {**motion, 'jump': Errors.without_sigma(jumps)}
        yield Run(f'{scenario.name}/{name}', seed,
                  {f'{variant}.{what}': one for what, one in errors.items()},
                  {} if name else {f'{variant}.load': load})


def _on(ground: GroundParams, name: str, rows: Crossings) -> Mask:
    """Return which crossings (n,) are on the surface ``name``, or all."""
    if not name:
        return np.ones(len(rows.found), bool)
    i = ground.names.index(name)
    return np.asarray(np.isclose(rows.true[FUSED], ground.friction[i], rtol=1e-3)
                      & np.isclose(rows.true['stiffness'], ground.stiffness[i], rtol=1e-3))


def motion_errors(estimate: Estimate, truth: Truth, first: int) -> dict[str, Errors]:
    """Return the errors of slip while steady and straight, and of v_y from a revolution on."""
    steady, (error, sigma) = steady_sides(truth), slip_errors(estimate, truth)
    speed = np.abs(truth.rolling).mean(axis=1)
    rolled = np.concatenate([[0.0], np.cumsum(speed[1:] * np.diff(truth.stamp_ns) / NS_PER_S)])
    late = rolled > math.tau * truth.radius * first
    straight = late & steady.all(axis=1) & (np.abs(truth.poses.twist[:, 2]) < MAX_STRAIGHT_RATE)
    return {'slip_left': Errors(error[steady[:, 0], 0], sigma[steady[:, 0], 0]),
            'slip_right': Errors(error[steady[:, 1], 1], sigma[steady[:, 1], 1]),
            'straight': Errors(error[straight].mean(axis=1), sigma[straight].mean(axis=1)),
            'v_y': speed_errors(estimate, truth, 1, late & in_motion(truth))}


def single_run(name: str, seed: int, rows: Crossings, truths: Truths, robot: RobotParams,
               wheel: str, events: Sequence[Event]) -> Run:
    """Return the errors of all crossings of a wheel, by the waveform and from two peaks."""
    one = on_one_surface(rows)
    start, *jumps = convergence(rows) or [math.nan]
    errors = {'single': relative_errors(rows, SINGLE, one),
              'fused': relative_errors(rows, FUSED, one), 'ratio': ratio_errors(rows, one),
              'bounded': bounded_errors(rows, truths, robot, one),
              'start': Errors.without_sigma([start]), 'jump': Errors.without_sigma(jumps),
              **{what: absolute_errors(rows, what, one)
                 for what in ('critical_slip', 'adhesion_ratio', 'film_slip')}}
    inputs = [sample for _, topic, sample in events
              if streams.FRICTION.inputs.get(type(sample)) == topic]
    for which in MAPS:
        found = two_peaks(inputs, FrictionEstimatorParams(robot=robot), which)
        peaks = match_rows(truths, found, wheel)
        errors[which] = Errors.without_sigma(friction_from_peaks(
            peaks.value['peak_interval'], peaks.speed, peaks.value['total_slip'],
            peaks.value['normal_load'], robot, which) / peaks.true[SINGLE] - 1.0)
    return Run(f'{name}/{wheel}', seed, errors, {
        'slip': float(np.median(rows.true['slip'][one])), 'found': float(np.mean(rows.found)),
        'false': float(rows.false)})


def tables(rows: Rows, args: argparse.Namespace) -> Iterator[Table]:
    """Yield the tables of synthesized crossings, of single crossings, and of the torques."""
    own = {row.removeprefix(f'{CROSSINGS}/'): figures for row, figures in rows.items()
           if row.startswith(f'{CROSSINGS}/')}
    if own:
        yield figure_table('Synthesized crossings, with the true slip', own.items(), CASES)
    runs = [(row.partition('/')[0], row.partition('/')[2], figures)
            for row, figures in rows.items() if not row.startswith(f'{CROSSINGS}/')]
    singles = [(f'{SCENARIOS[run].title}, {part.replace("_", " ")}', figures)
               for run, part, figures in runs if 'single.median' in figures]
    if singles:
        yield figure_table('Crossings of simulated runs', singles, SINGLES)
    forces = [(f'{SCENARIOS[run].title}{part and f", on {part}"}: {variant}',
               part_of(figures, variant))
              for run, part, figures in runs for variant in VARIANTS
              if f'{variant}.mu.median' in figures]
    if forces:
        yield figure_table('Friction and motion, without and with torque', forces, FORCES)


FRICTION = Benchmark(
    'friction', 'accuracy of friction, compared with the method of paper B', NOTES,
    {CROSSINGS: 'synthesized crossings',
     **{name: scenario.title for name, scenario in SCENARIOS.items()}}, jobs, tables,
    add_arguments)
