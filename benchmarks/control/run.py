# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Benchmark of the controllers: wheel speed steps, path tracking, starts and stops."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
import math

from benchmarks.control import drawn
from benchmarks.control.goals import LOCALIZATIONS, run_goal
from benchmarks.control.scenarios import BEST, CASES, KINEMATICS, OURS, SHORT, TrackingCase
from benchmarks.control.tracking import run_tracking
from benchmarks.control.traction import scenarios, traction_runs, TractionScenario
from benchmarks.control.wheel_steps import GROUNDS, READINGS, Readings, wheel_steps
from benchmarks.harness import (
    Benchmark, Column, figure_table, Job, milli, new_table, percent, Rows)
from benchmarks.scoring import Figures, part_of, Run
from rich.table import Table

WHEEL_STEPS, TRACTION = 'wheel_steps', 'traction'
DRAWN, DRAWN_ESTIMATED, GOALS = 'drawn', 'drawn_estimated', 'goals'
DEGREES = 57.29577951308232  # per rad

MAX_SHARE = 1.0              # of the control error of the ideal kinematics
MAX_BEST_SHARE = 1.5         # of it with the best look-ahead of each path
MAX_DURATION_SHARE = 1.05    # of the time of the ideal kinematics with the best look-ahead
MAX_YAW_ACCELERATION = 1.2   # rad/s2, rms
MAX_LOCALIZATION = 0.005     # rms error over the length of the path

NOTES = """\
Wheel speed steps of 0, 6, 12, 3, -6, 0 rad/s: settled within 5 % of the step. Path tracking:
control error is the distance of the pose that the controller was given from the wanted path, rms
from the start to the end of following, mean over seeds with its standard error; localization the
rms distance of that pose from the true one. ideal: r w = v -+ track / 2 * yaw rate, look-ahead
0.35 s and at least 0.18 m; best: with the best look-ahead of each path; icr: filter of the
instantaneous centers of rotation; ours: slip-compensated. Poses and slips are true or estimated,
both. Starts and stops: distance over that of full friction, at a stop its inverse; sliding:
longest time above critical slip; against, beyond: wheels that turn against the command, or
faster. Robots drawn at random: mean over robots of the rms distance of the true pose from the
path; won: robots on which another controller has the larger one; ratio: ours over that of the
other one, on the worst robot. calibrated: ideal, with the effective track of tires that adhere;
pursuit: regulated pure pursuit. Goals: false is one that was reported as reached while the robot
was outside of the tolerances; distance and angle are those of reported ones.
"""
STEPS = (Column('rise\n[s]', 'rise.mean', 2), percent('overshoot\n[%] mean', 'overshoot.mean'),
         percent('\nmost', 'overshoot.max'), Column('settling\n[s] mean', 'settling.mean', 2),
         Column('\nmost', 'settling.max', 2), percent('settled\n[%]', 'settled.mean', 0))
TRACKING = (*(column for one in KINEMATICS for column in (
                milli(f'control\n{one} [mm]', f'{one}.control_rms'),
                milli('+-', f'{one}.control_rms.error'))),
            milli('allowed\n[mm]', 'allowed'), milli('maximum\nours', f'{OURS}.control.max'),
            milli('locali-\nzation', f'{OURS}.localization_rms'),
            milli('true\nours', f'{OURS}.true_rms'),
            *(Column(f'time [s]\n{one}', f'{one}.duration') for one in KINEMATICS),
            *(Column(f'yaw\n{one}', f'{one}.yaw.rms', 2) for one in KINEMATICS))
STARTS = (percent('distance\n[%] mean', 'distance'), Column('sliding\n[s] most', 'sliding.max', 2),
          Column('drift\n[m] most', 'drift.max', 3), Column('turn\n[deg]', 'turn.max', 1, DEGREES),
          Column('against', 'against.max', 0), Column('beyond\n[m/s]', 'beyond.max', 2),
          Column('stopped\n[s]', 'stopped.max', 2))
ARRIVALS = (percent('arrived\n[%]', 'arrived', 0), percent('false\n[%]', 'false', 1),
            milli('distance\n[mm]', 'miss'), milli('\nmost', 'miss.max'),
            Column('angle\n[deg]', 'turn', 1, DEGREES), Column('\nmost', 'turn.max', 1, DEGREES),
            Column('time\n[s]', 'duration'))
APART = tuple(milli(f'{name} [mm]\n{one}', f'{one}.{name}_rms')
              for name in ('localization', 'control') for one in (OURS, SHORT))


def drives(*controllers: str) -> tuple[Column, ...]:
    """Return the columns of robots drawn at random."""
    return (*(milli(f'mean rms [mm]\n{one}', f'{one}.true_rms') for one in controllers),
            milli('most\nours', f'{OURS}.true_rms.max'),
            *(column for one in controllers[1:] for column in (
                percent(f'won [%]\n{one}', f'{one}.lost', 0),
                Column(f'ratio\n{one}', f'{one}.ratio.max', 2))),
            *(percent(f'arrived [%]\n{one}', f'{one}.arrived', 0) for one in controllers),
            *(Column(f'time [s]\n{one}', f'{one}.duration') for one in controllers))


def jobs(name: str, seeds: Sequence[int], args: argparse.Namespace) -> list[Job]:
    """Return the jobs of a run of ``CONTROL``: that of one tracking case, or of many."""
    if name == WHEEL_STEPS:
        return [partial(run_steps, ground, readings, seed)
                for ground, readings, seed in product(GROUNDS, READINGS, seeds)]
    if name == TRACTION:
        return [partial(run_starts, one) for one in scenarios(seeds)]
    if name in (DRAWN, DRAWN_ESTIMATED):
        return [partial(drawn.run_drawn, path, seed, estimated=name == DRAWN_ESTIMATED, row=name)
                for path, seed in product(drawn.PATHS, seeds)]
    if name == GOALS:
        return [partial(run_goal, localization, seed, GOALS)
                for localization, seed in product(LOCALIZATIONS, seeds)]
    return [partial(run_case, replace(CASES[name], kinematics=kinematics), seed)
            for kinematics in KINEMATICS for seed in seeds]


def run_steps(ground: str, readings: Readings, seed: int) -> list[Run]:
    """Return the responses of the wheels."""
    found = wheel_steps(ground, readings, seed)
    return [replace(found, row=f'{WHEEL_STEPS}/{found.row}')]


def run_starts(scenario: TractionScenario) -> list[Run]:
    """Return the scores of the starts and stops of ``scenario``."""
    return [replace(one, row=f'{TRACTION}/{one.row}') for one in traction_runs(scenario)]


def run_case(case: TrackingCase, seed: int) -> list[Run]:
    """Return the scores of one run of path tracking."""
    return [run_tracking(case, seed)]


def max_error(row: Figures) -> float:
    """
    Return the largest control error [m], mean of the rms, that a row of the table may have.

    A best look-ahead counts only where it arrives, and smoothly.
    """
    counts = row[f'{BEST}.arrived'] == 1.0 and row[f'{BEST}.yaw.rms'] <= MAX_YAW_ACCELERATION
    return min(MAX_SHARE * row[f'{SHORT}.control_rms'],
               MAX_BEST_SHARE * row[f'{BEST}.control_rms'] if counts else math.inf)


def missed(row: Figures) -> list[str]:
    """Return what a row of the table misses: nothing if all requirements are met."""
    ours = part_of(row, OURS)
    checks = {
        'arrival': ours['arrived'] == 1.0, 'error': ours['control_rms'] <= max_error(row),
        'time': ours['duration'] <= MAX_DURATION_SHARE * row[f'{BEST}.duration'],
        'yaw': ours['yaw.rms'] <= MAX_YAW_ACCELERATION,
        'localization': ours['localization_rms'] <= MAX_LOCALIZATION * ours['length']}
    return [name for name, met in checks.items() if not met]


def tables(rows: Rows, args: argparse.Namespace) -> Iterator[Table]:
    """Yield the tables of the runs."""
    for name, title, columns in ((WHEEL_STEPS, 'Wheel speed steps', STEPS),
                                 (TRACTION, 'Starts and stops', STARTS),
                                 (DRAWN, 'Robots drawn at random, true pose',
                                  drives(*drawn.CONTROLLERS)),
                                 (DRAWN_ESTIMATED, 'Robots drawn at random, estimated pose',
                                  (*APART, *drives(OURS, SHORT))),
                                 (GOALS, 'Goals with a final yaw', ARRIVALS)):
        own = [(row.partition('/')[2], figures) for row, figures in rows.items()
               if row.startswith(f'{name}/')]
        if own:
            yield figure_table(title, own, columns)
    tracked = {row: figures for row, figures in rows.items() if row in CASES}
    if tracked:
        yield figure_table('Path tracking', [
            (CASES[row].title, figures | {'allowed': max_error(figures)})
            for row, figures in tracked.items()], TRACKING)
        table = new_table('Requirements of path tracking', 'run', 'missed')
        for row, figures in tracked.items():
            table.add_row(CASES[row].title, ', '.join(missed(figures)) or 'none')
        yield table


CONTROL = Benchmark(
    'control', 'wheel speed steps, path tracking, starts and stops', NOTES,
    {WHEEL_STEPS: 'wheel speed steps', TRACTION: 'starts and stops',
     DRAWN: 'robots drawn at random', DRAWN_ESTIMATED: 'the same with estimated pose',
     GOALS: 'goals with a final yaw of robots drawn at random',
     **{name: case.title for name, case in CASES.items()}}, jobs, tables)
