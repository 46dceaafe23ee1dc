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

"""Figure of the path and of its errors over time."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.analysis.curves import Curve, interrupted
from smart_tire.analysis.labels import FILTERED, LabeledEstimates
from smart_tire.analysis.metrics import aligned
from smart_tire.analysis.series import at, Floats, seconds, Series

PATH_COLORS = {FILTERED: drawing.ORANGE}  # if smoothed estimates are drawn, too


def path_figure(labeled: LabeledEstimates, truth: Series,
                wanted: Sequence[Floats] = ()) -> Figure:
    """
    Return the path and, with ground truth, position and heading errors over time.

    ``wanted`` are the paths (n, 2) that were to be followed.
    """
    paths = [drawing.Path(label, series.poses().pose[:, :2], PATH_COLORS.get(label, drawing.BLUE))
             for label, series in labeled.items()]
    _, true, _ = aligned(truth.poses(), next(iter(labeled.values())).poses())
    if not len(true):
        figure, axes = drawing.new_figure([['path']], width=6.0, height=5.8)
        drawing.draw_wanted(axes['path'], wanted)
        drawing.draw_path(axes['path'], paths, None)
        drawing.legend_above(figure, axes['path'])
        drawing.add_caption(figure, 'Path in the frame odom, which starts at (0, 0).')
        return figure
    figure, axes = drawing.new_figure([['path', 'position'], ['path', 'heading']], width=10.0,
                                      height=6.2)
    drawing.draw_wanted(axes['path'], wanted)
    drawing.draw_path(axes['path'], paths, true[:, :2])
    for path, series in zip(paths, labeled.values()):
        _draw_errors(axes, path, series, truth)
    axes['position'].set_ylim(bottom=0.0)
    drawing.legend_above(figure, axes['path'])
    drawing.add_caption(
        figure, 'Left: path in the frame odom, ground truth aligned at the start. Right: errors '
        'against ground truth; shaded: 2σ, where σ is the standard deviation that the estimator '
        'reports (of the position: along the longest axis of its ellipse). If it is right, about '
        '95 % of the heading errors are inside.')
    return figure


def _draw_errors(axes: dict[str, Axes], path: drawing.Path, estimates: Series,
                 truth: Series) -> None:
    poses = estimates.poses()
    estimate, true, stamps = aligned(truth.poses(), poses)
    time, error = seconds(stamps, int(poses.stamp_ns[0])), estimate - true
    covariance = at(stamps, poses.stamp_ns, poses.pose_covariance)
    longest = np.sqrt(np.linalg.eigvalsh(covariance[:, :2, :2])[:, -1])
    drawing.draw_error(
        axes['position'], interrupted(Curve(time, np.linalg.norm(error[:, :2], axis=1), longest)),
        'position error [m]', path)
    drawing.draw_error(
        axes['heading'], interrupted(Curve(time, error[:, 2], np.sqrt(covariance[:, 2, 2]))),
        'heading error [rad]', path)
