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

"""Figure of one run: slip, path and pose errors by method."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.motion import Estimate, side_means, SIDES, Truth
from benchmarks.slip.methods import LIVE, LIVE_TORQUE, METHODS, SMOOTHED, SMOOTHED_TORQUE
import numpy as np
from smart_tire.analysis.figure import (
    Curve, Figure, limits, Mark, Panel, TIME_LABEL, truth_marks, TWO_SIGMA)
from smart_tire.analysis.metrics import aligned, rotated
from smart_tire.arrays import Array
from smart_tire.recording import seconds

COLORS = dict(zip(METHODS, ('blue', 'vermillion', 'blue', 'vermillion', 'shade', 'orange')))
SLIP_MARGIN = 0.1          # -, above and below the true slips
MAX_SHOWN_ERROR = 5.0      # of a method, over that of the estimator under test


def run_figure(title: str, estimates: Mapping[str, Estimate], truth: Truth) -> Figure:
    """Return slips with two-sigma bands over time, the paths, and position and heading errors."""
    shown = (LIVE_TORQUE, SMOOTHED_TORQUE) if LIVE_TORQUE in estimates else (LIVE, SMOOTHED)
    slips = [_slip_panel(name, side, {method: estimates[method] for method in shown}, truth)
             for name, side in SIDES.items()]
    marks: dict[str, list[Mark]] = {'path': [], 'position error [m]': [],
                                    'heading error [deg]': []}
    for method, estimate in estimates.items():
        estimated, true, stamps = aligned(truth.poses, estimate.poses)
        time, error = seconds(stamps, int(truth.stamp_ns[0])), np.abs(estimated - true)
        curves = (Curve(*_in_frame(estimated, true, truth.poses.pose[0]).T),
                  Curve(time, np.hypot(error[:, 0], error[:, 1])),
                  Curve(time, np.degrees(error[:, 2])))
        for own, curve in zip(marks.values(), curves):
            own.append(Mark(curve, METHODS[method], COLORS[method]))
    path = Panel([*marks.pop('path'), *truth_marks(Curve(*truth.poses.pose[:, :2].T))], 'x [m]',
                 'y [m]', equal=True)
    errors = [Panel(own, TIME_LABEL, label, y_limits=(0.0, MAX_SHOWN_ERROR * max(
        float(mark.curve.y.max()) for mark in own if mark.label in map(METHODS.get, shown))))
        for label, own in marks.items()]
    return Figure('run', title, f'{title}. {TWO_SIGMA}', [slips, [path, errors[0]],
                                                          [path, errors[1]]])


def _slip_panel(name: str, side: int, estimates: Mapping[str, Estimate], truth: Truth) -> Panel:
    origin, true = int(truth.stamp_ns[0]), side_means(truth.ratio)[:, side]
    marks = [Mark(Curve(seconds(one.slips.stamp_ns, origin), side_means(one.slips.ratio)[:, side],
                        side_means(one.slips.sigma)[:, side]), METHODS[method], COLORS[method])
             for method, one in estimates.items()]
    return Panel([*marks, *truth_marks(Curve(seconds(truth.stamp_ns, origin), true))], TIME_LABEL,
                 f'slip of the {name} side [-]', y_limits=limits([true], SLIP_MARGIN))


def _in_frame(estimated: Array, true: Array, first: Array) -> Array:
    """Return the positions of ``estimated`` in the frame where ``true`` begins at ``first``."""
    return rotated(estimated[:, :2] - true[0, :2], first[2] - true[0, 2]) + first[:2]
