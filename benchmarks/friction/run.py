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
parameters.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from functools import partial
import math

from benchmarks.events import inputs_of, truth_of
from benchmarks.friction.crossings import (
    absolute_errors, bounded_errors, convergence, FUSED, match_rows, on_one_surface, ratio_errors,
    relative_errors, Rows as Crossings, SINGLE, true_crossings, Truths)
from benchmarks.friction.grid import all_cases, Case, quick_cases
from benchmarks.friction.monte_carlo import run_case
from benchmarks.friction.paper_method import friction_from_peaks, MAPS
from benchmarks.friction.scenarios import FRICTION_SCENARIOS
from benchmarks.harness import Benchmark, Column, figure_table, Job, percent, Rows
from benchmarks.scoring import Errors, Run
import numpy as np
from rich.table import Table
from smart_tire.analysis.pipeline import EstimatorParams, Pipeline
from smart_tire.estimation import streams
from smart_tire.papers.printed import two_peaks
from smart_tire.parameters import FrictionEstimatorParams, RobotParams, SlipEstimatorParams
from smart_tire.samples import Friction
from smart_tire.simulation.offline import Event

CROSSINGS = 'crossings'        # name of the synthesized crossings among the runs
COUNT, QUICK_COUNT = 400, 150  # crossings per case: 6 and 9 % error of a spread from quartiles

NOTES = """\
Errors of mu and C_x are relative: median / 90 % quantile of absolute errors. bound: Cramer-Rao
bound of the standard deviation of mu from one crossing; sd: standard deviation from the
interquartile range, over the bound where that is below 10 %; 2 s.: share within two sigma; NEES:
normalized error squared, 1 if consistent, of single crossings for mu F_z / C_x without the sigmas
of C_x and load. revs: revolutions until the fused mu is within 10 %. Crossings on two surfaces are
not scored one by one. Two peaks: method of paper B without rejection, film 1, raw samples.
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


def jobs(name: str, seeds: Sequence[int], args: argparse.Namespace) -> list[Job]:
    """Return the jobs of a scenario, or of the synthesized crossings."""
    if name != CROSSINGS:
        return [partial(run_scenario, name, seed) for seed in seeds]
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


def run_scenario(name: str, seed: int) -> list[Run]:
    """Simulate one run and score the crossings of each wheel with films."""
    scenario = FRICTION_SCENARIOS[name]
    events, robot = scenario.events(seed), scenario.robot
    pipeline = Pipeline(EstimatorParams(
        SlipEstimatorParams(robot=robot), FrictionEstimatorParams(robot=robot)))
    estimates = [*(one for sample in inputs_of(events) for one in pipeline.update(sample)),
                 *pipeline.finish()]
    frictions = [one for one in estimates if isinstance(one, Friction)]
    truths = {wheel: true_crossings(truth_of(events), robot, wheel)
              for wheel in robot.film.wheels}
    return [single_run(name, seed, match_rows(truth, frictions, wheel), truth, robot, wheel,
                       events) for wheel, truth in truths.items()]


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
    """Yield the tables of synthesized crossings and of crossings of simulated runs."""
    own = {row.removeprefix(f'{CROSSINGS}/'): figures for row, figures in rows.items()
           if row.startswith(f'{CROSSINGS}/')}
    if own:
        yield figure_table('Synthesized crossings, with the true slip', own.items(), CASES)
    singles = [(f'{FRICTION_SCENARIOS[run].title}, {wheel.replace("_", " ")}', figures)
               for row, figures in rows.items() for run, wheel in [row.split('/', 1)]
               if run != CROSSINGS]
    if singles:
        yield figure_table('Crossings of simulated runs', singles, SINGLES)


FRICTION = Benchmark(
    'friction', 'accuracy of friction, compared with the method of paper B', NOTES,
    {CROSSINGS: 'synthesized crossings',
     **{name: scenario.title for name, scenario in FRICTION_SCENARIOS.items()}}, jobs, tables)
