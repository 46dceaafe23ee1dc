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

"""
Scores of the estimators on drawn robots.

Errors of mu are relative, of the fused coefficient from the revolution ``COUNTED_FROM`` on the
present ground; slips count while steady (``benchmarks.slip.scoring``), speeds at all times of
motion after ``SETTLING_TIME``. One run is one sample: shares within two sigma and NEES are means
over robots; median and 90 % of mu are quantiles over all crossings of a row.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math
import time

from benchmarks.friction.counting import COUNTED_FROM, revolutions_on_ground
from benchmarks.friction.records import FUSED, match_rows, true_crossings
from benchmarks.robots.draws import Draw
from benchmarks.slip.scoring import (
    estimated_at, MIN_ROLLING_SPEED, SETTLING_TIME, steady_slips)
from benchmarks.slip.series import as_estimate, as_truth, EstimateSeries, Truth
import numpy as np
from smart_tire.analysis.metrics import rms
from smart_tire.analysis.pipeline import Pipeline
from smart_tire.analysis.series import Floats
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, Sample

MU, SLIP, SPEED, LATERAL = QUANTITIES = 'mu', 'slip', 'u', 'v_y'
GROUND = ('stiffness',)  # true quantity that differs between grounds; mu falls with the slip, too

Figures = dict[str, float]


@dataclass(frozen=True)
class Errors:
    """Errors of one quantity and their standard deviations, shape (n,); NaN if not estimated."""

    error: Floats
    sigma: Floats

    @property
    def figures(self) -> Figures:
        """Return rms, quantiles, share within two sigma, NEES and share of finite estimates."""
        known = np.isfinite(self.error)
        error, ratio = self.error[known], self.error[known] / self.sigma[known]
        if not error.size:
            return {'finite': 0.0} | dict.fromkeys(
                ('median', 'q90', 'rms', 'bias', 'within_two', 'nees'), math.nan)
        size = np.abs(error)
        return {'finite': float(known.mean()), 'median': float(np.median(size)),
                'q90': float(np.quantile(size, 0.9)), 'rms': rms(error),
                'bias': float(np.median(error)),
                'within_two': float(np.mean(np.abs(ratio) <= 2.0)),
                'nees': float(np.mean(ratio**2))}


@dataclass(frozen=True)
class RobotResult:
    """Results of one drawn robot."""

    row: str
    seed: int
    errors: dict[str, Errors]  # of each of ``QUANTITIES``
    load: float                # CPU time of the estimators over the duration

    @property
    def figures(self) -> dict[str, Figures]:
        """Return the figures of the robot."""
        return {name: one.figures for name, one in self.errors.items()}


def run_robot(one: Draw) -> RobotResult:
    """Return the results of the estimators for a drawn robot."""
    events = one.events()
    truth = [sample for _, topic, sample in events if topic.startswith('ground_truth/')]
    inputs = [sample for _, topic, sample in events if not topic.startswith('ground_truth/')]
    begin = time.thread_time()
    estimates = estimates_of(one, inputs)
    spent = time.thread_time() - begin
    duration = (events[-1][0] - events[0][0]) / NS_PER_S
    return RobotResult(one.row, one.seed, score_robot(estimates, truth, one.true),
                       spent / duration)


def estimates_of(one: Draw, inputs: Iterable[Sample]) -> list[Sample]:
    """Return the estimates of the complete pipeline."""
    pipeline = Pipeline(one.params)
    estimates: list[Sample] = [estimate for sample in inputs
                               for estimate in pipeline.update(sample)]
    return [*estimates, *pipeline.finish()]


def score_robot(estimates: Sequence[Sample], truth: Sequence[Sample], robot: RobotParams
                ) -> dict[str, Errors]:
    """Return the errors of ``estimates``; ``robot`` is the true one."""
    motion, series = as_truth(truth, robot), as_estimate(estimates)
    crossings = [sample for sample in estimates if isinstance(sample, Friction)]
    wheels = [_friction_errors(crossings, truth, robot, wheel) for wheel in robot.film.wheels]
    return {MU: Errors(*(np.concatenate(parts) for parts in zip(*wheels))),
            SLIP: Errors(*steady_slips(series, motion)),
            SPEED: _speed_errors(series, motion, 0), LATERAL: _speed_errors(series, motion, 1)}


def _friction_errors(estimates: Sequence[Friction], truth: Sequence[Sample], robot: RobotParams,
                     wheel: str) -> tuple[Floats, Floats]:
    """Return relative errors and sigmas of the fused mu of ``wheel``."""
    rows = match_rows(true_crossings(truth, robot, wheel), estimates, wheel)
    counts = revolutions_on_ground(rows, GROUND) >= COUNTED_FROM
    true, value, sigma = (columns[FUSED][counts] for columns in (
        rows.true, rows.value, rows.sigma))
    return value / true - 1.0, sigma / true


def _speed_errors(estimate: EstimateSeries, truth: Truth, axis: int) -> Errors:
    """Return the errors of a component of the velocity of ``base_link`` in motion."""
    age = (truth.stamp_ns - truth.stamp_ns[0]) / NS_PER_S
    when = (np.abs(truth.rolling).max(axis=1) > MIN_ROLLING_SPEED) & (age > SETTLING_TIME)
    poses, stamps, one = estimate.poses, truth.stamp_ns[when], slice(axis, axis + 1)
    value = estimated_at(stamps, poses.stamp_ns, poses.twist[:, one])[:, 0]
    variance = estimated_at(stamps, poses.stamp_ns, poses.twist_variance[:, one])[:, 0]
    return Errors(value - truth.poses.twist[when, axis], np.sqrt(variance))


def row_figures(results: Sequence[RobotResult]) -> dict[str, Figures]:
    """Return the figures of a row by quantity, and the mean CPU load."""
    found: dict[str, Figures] = {}
    for name in QUANTITIES:
        whole = Errors(*(np.concatenate([getattr(one.errors[name], part) for one in results])
                         for part in ('error', 'sigma'))).figures
        each = [one.errors[name].figures for one in results]
        whole |= {part: _mean([one[part] for one in each]) for part in ('within_two', 'nees')}
        medians = [one['median'] for one in each if math.isfinite(one['median'])]
        whole['robots_90'] = float(np.quantile(medians, 0.9)) if medians else math.nan
        found[name] = whole
    return found | {'run': {'robots': len(results),
                            'load': _mean([one.load for one in results])}}


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(np.mean(known)) if known else math.nan
