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
Benchmark of slip and pose: errors and their consistency with the reported covariance.

The slip estimator, its smoother and other methods process simulated scenarios over several seeds,
and recordings of other robots (``recordings``).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from benchmarks.events import inputs_of, truth_of
from benchmarks.harness import Benchmark, Column, DATA, figure_table, Job, milli, percent, Rows
from benchmarks.motion import as_truth, score_motion
from benchmarks.scenarios import SCENARIOS
from benchmarks.scoring import part_of, Run
from benchmarks.slip.methods import compare_methods, METHODS
from benchmarks.slip.recordings import RECORDING_COLUMNS, recording_jobs, recording_rows
from rich.table import Table
from smart_tire.parameters import SlipEstimatorParams

RECORDINGS = 'recordings'  # name of the recordings among the runs
DEGREES = 57.29577951308232  # per rad

NOTES = """\
steady: |r w| > 0.1 m/s, t > 3 s, more than 0.4 s from any |dw/dt| > 1.5 rad/s2; NaN while the true
slip is defined counts as 1. position: error in percent of the distance. NEES: normalized error
squared, 1 if consistent; NIS: normalized innovation squared. Ratios of recordings are to wheels
and gyroscope, for v_y and slip to zero.
"""
ERRORS = (
    Column('slip L\nsteady', 'slip_left.rms', 4), Column('R\nsteady', 'slip_right.rms', 4),
    Column('L\nall times', 'slip_left_all.rms', 4),
    Column('R\nall times', 'slip_right_all.rms', 4),
    milli('v [mm/s]\nsteady', 'v.rms'), milli('v\nall times', 'v_all.rms'),
    percent('position\n[%] rms', 'position_share', 2), percent('\nend', 'position_end_share', 2),
    Column('heading\n[deg] rms', 'heading.rms', 2, DEGREES),
    Column('\nend', 'heading_end', 2, DEGREES))
CONSISTENCY = (
    *(Column(f'NEES:\n{head}', f'{name}.nees', 2) for head, name in (
        ('slip L', 'slip_left'), ('slip R', 'slip_right'), ('v', 'v'), ('position', 'position'),
        ('heading', 'heading'))),
    *(percent(f'2 s. [%]\n{head}', f'{name}.within_two', 0) for head, name in (
        ('slip L', 'slip_left'), ('slip R', 'slip_right'), ('v', 'v'), ('heading', 'heading'))),
    Column('\nNIS', 'nis', 2), milli('S\n[mm]', 'icr.rms'), Column('step\n[us]', 'step_us', 0))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the folder of the recordings."""
    parser.add_argument('--data', type=Path, default=DATA, metavar='DIR',
                        help='folder with recordings of other robots (default: %(default)s)')


def jobs(name: str, seeds: Sequence[int], args: argparse.Namespace) -> list[Job]:
    """Return the jobs of a scenario, or of all recordings."""
    if name == RECORDINGS:
        return recording_jobs(args.data)
    return [partial(run_scenario, name, seed) for seed in seeds]


def run_scenario(name: str, seed: int) -> list[Run]:
    """Simulate one run and score all methods."""
    scenario = SCENARIOS[name]
    events = scenario.events(seed)
    truth = as_truth(truth_of(events), scenario.robot)
    estimates = compare_methods(inputs_of(events), SlipEstimatorParams(robot=scenario.robot))
    return [score_motion(name, seed, estimate, truth, prefix=f'{method}.')
            for method, estimate in estimates.items()]


def tables(rows: Rows, args: argparse.Namespace) -> Iterator[Table]:
    """Yield errors and consistency of all methods on simulated runs, and on recordings."""
    runs = [(f'{SCENARIOS[run].title}: {title}', part_of(figures, method))
            for run, figures in rows.items() if run in SCENARIOS
            for method, title in METHODS.items() if f'{method}.v.rms' in figures]
    if runs:
        yield figure_table('Errors', runs, ERRORS)
        yield figure_table('Consistency', runs, CONSISTENCY)
    if recorded := recording_rows({run: one for run, one in rows.items() if run not in SCENARIOS}):
        yield figure_table('Recordings of other robots', recorded, RECORDING_COLUMNS)


SLIP = Benchmark(
    'slip', 'accuracy of slip and pose, compared with other methods', NOTES,
    {**{name: scenario.title for name, scenario in SCENARIOS.items()},
     RECORDINGS: 'recordings of other robots'}, jobs, tables, add_arguments)
