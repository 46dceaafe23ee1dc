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

"""Errors of estimates against ground truth over time, with the reported standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smart_tire.analysis.curves import Curve, observable
from smart_tire.analysis.friction_metrics import column, is_informative, Matches
from smart_tire.analysis.metrics import aligned, Score, score
from smart_tire.analysis.series import at, Floats, seconds, Series
from smart_tire.samples import WHEELS

POSE_NAMES = (('x', 'm'), ('y', 'm'), ('heading', 'rad'))
TWIST_NAMES = (('v_x', 'm/s'), ('v_y', 'm/s'), ('yaw rate', 'rad/s'))


@dataclass(frozen=True)
class ErrorCurve:
    """Error of one quantity over time, with the standard deviation of the estimate."""

    name: str
    unit: str  # '' if dimensionless
    curve: Curve

    @property
    def score(self) -> Score:
        """Return the statistics of the error."""
        return score(self.curve.value, self._sigma)

    @property
    def normalized(self) -> Floats:
        """Return the finite errors divided by their standard deviations, without zeros of it."""
        known = np.isfinite(self.curve.value) & (self._sigma > 0.0)
        found: Floats = self.curve.value[known] / self._sigma[known]
        return found

    @property
    def _sigma(self) -> Floats:
        return np.zeros(0) if self.curve.sigma is None else self.curve.sigma


def pose_errors(estimates: Series, truth: Series, origin_ns: int) -> list[ErrorCurve]:
    """Return the errors of x, y and heading, with the truth aligned at the start."""
    poses = estimates.poses()
    estimated, true, stamps = aligned(truth.poses(), poses)
    covariance = at(stamps, poses.stamp_ns, poses.pose_covariance)
    return _columns(POSE_NAMES, seconds(stamps, origin_ns), estimated - true,
                    np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)))


def twist_errors(estimates: Series, truth: Series, origin_ns: int) -> list[ErrorCurve]:
    """Return the errors of the velocities; empty without true velocities."""
    own, true = estimates.poses(), truth.poses()
    known = np.isfinite(true.twist[:, 0])
    stamps = true.stamp_ns[known]
    return _columns(TWIST_NAMES, seconds(stamps, origin_ns),
                    at(stamps, own.stamp_ns, own.twist) - true.twist[known],
                    np.sqrt(at(stamps, own.stamp_ns, own.twist_variance)))


def slip_errors(estimates: Series, truth: Series, origin_ns: int) -> list[ErrorCurve]:
    """Return the errors of the slip of each wheel where it is observable."""
    own, true = estimates.slips(), truth.slips()
    names = [(f'slip {wheel.replace("_", " ")}', '') for wheel in WHEELS]
    found = _columns(names, seconds(true.stamp_ns, origin_ns),
                     at(true.stamp_ns, own.stamp_ns, own.ratio) - true.ratio,
                     at(true.stamp_ns, own.stamp_ns, own.sigma))
    return [ErrorCurve(one.name, one.unit, observable(one.curve)[0]) for one in found]


def friction_errors(matches: Matches, origin_ns: int) -> list[ErrorCurve]:
    """Return the errors of friction, of informative crossings, and of the adhesion ratio."""
    pairs = [(true, own) for true, own in matches.pairs if own is not None]
    true, own = [one for one, _ in pairs], [one for _, one in pairs]
    time = seconds(np.array([one.stamp_ns for one in true], np.int64), origin_ns)
    errors = []
    for label, quantity in (('friction, single crossing', 'friction_coefficient_single'),
                            ('friction, fused', 'friction_coefficient'),
                            ('adhesion ratio', 'adhesion_ratio')):
        value, sigma = column(own, quantity), column(own, quantity, sigmas=True)
        difference = value - column(true, quantity)
        if quantity == 'friction_coefficient_single':
            difference[~is_informative(value, sigma)] = np.nan
        errors.append(ErrorCurve(label, '', Curve(time, difference, sigma)))
    return [one for one in errors if np.isfinite(one.curve.value).any()]


def _columns(names: Sequence[tuple[str, str]], time_s: Floats, error: Floats,
             sigma: Floats) -> list[ErrorCurve]:
    """Return the columns of ``error`` (n, k) as curves; none without rows."""
    if not np.isfinite(error).any():
        return []
    return [ErrorCurve(name, unit, Curve(time_s, error[:, i], sigma[:, i]))
            for i, (name, unit) in enumerate(names)]
