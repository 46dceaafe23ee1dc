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

"""Scores of path tracking, combined over seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
import math
from statistics import mean
from typing import Any

from benchmarks.control.scenarios import KINEMATICS
from benchmarks.control.scoring import TrackingScore
from benchmarks.control.tracking import TrackingResult


@dataclass(frozen=True)
class Combined:
    """Scores of one case over all seeds."""

    rms: float           # m, control error, root mean square
    maximum: float       # m, largest control error
    true_rms: float      # m, root mean square
    localization: float  # m, root mean square
    length: float        # m, of the path
    yaw_acceleration: float  # rad/s2, root mean square
    duration: float      # s, mean
    arrived: float       # share


Rows = Mapping[str, Mapping[str, Combined]]  # name of the case -> kinematics -> scores


def combined(scores: Sequence[TrackingScore]) -> Combined:
    """Return the scores of several seeds as one."""
    return Combined(
        rms=_rms([one.rms for one in scores]),
        maximum=max(one.maximum for one in scores),
        true_rms=_rms([one.true_rms for one in scores]),
        localization=_rms([one.localization for one in scores]),
        length=scores[0].length,
        yaw_acceleration=_rms([one.yaw_acceleration for one in scores]),
        duration=mean(one.duration for one in scores),
        arrived=mean(float(one.arrived) for one in scores))


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(mean(value * value for value in values))


def by_case(results: Sequence[TrackingResult]) -> Rows:
    """Return the rows of the table, in the order of ``results``; all kinematics are present."""
    rows: dict[str, dict[str, Combined]] = {}
    for name in dict.fromkeys(result.case.name for result in results):
        rows[name] = {kinematics: combined([
            result.score for result in results
            if (result.case.name, result.case.kinematics) == (name, kinematics)])
            for kinematics in KINEMATICS}
    return rows


def as_tree(results: Sequence[TrackingResult]) -> dict[str, Any]:
    """Return all scores for ``results.json``."""
    return {name: {kinematics: {
        'over_seeds': asdict(one), 'seeds': {
            str(result.seed): {**asdict(result.score), 'reason': result.reason}
            for result in results
            if (result.case.name, result.case.kinematics) == (name, kinematics)}}
        for kinematics, one in row.items()} for name, row in by_case(results).items()}
