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

"""Figures of one analysis: slip, path, friction and one crossing, as PNG files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from matplotlib.figure import Figure
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.analysis.curves import Curve, segments
from smart_tire.analysis.friction_figures import friction_figure
from smart_tire.analysis.friction_metrics import column, kind_of
from smart_tire.analysis.labels import label_estimates, LabeledEstimates
from smart_tire.analysis.metrics import Intervals
from smart_tire.analysis.path_figures import path_figure
from smart_tire.analysis.series import at, Floats, seconds, Series, time_origin
from smart_tire.analysis.slip_figures import slip_figure
from smart_tire.analysis.zoomed import Segments
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, WHEELS

WAVEFORM_REACH = 1.5  # patch lengths of travel drawn before and after a crossing


def write_figures(directory: Path, inputs: Series, estimates: Series, truth: Series,
                  robot: RobotParams, intervals: Intervals | None = None,
                  smoothed: Series | None = None,
                  wanted: Sequence[Floats] = ()) -> list[Path]:
    """
    Draw slip, path, friction and one crossing, where available; return the files.

    ``truth`` may be empty; with ``intervals`` each interval has its own slip panel; ``smoothed``
    estimates are drawn in addition to those of the filter; ``wanted`` are the paths (n, 2) that
    were to be followed. Of long recordings, the segments with
    the largest changes of the wheel speeds are also drawn in detail.
    """
    directory.mkdir(parents=True, exist_ok=True)
    written = []
    labeled = label_estimates(estimates, smoothed)
    for name, figure in _figures(inputs, labeled, truth, robot, intervals, wanted):
        written.append(directory / f'{name}.png')
        figure.savefig(written[-1], dpi=drawing.DOTS_PER_INCH)
    return written


def _figures(inputs: Series, labeled: LabeledEstimates, truth: Series, robot: RobotParams,
             intervals: Intervals | None,
             wanted: Sequence[Floats]) -> Iterator[tuple[str, Figure]]:
    estimates = next(iter(labeled.values()))
    origin = time_origin(estimates)
    parts = busiest_segments(inputs, origin)
    if len(estimates.slips().stamp_ns):
        yield 'slip', slip_figure(labeled, truth, origin, intervals, parts)
    if len(estimates.poses().stamp_ns):
        yield 'path', path_figure(labeled, truth, wanted)
    if estimates.crossings:
        yield 'friction', friction_figure(labeled, truth, origin, parts)
    for crossing in typical_crossings(estimates.crossings):
        waveform = crossing_waveform(crossing, inputs, robot)
        if waveform is not None:
            yield 'crossing', waveform_figure(waveform)
            return


def busiest_segments(inputs: Series, origin_ns: int) -> Segments:
    """Return the segments [s] in which the wheel speeds change most; none if not long."""
    stamps, speeds = inputs.speeds()
    time = seconds(stamps, origin_ns)
    return segments([Curve(time, speed) for speed in speeds.T])


def typical_crossings(crossings: Sequence[Friction]) -> list[Friction]:
    """Return crossings in traction, else of any known slip, nearest to the median slip first."""
    candidates = [p for p in crossings if kind_of(p) == 'traction'] or [
        p for p in crossings if np.isfinite(p.slip.value)]
    if not candidates:
        return []
    slips = column(candidates, 'slip')
    return [candidates[i] for i in np.argsort(np.abs(slips - np.median(slips)))]


def crossing_waveform(crossing: Friction, inputs: Series,
                      robot: RobotParams) -> drawing.CrossingWaveform | None:
    """Return the voltages around ``crossing``; None if samples or wheel speed are missing."""
    speeds_ns, speeds = inputs.speeds()
    stamp = np.array([crossing.stamp_ns])
    omega = at(stamp, speeds_ns, speeds)[0, WHEELS.index(crossing.wheel)]
    if crossing.wheel not in inputs.film_wheels() or not abs(omega) > 0.0:
        return None
    speed = robot.wheel_radius * omega
    reach = WAVEFORM_REACH * robot.tire.contact_length / abs(speed)
    stamps, volts = inputs.films(crossing.wheel)
    time = seconds(stamps, crossing.stamp_ns)
    shown = np.abs(time) <= reach
    if shown.sum() < 0.9 * 2.0 * reach * robot.film.sample_rate:
        return None  # a lost batch would leave a gap
    return drawing.CrossingWaveform(crossing.wheel, 1e3 * time[shown], volts[shown],
                                    _inside(robot, speed, volts.shape[1]))


def _inside(robot: RobotParams, speed: float, films: int) -> list[tuple[float, float]]:
    """Return the interval [ms] in which each film overlaps the patch at ``speed`` [m/s]."""
    half = 0.5 * (robot.tire.contact_length + robot.film.length) / abs(speed)
    # The timestamp of a crossing is that of the midpoint between the outer films.
    places = [robot.film.centers[film] for film in robot.film_groups[0][:films]]
    times = [(place - 0.5 * (places[0] + places[-1])) / speed for place in places]
    return [(1e3 * (time - half), 1e3 * (time + half)) for time in times]


def waveform_figure(waveform: drawing.CrossingWaveform) -> Figure:
    """Return the figure of one crossing."""
    figure, axes = drawing.new_figure([['crossing']])
    drawing.draw_waveform(axes['crossing'], waveform)
    drawing.finish(figure, axes)
    drawing.add_caption(
        figure, 'Samples of the films of one wheel. Bars: time in which a film overlaps the '
        'contact patch, from the wheel speed and the contact length. The crossing is where the '
        'center between the films is at the center of the patch.')
    return figure
