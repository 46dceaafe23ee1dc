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

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from smart_tire.analysis import drawing
from smart_tire.analysis.friction_metrics import column, is_informative, kind_of
from smart_tire.analysis.metrics import aligned, Intervals, SIDES
from smart_tire.analysis.series import at, seconds, Series, Stamps
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, WHEELS

SLIP_MARGIN = 0.2      # of the slip range, above and below
MIN_SLIP_MARGIN = 0.1  # -
MAX_FRICTION = 1.2     # upper end of the friction axis
WAVEFORM_REACH = 1.5   # patch lengths of travel drawn before and after a crossing
FILTERED = 'filtered'
PATH_COLORS = {FILTERED: drawing.ORANGE}  # if smoothed estimates are drawn, too

LabeledEstimates = Mapping[str, Series]  # label -> estimates, those of the filter first


def write_figures(directory: Path, inputs: Series, estimates: Series, truth: Series,
                  robot: RobotParams, intervals: Intervals | None = None,
                  smoothed: Series | None = None) -> list[Path]:
    """
    Draw slip, path, friction and one crossing, where available; return the files.

    ``truth`` may be empty; with ``intervals`` each interval has its own slip panel; ``smoothed``
    estimates are drawn in addition to those of the filter.
    """
    directory.mkdir(parents=True, exist_ok=True)
    written = []
    labeled = label_estimates(estimates, smoothed)
    for name, figure in _figures(inputs, labeled, truth, robot, intervals):
        written.append(directory / f'{name}.png')
        figure.savefig(written[-1], dpi=drawing.DOTS_PER_INCH)
    return written


def label_estimates(estimates: Series, smoothed: Series | None = None) -> LabeledEstimates:
    """Return the estimates by label."""
    return {'estimate': estimates} if smoothed is None else {
        FILTERED: estimates, 'smoothed': smoothed}


def _figures(inputs: Series, labeled: LabeledEstimates, truth: Series, robot: RobotParams,
             intervals: Intervals | None) -> Iterator[tuple[str, Figure]]:
    estimates = next(iter(labeled.values()))
    origin = time_origin(estimates)
    if len(estimates.slips().stamp_ns):
        yield 'slip', slip_figure(labeled, truth, origin, intervals)
    if len(estimates.poses().stamp_ns):
        yield 'path', path_figure(labeled, truth)
    if estimates.crossings:
        yield 'friction', friction_figure(labeled, truth, origin)
    for crossing in typical_crossings(estimates.crossings):
        waveform = crossing_waveform(crossing, inputs, robot)
        if waveform is not None:
            yield 'crossing', waveform_figure(waveform)
            return


def time_origin(estimates: Series) -> int:
    """Return the timestamp [ns] of the first estimate, at which the time axes are zero."""
    stamps = np.concatenate([estimates.slips().stamp_ns, estimates.poses().stamp_ns,
                             stamps_of(estimates.crossings)])
    return int(stamps.min(initial=np.iinfo(np.int64).max))


def slip_figure(labeled: LabeledEstimates, truth: Series, origin_ns: int,
                intervals: Intervals | None = None) -> Figure:
    """Return the slip of both sides over time, one panel per label and interval."""
    curves = {label: slip_curves(series, truth, origin_ns) for label, series in labeled.items()}
    panels = {_title(labeled, label, name): (own, name)
              for name in intervals or [''] for label, own in curves.items()}
    names, columns = list(panels), 2 if intervals else 1
    rows = [names[i:i + columns] for i in range(0, len(names), columns)]
    rows[-1] += ['.'] * (len(rows[0]) - len(rows[-1]))
    figure, axes = drawing.new_figure(rows, height=1.2 + 2.8 * len(rows), share_x=not intervals,
                                      share_y=True)
    for title, (own, name) in panels.items():
        drawing.draw_slip(axes[title], own)
        axes[title].set(title=title)
        if intervals:
            edges = [(edge - origin_ns) / NS_PER_S
                     for interval in intervals[name] for edge in interval]
            axes[title].set(xlim=(min(edges), max(edges)))
    axes[names[0]].set_ylim(*_slip_limits([curve for own in curves.values() for curve in own]))
    drawing.finish(figure, axes)
    return figure


def _title(labeled: LabeledEstimates, label: str, name: str) -> str:
    """Return the title of a panel; a single label is omitted."""
    return ', '.join(word for word in (name, label if len(labeled) > 1 else '') if word)


def slip_curves(estimates: Series, truth: Series, origin_ns: int) -> list[drawing.SlipCurve]:
    """Return the slip of each side, the mean of its measured wheels."""
    own, true = estimates.slips(), truth.slips()
    sides = {side: own.measured(wheels) for side, wheels in SIDES.items()}
    return [drawing.SlipCurve(
        side, seconds(own.stamp_ns, origin_ns), own.ratio[:, wheels].mean(axis=1),
        own.sigma[:, wheels].mean(axis=1), seconds(true.stamp_ns, origin_ns),
        true.ratio[:, wheels].mean(axis=1)) for side, wheels in sides.items()]


def _slip_limits(curves: Sequence[drawing.SlipCurve]) -> tuple[float, float]:
    slips = np.concatenate([np.append(curve.slip, curve.true_slip) for curve in curves])
    slips = slips[np.isfinite(slips)]
    # Percentiles, because slip has spikes when wheels start to turn.
    low, high = np.percentile(slips, (1.0, 99.0)) if len(slips) else (0.0, 0.0)
    margin = max(SLIP_MARGIN * (high - low), MIN_SLIP_MARGIN)
    return max(-1.05, low - margin), min(1.05, high + margin)


def path_figure(labeled: LabeledEstimates, truth: Series) -> Figure:
    """Return the path and, with ground truth, position and heading errors over time."""
    paths = [drawing.Path(label, series.poses().pose[:, :2], PATH_COLORS.get(label, drawing.BLUE))
             for label, series in labeled.items()]
    _, true, _ = aligned(truth.poses(), next(iter(labeled.values())).poses())
    if not len(true):
        figure, axes = drawing.new_figure([['path']], width=6.0, height=5.5)
        drawing.draw_path(axes['path'], paths, None)
    else:
        figure, axes = drawing.new_figure([['path', 'position'], ['path', 'heading']], width=10.0,
                                          height=5.5)
        drawing.draw_path(axes['path'], paths, true[:, :2])
        for path, series in zip(paths, labeled.values()):
            _draw_errors(axes, path, series, truth)
        axes['position'].set_ylim(bottom=0.0)
        axes['position'].legend(frameon=False)
    axes['path'].legend(frameon=False)
    return figure


def _draw_errors(axes: dict[str, Axes], path: drawing.Path, estimates: Series,
                 truth: Series) -> None:
    poses = estimates.poses()
    estimate, true, stamps = aligned(truth.poses(), poses)
    time, error = seconds(stamps, int(poses.stamp_ns[0])), estimate - true
    covariance = at(stamps, poses.stamp_ns, poses.pose_covariance)
    longest = np.sqrt(np.linalg.eigvalsh(covariance[:, :2, :2])[:, -1])
    drawing.draw_error(axes['position'], time, np.linalg.norm(error[:, :2], axis=1), longest,
                       'position error [m]', path)
    drawing.draw_error(axes['heading'], time, error[:, 2], np.sqrt(covariance[:, 2, 2]),
                       'heading error [rad]', path)


def friction_figure(labeled: LabeledEstimates, truth: Series, origin_ns: int) -> Figure:
    """Return friction per crossing, one panel per instrumented wheel and label."""
    wheels = [wheel for wheel in WHEELS
              if any(p.wheel == wheel for series in labeled.values() for p in series.crossings)]
    rows = [[_title(labeled, label, wheel.replace('_', ' ')) for label in labeled]
            for wheel in wheels]
    figure, axes = drawing.new_figure(rows, height=1.2 + 2.6 * len(wheels), share_x=True,
                                      share_y=True)
    for wheel, titles in zip(wheels, rows):
        for title, series in zip(titles, labeled.values()):
            drawing.draw_friction(axes[title], friction_curve(wheel, series, truth, origin_ns))
            axes[title].set(title=title)
    axes[rows[0][0]].set_ylim(0.0, MAX_FRICTION)
    drawing.finish(figure, axes)
    return figure


def friction_curve(wheel: str, estimates: Series, truth: Series,
                   origin_ns: int) -> drawing.FrictionCurve:
    """Return the friction of ``wheel``; uninformative single estimates are NaN."""
    own, true = of_wheel(estimates.crossings, wheel), of_wheel(truth.crossings, wheel)
    single = column(own, 'friction_coefficient_single')
    sigma = column(own, 'friction_coefficient_single', sigmas=True)
    single[~is_informative(single, sigma)] = np.nan
    return drawing.FrictionCurve(
        wheel, seconds(stamps_of(own), origin_ns), single, sigma,
        column(own, 'friction_coefficient'),
        column(own, 'friction_coefficient', sigmas=True),
        seconds(stamps_of(true), origin_ns), column(true, 'friction_coefficient'))


def of_wheel(crossings: Sequence[Friction], wheel: str) -> list[Friction]:
    """Return the crossings of ``wheel`` in order of time."""
    return sorted((p for p in crossings if p.wheel == wheel), key=lambda p: p.stamp_ns)


def stamps_of(crossings: Sequence[Friction]) -> Stamps:
    """Return the timestamps [ns] of ``crossings``."""
    return np.array([crossing.stamp_ns for crossing in crossings], np.int64)


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
    return figure
