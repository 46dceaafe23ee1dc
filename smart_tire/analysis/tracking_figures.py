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

"""Figure of a followed path: wanted, driven as estimated and in truth, distance from it."""

from __future__ import annotations

from collections.abc import Iterator

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from smart_tire.analysis import drawing
from smart_tire.analysis.driven_paths import DrivenPath
from smart_tire.analysis.ground_areas import Grounds
from smart_tire.analysis.series import Floats
from smart_tire.analysis.tracking import track


def tracking_figure(drive: DrivenPath, grounds: Grounds | None = None) -> Figure:
    """
    Return the path in the plane, and the distance from it over the driven distance.

    ``grounds`` are shown below the path; they do not change the limits of the axes.
    """
    figure, axes = drawing.new_figure([['path', 'error']], width=10.0, height=4.6)
    drawing.draw_wanted(axes['path'], [drive.wanted])
    has_truth = bool(len(drive.true))
    drawing.draw_path(axes['path'], [drawing.Path('driven, estimate', drive.estimated)],
                      drive.true if has_truth else None)
    if grounds is not None:
        drawing.draw_areas(axes['path'], [
            (area.surface, area.corners) for area in grounds.areas])
    _draw_error(axes['error'], drive.wanted, drive.estimated, drive.true)
    drawing.legend_above(figure, axes['path'])
    drawing.add_caption(figure, ' '.join(_caption(has_truth, grounds)))
    return figure


def _caption(has_truth: bool, grounds: Grounds | None) -> Iterator[str]:
    """Yield the sentences of the caption."""
    yield 'Left: path in the frame odom' + (
        ', ground truth aligned with the estimate where the path begins.' if has_truth else '.')
    if grounds is not None and grounds.areas:
        yield f'Around the shaded patches: {grounds.base}.'
    yield ('Right: distance from the wanted path, positive to the left of its direction'
           + ('; that in truth contains the error of the localization.' if has_truth else '.'))


def _draw_error(ax: Axes, wanted: Floats, estimated: Floats, true: Floats) -> None:
    for positions, style in ((estimated, {'color': drawing.BLUE, 'linewidth': 1.6}),
                             (true, drawing.TRUTH)):
        tracking = track(wanted, positions)
        if tracking is not None:
            ax.plot(tracking.driven, tracking.error, **style)
    ax.axhline(0.0, color=drawing.SHADE, linewidth=1.0)
    ax.set(xlabel='driven distance [m]', ylabel='distance from the path [m]')
