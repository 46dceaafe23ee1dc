# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Errors of estimates against a reference, with their standard deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smart_tire.analysis.figure import (
    Curve, Figure, interrupted, limits, Mark, observable, Panel, REPORTED, SOURCES, TIME_LABEL,
    TRUTH)
from smart_tire.analysis.friction_metrics import column, is_informative, Matches, stamps_of
from smart_tire.analysis.metrics import Compared, ComparedPoses, Score, score
from smart_tire.analysis.result import Comparison
from smart_tire.arrays import Array
from smart_tire.recording import seconds
from smart_tire.samples import WHEELS

POSE_NAMES = (('x', 'm'), ('y', 'm'), ('heading', 'rad'))
TWIST_NAMES = (('v_x', 'm/s'), ('v_y', 'm/s'), ('yaw rate', 'rad/s'))
HISTOGRAM_RANGE, BIN_WIDTH = 5.0, 0.25  # in standard deviations
GROUP_COLORS = 'blue', 'vermillion', 'orange', 'sky', 'green'


@dataclass(frozen=True)
class ErrorCurve:
    """Error of one quantity over time, with its standard deviation."""

    name: str
    unit: str  # '' if dimensionless
    curve: Curve

    @property
    def score(self) -> Score:
        """Return the statistics of the error."""
        return score(self.curve.y, self._sigma)

    @property
    def normalized(self) -> Array:
        """Return the finite errors divided by their standard deviations, without zeros of it."""
        known = np.isfinite(self.curve.y) & (self._sigma > 0.0)
        found: Array = self.curve.y[known] / self._sigma[known]
        return found

    @property
    def _sigma(self) -> Array:
        return np.zeros(0) if self.curve.sigma is None else self.curve.sigma


def position_error(poses: ComparedPoses, origin_ns: int) -> ErrorCurve:
    """Return the distance from the reference position; its sigma is along the longest axis."""
    sigma = np.full(len(poses.stamp_ns), np.nan)
    known = np.isfinite(poses.covariance).all(axis=(1, 2))
    sigma[known] = np.sqrt(np.linalg.eigvalsh(poses.covariance[known, :2, :2])[:, -1])
    return ErrorCurve('position', 'm', Curve(
        seconds(poses.stamp_ns, origin_ns), np.linalg.norm(poses.error[:, :2], axis=1), sigma))


def pose_errors(poses: ComparedPoses, origin_ns: int) -> list[ErrorCurve]:
    """Return the errors of x, y and heading, with the reference aligned."""
    return _columns(POSE_NAMES, poses, origin_ns)


def error_groups(found: Comparison) -> dict[str, list[ErrorCurve]]:
    """Return the errors of all quantities by group; slip where it is observable."""
    slips = _columns([(f'slip {wheel.replace("_", " ")}', '') for wheel in WHEELS], found.slips,
                     found.origin_ns)
    return {'pose': pose_errors(found.poses, found.origin_ns),
            'velocity': _columns(TWIST_NAMES, found.twist, found.origin_ns),
            'slip': [replace(one, curve=observable(one.curve)[0]) for one in slips],
            'friction': _friction_errors(found.matches, found.origin_ns)}


def _friction_errors(matches: Matches, origin_ns: int) -> list[ErrorCurve]:
    """Return the errors of friction, of informative crossings, and of the adhesion ratio."""
    pairs = [(true, own) for true, own in matches.pairs if own is not None]
    true, own = [one for one, _ in pairs], [one for _, one in pairs]
    time = seconds(stamps_of(true), origin_ns)
    errors = []
    for label, quantity in (('friction, single crossing', 'friction_coefficient_single'),
                            ('friction, fused', 'friction_coefficient'),
                            ('adhesion ratio', 'adhesion_ratio')):
        value, sigma = column(own, quantity), column(own, quantity, sigmas=True)
        difference = value - column(true, quantity)
        if quantity == 'friction_coefficient_single':
            difference[~is_informative(value, sigma)] = np.nan
        errors.append(ErrorCurve(label, '', Curve(time, difference, sigma)))
    return [one for one in errors if np.isfinite(one.curve.y).any()]


def _columns(names: Sequence[tuple[str, str]], found: Compared,
             origin_ns: int) -> list[ErrorCurve]:
    """Return the errors of each quantity as curves; none without rows."""
    time = seconds(found.stamp_ns, origin_ns)
    return [ErrorCurve(name, unit, Curve(time, error, sigma))
            for (name, unit), error, sigma in zip(names, found.error.T, found.sigma.T)
            ] if np.isfinite(found.error).any() else []


def error_panel(errors: Sequence[ErrorCurve], colors: Mapping[str, str], title: str = '',
                bottom: float | None = None) -> Panel:
    """Return the panel of an error of several estimates, whose labels have ``colors``."""
    curves = [interrupted(one.curve) for one in errors]
    marks = [Mark(curve, label, color, around_zero=True)
             for curve, (label, color) in zip(curves, colors.items())]
    bands = [sign * curve.reach[np.isfinite(curve.y)] for curve in curves for sign in (1.0, -1.0)]
    low, high = limits([*(curve.y for curve in curves), *bands], 1e-4)
    one = errors[0]
    return Panel(marks, TIME_LABEL, f'{one.name} error [{one.unit or "-"}]', title,
                 y_limits=(low if bottom is None else bottom, high))


def error_figure(name: str, title: str, errors: Sequence[ErrorCurve],
                 reference: str = TRUTH) -> Figure | None:
    """Return errors over time, one panel per quantity; None without errors."""
    return Figure(
        name, f'{title} over time',
        f'{title}: estimate minus {SOURCES[reference]}. Bands: ± 2σ around zero, where σ is the '
        f'standard deviation {REPORTED[reference]}. If it is right, 95 % of the '
        'errors are inside; errors of one recording are correlated, so the share varies.',
        [[error_panel([error], {'error': 'blue'}, error.name)] for error in errors],
        (9.0, 2.0)) if errors else None


def histogram_figure(groups: Mapping[str, Sequence[ErrorCurve]],
                     reference: str = TRUTH) -> Figure | None:
    """Return the distribution of the normalized errors by group; None without errors."""
    edges = np.arange(-HISTOGRAM_RANGE, HISTOGRAM_RANGE + 0.5 * BIN_WIDTH, BIN_WIDTH)
    centers = 0.5 * (edges[:-1] + edges[1:])
    marks = []
    for (name, errors), color in zip(groups.items(), GROUP_COLORS):
        values = np.concatenate([np.empty(0), *(one.normalized for one in errors)])
        counts = np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0]
        if len(values):
            marks.append(Mark(Curve(centers, counts / (len(values) * BIN_WIDTH)), name, color,
                              steps='mid'))
    normal = np.exp(-0.5 * centers ** 2) / np.sqrt(2.0 * np.pi)
    return Figure(
        'normalized', 'Distribution of the normalized errors compared with a standard normal',
        f'Errors divided by their standard deviations, {REPORTED[reference]}. A '
        'consistent estimator follows the standard normal distribution (dashed); a wider curve '
        'means that σ is too small. Errors beyond ± 5σ are counted in the outer bins.',
        [[Panel([*marks, Mark(Curve(centers, normal), 'standard normal', 'ink', dashed=True)],
                'error / σ [-]', 'density [-]', 'Normalized errors')]],
        (9.0, 4.0)) if marks else None
