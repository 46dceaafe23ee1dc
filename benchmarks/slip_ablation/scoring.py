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

"""Change of errors by a rule of the slip estimator, against the scatter of seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

from benchmarks.slip.scoring import MIN_ROLLING_SPEED, score_run
from benchmarks.slip.series import EstimateSeries, Truth
import numpy as np
from smart_tire.analysis.metrics import rms
from smart_tire.analysis.series import at

FIGURES = {'slip': 'slip', 'slip_all_times': 'slip, all times', 'speed': 'v_x', 'speed_y': 'v_y',
           'heading': 'heading', 'position': 'position', 'nees': 'slip NEES'}
MIN_SIGMAS = 2.0    # standard errors of a change that is beyond the scatter of seeds
MIN_CHANGE = 0.01   # relative, of a change that matters

CaseKey = tuple[str, str]  # run, variant
Scores = dict[str, float]


@dataclass(frozen=True)
class Change:
    """Relative change of a figure without a rule, and its standard error over seeds."""

    mean: float
    standard_error: float  # NaN for a single seed

    @property
    def matters(self) -> bool:
        """Return whether the change is beyond the scatter of seeds."""
        return abs(self.mean) > max(MIN_CHANGE, MIN_SIGMAS * self.standard_error)


def scores_of(estimate: EstimateSeries, truth: Truth, *, averaged: bool) -> Scores:
    """Return the errors of ``FIGURES``; slips are those of both sides together."""
    score = score_run(estimate, truth, averaged=averaged)
    sides = score.left, score.right
    moving = np.abs(truth.rolling).max(axis=1) > MIN_ROLLING_SPEED
    poses = estimate.poses
    lateral = (at(truth.stamp_ns, poses.stamp_ns, poses.twist[:, 1])
               - truth.poses.twist[:, 1])[moving]
    return {'slip': math.hypot(*(side.selected.rms for side in sides)) / math.sqrt(2.0),
            'slip_all_times': math.hypot(
                *(side.all_times.rms for side in sides)) / math.sqrt(2.0),
            'speed': score.speed.selected.rms,
            'speed_y': rms(lateral[np.isfinite(lateral)]),
            'heading': score.path.heading.rms, 'position': score.path.rms_m,
            'nees': sum(side.selected.normalized_rms**2 for side in sides) / 2.0}


def change(without: Sequence[Mapping[CaseKey, Scores]], base: Sequence[Mapping[CaseKey, Scores]],
           figure: str, case: CaseKey | None = None) -> Change:
    """
    Return the change of ``figure`` in one case, or the mean change over all cases.

    ``without`` and ``base`` hold the scores of each seed. Changes are ratios of the same seed, so
    that the scatter of the figure itself over the seeds does not count.
    """
    logs = [np.mean([math.log(off[key][figure] / on[key][figure])
                     for key in ([case] if case is not None else on)])
            for off, on in zip(without, base)]
    error = math.nan if len(logs) < 2 else float(np.std(logs, ddof=1)) / math.sqrt(len(logs))
    return Change(math.expm1(float(np.mean(logs))), error)
