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

"""Scores of starts and stops: distance, slip beyond critical, sideways drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from benchmarks.control.traction import (
    Leg, TractionHistory, TractionRun, TractionScenario)
from benchmarks.tables import new_table, number
import numpy as np
from rich.table import Table
from smart_tire.arrays import Array
from smart_tire.samples import GRAVITY

SCORED_SPEED = 1.2        # m/s, up to which starts count; then the command limits the slip
MIN_SLIDING_SPEED, MIN_SPEED = 0.05, 0.2  # m/s, of the tread and of the robot, for slip to count
TURNING_SPEED = 0.05            # m/s, rolling speed of a wheel that turns
MAX_SLIDING = {16.0: 0.3, 100.0: 0.15}  # s, requirement by the rate of the readings [Hz]


@dataclass(frozen=True)
class TractionScore:
    """One start or stop."""

    scenario: TractionScenario
    kind: str
    distance: float  # -, start: distance over that of full friction; stop: the inverse
    sliding: float   # s, longest time of a wheel above critical slip
    drift: float     # m, largest lateral deviation from the heading at the beginning
    turn: float      # rad, change of heading
    against: int     # times at which a wheel begins to turn against the command
    beyond: float    # m/s, most by which a wheel turns faster than commanded; at a stop: at begin
    stopped: float   # s, until all wheels stand; NaN for a start


def scores(result: TractionRun) -> list[TractionScore]:
    """Return the scores of all starts and stops of a run."""
    return [_score(result, leg, part)
            for leg, part in result.legs() if leg.kind in ('start', 'stop')]


def _score(result: TractionRun, leg: Leg, part: TractionHistory) -> TractionScore:
    drift, turn = _drift(part)
    against, beyond, stopped = _bounds(leg, part)
    return TractionScore(result.scenario, leg.kind, _distance(result, leg, part),
                         longest_sliding(part), drift, turn, against, beyond, stopped)


def longest_sliding(part: TractionHistory) -> float:
    """Return the longest time [s] for which one wheel is above its critical slip."""
    speed = np.hypot(part.rolling - part.wheel_v_x, part.wheel_v_y)
    sliding = ((np.hypot(*part.slip) > part.critical_slip) & (speed > MIN_SLIDING_SPEED)
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


def _drag(scenario: TractionScenario) -> float:
    return scenario.ground.drag[0]


def _distance(result: TractionRun, leg: Leg, part: TractionHistory) -> float:
    """Return the distance of a start over that of full friction; the inverse for a stop."""
    friction = float(part.friction.mean())
    if leg.kind == 'stop':
        shortest = part.v_x[0] ** 2 / (2.0 * GRAVITY * (friction + _drag(result.scenario)))
        return float(shortest / max(_path(part)[-1], 1e-6))
    acceleration = GRAVITY * (part.friction.mean(axis=1) - _drag(result.scenario))
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


def traction_table(found: Sequence[TractionScore]) -> Table:
    """Return mean and worst scores of each scenario, rate and kind, with and without."""
    table = new_table(
        'Starts and stops (distance: over that of full friction, at a stop its inverse; sliding: '
        f'longest time above critical slip at more than {MIN_SPEED:g} m/s)',
        'ground, readings', '\ncommand', 'traction\ncontrol', 'distance [%]\nmean', '\nworst',
        'sliding [s]\nworst', 'drift [m]\nworst', 'turn [deg]\nworst', 'against\nmost',
        'beyond [m/s]\nworst', 'stopped [s]\nworst')
    groups: dict[tuple[str, float, str, bool], list[TractionScore]] = {}
    for one in found:
        key = one.scenario.title, one.scenario.wheel_rate, one.kind, one.scenario.traction
        groups.setdefault(key, []).append(one)
    for (title, rate, kind, traction), group in groups.items():
        table.add_row(
            f'{title}, {rate:g} Hz', kind, 'yes' if traction else 'no',
            number(100.0 * float(np.mean([one.distance for one in group])), 1),
            number(100.0 * min(one.distance for one in group), 1),
            number(max(one.sliding for one in group), 2),
            number(max(one.drift for one in group), 3),
            number(math.degrees(max(abs(one.turn) for one in group)), 1),
            str(max(one.against for one in group)), number(max(one.beyond for one in group), 2),
            number(max(one.stopped for one in group), 2),
            style='bold' if traction else None)
    return table
