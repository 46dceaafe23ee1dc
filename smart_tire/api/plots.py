# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Estimates as one picture."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from smart_tire.analysis import figure
from smart_tire.analysis.figures import MAX_CROSSING_GAP
from smart_tire.analysis.metrics import compared_poses, measured, SIDES
from smart_tire.errors import EstimatorError
from smart_tire.estimates import Estimates, FrictionEstimate, SlipEstimate, Truth
from smart_tire.recording import seconds

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLORS = dict(zip(('left', 'right'), figure.PAIR))


def plot(estimates: Estimates, truth: Truth | None = None) -> Figure:
    """
    Return a figure of matplotlib: path [m], slip of both sides [-], friction coefficient [-].

    Bands and bars are two standard deviations. ``truth``, where it is given and known, is dashed,
    its path so that both start at the same pose. In a notebook the figure shows itself; its
    ``savefig(path)`` writes it. Raises EstimatorError if there is nothing to show.
    """
    from smart_tire.analysis.drawing import render  # loads matplotlib
    pose, slip, friction = estimates.pose, estimates.slip, estimates.friction
    stamps = np.concatenate([one.stamp_ns for one in (pose, slip, friction)])
    if not len(stamps):
        raise EstimatorError('there are no estimates to plot: expected pose, slip or friction')
    known, origin_ns = len(pose) > 0, int(stamps.min())
    paths = [figure.Mark(figure.Curve(*pose.pose[:, :2].T), 'estimate', 'ink')]
    if truth is not None and known and len(truth.pose):
        paths += figure.truth_marks(figure.Curve(
            *compared_poses(pose, truth.pose).true[:, :2].T))
    panels = [figure.Panel(paths, 'x [m]', 'y [m]', 'path', equal=True)] if known else []
    end = float(seconds(stamps, origin_ns).max())
    slips = [*_slips(slip, origin_ns), *(_true_slips(truth.slip, origin_ns) if truth else ())]
    frictions = [*_frictions(friction, origin_ns)]
    bars = [mark.curve.y + sign * mark.curve.reach for mark in frictions for sign in (-1.0, 1.0)]
    if frictions and truth is not None:
        frictions += _true_frictions(truth.friction, origin_ns)
    for title, marks, shown in (
            ('slip ratio [-]', slips, [mark.curve.y for mark in slips]),
            ('friction coefficient [-]', frictions, bars)):
        if marks:
            panels.append(figure.Panel(marks, figure.TIME_LABEL, title, x_limits=(0.0, end),
                                       y_limits=figure.limits(shown, 0.05)))
    return render(figure.Figure('estimates', 'Path, slip and friction', figure.TWO_SIGMA,
                                [[panel] for panel in panels], panel_legends=True))


def _slips(slip: SlipEstimate, origin_ns: int) -> Iterator[figure.Mark]:
    time = seconds(slip.stamp_ns, origin_ns)
    for side, wheels in SIDES.items() if len(time) else ():
        own = measured(slip.ratio, wheels)
        curve, _ = figure.observable(figure.interrupted(figure.Curve(
            time, slip.ratio[:, own].mean(axis=1), slip.sigma[:, own].mean(axis=1))))
        yield figure.Mark(curve, f'{side} side ± 2σ', COLORS[side])


def _true_slips(slip: SlipEstimate, origin_ns: int) -> Iterator[figure.Mark]:
    for wheels in SIDES.values():
        yield from figure.truth_marks(figure.interrupted(figure.Curve(
            seconds(slip.stamp_ns, origin_ns), slip.ratio[:, wheels].mean(axis=1))))


def _true_frictions(friction: FrictionEstimate, origin_ns: int) -> Iterator[figure.Mark]:
    for wheel in sorted(set(friction.wheel)):
        own = friction.of(wheel)
        yield from figure.truth_marks(figure.interrupted(figure.Curve(
            seconds(own.stamp_ns, origin_ns), own.friction_coefficient.value),
            MAX_CROSSING_GAP), 'mid')


def _frictions(friction: FrictionEstimate, origin_ns: int) -> Iterator[figure.Mark]:
    mu = friction.friction_coefficient
    for wheel, color in zip(sorted(set(friction.wheel)), figure.COLORS):
        own = (friction.wheel == wheel) & np.isfinite(mu.value)
        yield figure.dots(seconds(friction.stamp_ns[own], origin_ns), mu.value[own],
                          f'{wheel.replace("_", " ")} ± 2σ', color, mu.sigma[own])
