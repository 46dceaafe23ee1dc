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
Benchmark of robots drawn at random around the model of the estimators, and away from it.

The complete pipeline with the nominal parameters processes the messages of each robot.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
import math

from benchmarks.harness import (
    Benchmark, Column, figure_table, Job, milli, new_table, percent, Rows)
from benchmarks.robots.draws import DISTRIBUTIONS, draw, FILMS, ROWS, TORQUES, TUNING_SEED
from benchmarks.robots.histograms import draw_histograms
from benchmarks.robots.scoring import HEADING, LATERAL, OURS, POSITION, run_robot, SLIP, SPEED
from benchmarks.scoring import Figures, Run
from rich.table import Table
from smart_tire.analysis.dead_reckoning import GYRO_WHEELS, WHEELS_ONLY

NOTES = """\
Robots drawn at random. <: required. mu: relative error of the fused coefficient from the fifth
revolution on each ground, median and 90 % over crossings; est.: share of crossings with an
estimate. Slip while steady, speeds in motion: rms. 2 s.: share within two sigma; NEES: normalized
error squared; both means over robots. Path and heading: rms over whole drives; better: share of
robots with a path better than that of gyroscope + wheels.
"""
FRICTION = (percent('mu median\n[%]', 'mu.median'), percent('90 %\n[%]', 'mu.q90'),
            percent('<\n[%]', 'required.median', 0), percent('<\n[%]', 'required.q90', 0),
            percent('bias\n[%]', 'mu.bias'), percent('est.\n[%]', 'mu.finite', 0),
            percent('2 s.\n[%]', 'mu.within_two', 0), Column('NEES', 'mu.nees'),
            milli('CPU\n[ms/s]', 'load', 0))
MOTION = tuple(
    column for name, unit, digits, scale in (
        (SLIP, '', 4, 1.0), (SPEED, '\n[mm/s]', 1, 1e3), (LATERAL, '\n[mm/s]', 1, 1e3))
    for column in (
        Column(f'{name} rms{unit}', f'{name}.rms', digits, scale),
        Column(f'<{unit}', f'required.{name}', digits, scale),
        percent('2 s.\n[%]', f'{name}.within_two', 0), Column('NEES', f'{name}.nees')))

METHODS = OURS, GYRO_WHEELS, WHEELS_ONLY
POSES = (*(Column(f'{method}\npath [m]', f'{POSITION}, {method}.rms', 3) for method in METHODS),
         percent('better\n[%]', 'better', 0),
         *(milli(f'{method}\nheading [mrad]', f'{HEADING}, {method}.rms') for method in METHODS))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the choice of robots."""
    parser.add_argument('--tuning', action='store_true',
                        help=f'seeds for tuning: counted from {TUNING_SEED}')
    parser.add_argument('--known-radius', action='store_true',
                        help='give the true wheel radius to the estimators')
    parser.add_argument('--without', nargs='+', default=[], choices=(FILMS, TORQUES),
                        help='inputs that the estimators do not get')
    parser.add_argument('--nominal', nargs='+', default=[], choices=DISTRIBUTIONS,
                        metavar='PROPERTY', help='properties that are not drawn: '
                        + ', '.join(DISTRIBUTIONS))


def jobs(row: str, seeds: Sequence[int], args: argparse.Namespace) -> list[Job]:
    """Return one job for each robot."""
    first = TUNING_SEED - 1 if args.tuning else 0
    return [partial(run, row, first + seed, args.nominal, args.known_radius, args.without)
            for seed in seeds]


def run(row: str, seed: int, nominal: Sequence[str], known_radius: bool,
        without: Sequence[str]) -> list[Run]:
    """Return the results of one robot."""
    one = replace(draw(row, seed, nominal), without=without)
    return [run_robot(one.known_radius() if known_radius else one)]


def tables(rows: Rows, args: argparse.Namespace) -> Iterator[Table]:
    """Yield the tables of mu, of the motion, of the poses, and of what was drawn."""
    labeled = [(ROWS[name].title, figures | required(name)) for name, figures in rows.items()]
    yield figure_table('Friction', labeled, FRICTION)
    yield figure_table('Motion', labeled, MOTION)
    yield figure_table('Path and heading', labeled, POSES)
    drawn = new_table('Drawn', 'property', 'values', 'distribution', 'parameters', 'nominal',
                      'unit', 'origin')
    for name, one in DISTRIBUTIONS.items():
        low, high = one.parameters
        drawn.add_row(name, str(one.count), one.kind, f'{low:g}, {high:g}', f'{one.nominal:g}',
                      one.unit, one.origin)
    yield drawn


def required(name: str) -> Figures:
    """Return the required figures of a row; NaN if there are none."""
    row = ROWS[name]
    median, large = row.mu or (math.nan, math.nan)
    return {'required.median': median, 'required.q90': large, f'required.{SLIP}': row.slip,
            f'required.{SPEED}': row.speed, f'required.{LATERAL}': row.lateral}


ROBOTS = Benchmark(
    'robots', 'accuracy on robots drawn at random', NOTES,
    {name: row.title for name, row in ROWS.items()}, jobs, tables, add_arguments,
    draw_histograms)
