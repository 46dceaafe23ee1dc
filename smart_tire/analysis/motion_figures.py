# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Figures of motion: slip, path, velocity, wheel speeds and a followed path."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle

import numpy as np

from smart_tire.analysis.dead_reckoning import GYRO_WHEELS
from smart_tire.analysis.driven_paths import DrivenPath, Grounds, track
from smart_tire.analysis.errors import error_panel, pose_errors, position_error, TWIST_NAMES
from smart_tire.analysis.figure import (
    Curve, ellipse, Figure, GAP, interrupted, Limits, limits, Mark, MAX_GAP, MAX_POINTS,
    MAX_SLIP_SIGMA, observable, outside_caption, PAIR, Panel, reference_caption, reference_marks,
    REPORTED, SOURCES, TIME_LABEL, TRUTH, truth_marks, TWO_SIGMA)
from smart_tire.analysis.metrics import (
    carried, compared_poses, ComparedPoses, measured, SE2, SIDES, START, UNALIGNED)
from smart_tire.analysis.result import Comparison, Result
from smart_tire.arrays import Array
from smart_tire.estimates import PoseEstimate, SlipEstimate
from smart_tire.recording import SampleArrays, seconds
from smart_tire.samples import NS_PER_S, WHEELS

MIN_SLIP_MARGIN, MAX_SHOWN_SLIP = 0.1, 1.05  # -, of the slip axis
ELLIPSES = 12  # along a path
SIDE_COLORS = {'left': 'blue', 'right': 'vermillion'}
WHEEL_COLORS = dict(zip(WHEELS, ('blue', 'vermillion', 'sky', 'orange')))
WHEEL_GROUPS = {wheel: (index,) for index, wheel in enumerate(WHEELS)}
AREA_COLORS = 'sky', 'orange', 'vermillion', 'blue'
RUN_COLORS = 'orange', 'blue', 'vermillion', 'sky', 'green'
BASELINE_COLOR = 'purple'
ALIGNED = {SE2: 'moved and turned to the least squared distances from it',
           UNALIGNED: 'not aligned with it'}
ESTIMATE = 'estimate ± 2σ'
NONE = Curve(np.empty(0), np.empty(0))


@dataclass(frozen=True)
class SlipCurve:
    """Slip of one side or wheel over time; NaN leaves a gap."""

    name: str
    estimate: Curve
    references: Mapping[str, Curve]  # by name
    hidden_share: float  # of the estimates, which are not drawn


def slip_curves(estimates: SampleArrays, references: Mapping[str, SampleArrays], origin_ns: int,
                groups: Mapping[str, Sequence[int]] = SIDES) -> list[SlipCurve]:
    """Return the slip of each group of wheels, the mean of the measured ones; NaN if unknown."""
    found = []
    for name, members in groups.items():
        wheels = measured(estimates.slips().ratio, members)
        curve, hidden = mean_slip(estimates.slips(), wheels, origin_ns)
        others = {source: mean_slip(one.slips(), wheels, origin_ns)[0]
                  for source, one in references.items()}
        found.append(SlipCurve(name, curve, _exact(others), hidden))
    return found


def mean_slip(slips: SlipEstimate, wheels: Sequence[int], origin_ns: int) -> tuple[Curve, float]:
    """Return the mean slip of ``wheels``, and the share of it that is not shown."""
    return observable(interrupted(Curve(
        seconds(slips.stamp_ns, origin_ns), slips.ratio[:, wheels].mean(axis=1),
        slips.sigma[:, wheels].mean(axis=1))))


def _exact(curves: Mapping[str, Curve]) -> dict[str, Curve]:
    """Return the curves of references, that of ground truth without sigma."""
    return {name: replace(curve, sigma=None) if name == TRUTH else curve
            for name, curve in curves.items()}


def side_marks(curves: Sequence[SlipCurve]) -> list[Mark]:
    """Return the slip of both sides, as in paper B, Fig. 10."""
    return [*(Mark(one.estimate, f'{one.name} side ± 2σ', SIDE_COLORS[one.name])
              for one in curves),
            *(mark for one in curves for mark in reference_marks(one.references))]


def slip_figure(result: Result) -> Figure | None:
    """Return the slip of both sides, one panel per interval and label; None without slip."""
    if not len(result.estimates.slips().stamp_ns):
        return None
    curves = {label: slip_curves(one.estimates, result.references, result.origin_ns)
              for label, one in result.comparisons.items()}
    every = [one for several in curves.values() for one in several]
    spans = {name: [((begin - result.origin_ns) / NS_PER_S, (end - result.origin_ns) / NS_PER_S)
                    for begin, end in times] for name, times in result.intervals.items()}
    low, high, caption = _shown_slip(every, [span for one in spans.values() for span in one])
    panels = [_slip_panel(side_marks(own), ', '.join(filter(None, (
        name, label if len(curves) > 1 else ''))), (low, high), times)
        for name, times in (spans or {'': []}).items() for label, own in curves.items()]
    rows: list[list[Panel | None]] = [[panel] for panel in panels]
    if spans:
        rows = [[*panels[i:i + 2], *[None] * (i > 0 and i + 1 == len(panels))]
                for i in range(0, len(panels), 2)]
    return Figure('slip', 'Slip ratio of both sides over time',
                  f'Mean slip ratio of the two wheels of a side. {caption}', rows,
                  (9.0 / len(rows[0]), 2.8), () if spans else result.segments)


def wheel_slip_figure(result: Result) -> Figure | None:
    """Return the slip of each wheel; None without."""
    if not len(result.estimates.slips().stamp_ns):
        return None
    curves = slip_curves(result.estimates, result.references, result.origin_ns, WHEEL_GROUPS)
    low, high, caption = _shown_slip(curves)
    return Figure(
        'slip', 'Longitudinal slip ratio of each wheel over time',
        f'Longitudinal slip ratio, positive in traction. {caption} Double-click to show all.',
        [[_slip_panel([Mark(one.estimate, ESTIMATE), *reference_marks(one.references)],
                      one.name.replace('_', ' '), (low, high))] for one in curves])


def _slip_panel(marks: Sequence[Mark], title: str, y_limits: Limits,
                times: Sequence[tuple[float, float]] = ()) -> Panel:
    edges = [edge for span in times for edge in span]
    return Panel(marks, TIME_LABEL, 'slip ratio [-]', title,
                 (min(edges), max(edges)) if edges else None, y_limits)


def _shown_slip(curves: Sequence[SlipCurve], spans: Sequence[tuple[float, float]] = ()
                ) -> tuple[float, float, str]:
    """Return the limits of the slip axis within ``spans`` [s], and what is not shown."""
    def values(curve: Curve) -> Array:
        return curve.y[np.any([(curve.x >= begin) & (curve.x <= end) for begin, end in spans],
                              axis=0)] if spans else curve.y

    own = [values(one.estimate) for one in curves]
    others = [values(other) for one in curves for other in one.references.values()]
    low, high = limits([*own, *others], MIN_SLIP_MARGIN)
    low, high = max(-MAX_SHOWN_SLIP, low), min(MAX_SHOWN_SLIP, high)
    hidden = float(np.mean([one.hidden_share for one in curves]))
    drawn = reference_caption(
        name for name, curve in curves[0].references.items() if len(curve.x))
    return low, high, (
        f'Bands: {TWO_SIGMA}{drawn} No line at standstill, where slip is undefined, and where σ '
        f'exceeds {MAX_SLIP_SIGMA}, where it is not observable ({100.0 * hidden:.1f} % of the '
        'values).' + outside_caption(own, low, high))


def path_figure(result: Result, *, errors: bool = True) -> Figure | None:
    """Return the path and, with a reference, its ``errors``; None without poses."""
    first = result.filtered.estimates.poses()
    return paths_figure(
        result.comparisons, [(name, compared_poses(first, one.poses()))
                             for name, one in result.references.items()],
        result.wanted, errors=errors)


def comparison_figure(runs: Mapping[str, Comparison]) -> Figure | None:
    """Return the paths of ``runs`` by label and their errors; None without poses."""
    distinct: dict[int, tuple[str, ComparedPoses]] = {}
    for one in runs.values():
        if len(one.poses.stamp_ns):
            distinct.setdefault(id(one.reference), (one.name, one.path[1]))
    figure = paths_figure(runs, list(distinct.values()))
    return figure and replace(figure, name='comparison', title='Paths of all runs, their errors')


def paths_figure(runs: Mapping[str, Comparison], references: Sequence[tuple[str, ComparedPoses]],
                 wanted: Sequence[Array] = (), *, errors: bool = True) -> Figure | None:
    """
    Return the paths of ``runs`` by label and, with a reference, position and heading ``errors``.

    Ellipses show two standard deviations of the position at about equal distances. The baseline is
    that of the first run. None without poses.
    """
    runs = {label: one for label, one in runs.items() if len(one.estimates.poses().stamp_ns)}
    if not runs:
        return None
    head = next(iter(runs.values()))
    colors = dict(zip(runs, PAIR if len(runs) == 1 else cycle(RUN_COLORS)))
    drawn = [(name, _reference_path(one)) for name, one in references if len(one.stamp_ns)]
    base = head.baselines.get(GYRO_WHEELS)
    marks = [*wanted_marks(wanted)]
    if base is not None:
        marks.append(_path(carried(base.estimated, base.true[0], head.path[1].true[0]),
                           GYRO_WHEELS, BASELINE_COLOR))
    for label, one in runs.items():
        if one.align == START:
            marks.append(_ellipses(one.path[0], one.estimates.poses().covariance, colors[label]))
        marks.append(_path(one.path[0], label, colors[label]))
    marks += [mark for name, curve in drawn for mark in reference_marks({name: curve})]
    marks += [_dot(head.path[0][:1], 'start'), _dot(head.path[0][-1:], 'end', 'shade')]
    panel = Panel(marks, 'x [m]', 'y [m]', equal=True)
    names = dict.fromkeys(name for name, _ in drawn)
    caption = _path_caption(head.align, names)
    if base is not None and len(runs) > 1:
        caption += f' {GYRO_WHEELS.capitalize()}: of {next(iter(runs))}.'
    rows: list[list[Panel | None]] = [[panel]]
    compared = {label: (one.poses, one.origin_ns) for label, one in runs.items()
                if len(one.poses.stamp_ns)}
    if errors and compared and head.name in names:
        compared |= {} if base is None else {GYRO_WHEELS: (base, head.origin_ns)}
        curves = [(position_error(*one), pose_errors(*one)[2]) for one in compared.values()]
        shown = {label: colors.get(label, BASELINE_COLOR) for label in compared}
        rows = [[panel, error_panel(several, shown, bottom=bottom)]
                for several, bottom in zip(zip(*curves), (0.0, None))]
        caption += f' Right: errors against {SOURCES[head.name]}'
        caption += '.' if head.align == SE2 else (
            '; shaded: 2σ, where σ is the '
            f'standard deviation {REPORTED[head.name]} (of the position: along the '
            'longest axis of its ellipse). If it is right, about 95 % of the heading errors are '
            'inside.')
    return Figure('path', 'Path of the robot in the plane, estimate and reference', caption,
                  rows, (5.0, 2.5) if len(rows) > 1 else (6.0, 4.6 if errors else 7.6))


def _path_caption(align: str, references: Iterable[str]) -> str:
    """Return how paths are drawn."""
    drawn = reference_caption(references)
    if align != START:
        return f'Paths in the frame of the reference, {ALIGNED[align]}.{drawn}'
    return ('Path in the frame odom, which starts at (0, 0)'
            + (', references aligned at the start' if drawn else '') + f'.{drawn} '
            'Ellipses: two standard deviations of the position; they contain 86 % of Gaussian '
            'errors.')


def wanted_marks(paths: Sequence[Array]) -> list[Mark]:
    """Return the paths (n, 2) that were to be followed."""
    return [Mark(Curve(*path.T), 'wanted', 'shade', width=5.0, opacity=0.4) for path in paths]


def _path(position: Array, label: str, color: str = 'blue') -> Mark:
    position = position[equidistant(position[:, :2])]
    return Mark(Curve(position[:, 0], position[:, 1]), label, color, width=1.6)


def _reference_path(found: ComparedPoses) -> Curve:
    """Return the path of a reference, interrupted in the gaps of its timestamps."""
    parts = np.split(found.true[:, :2], np.flatnonzero(
        np.diff(found.stamp_ns) > MAX_GAP * NS_PER_S) + 1)
    return Curve(*np.concatenate([
        rows for part in parts for rows in (part[equidistant(part)], GAP)])[:-1].T)


def _dot(position: Array, label: str, color: str = 'ink') -> Mark:
    return Mark(Curve(position[:, 0], position[:, 1]), label, color, 'points', 6.0)


def equidistant(position: Array, limit: int = MAX_POINTS) -> np.ndarray[
        tuple[int], np.dtype[np.intp]]:
    """Return at most ``limit`` rows of a path (n, 2), about equally spaced along it."""
    if len(position) <= limit:
        return np.arange(len(position))
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    travel = np.append(0.0, np.cumsum(steps))
    cells = np.floor(travel * ((limit - 2) / max(travel[-1], 1e-9)))
    return np.unique(np.append(np.unique(cells, return_index=True)[1], len(position) - 1))


def _ellipses(position: Array, covariance: Array, color: str) -> Mark:
    """Return ellipses of two standard deviations at about equal distances along a path."""
    parts = []
    for row in equidistant(position[:, :2], ELLIPSES + 1):
        parts += [position[row, :2] + ellipse(covariance[row, :2, :2]), GAP]
    return Mark(Curve(*np.concatenate(parts).T), '2σ of the position', color, 'area', opacity=0.2)


def velocity_figure(result: Result) -> Figure | None:
    """Return the velocities of the body; None without poses."""
    poses = result.estimates.poses()
    if not len(poses.stamp_ns):
        return None
    known = {name: other for name, one in result.references.items()
             if np.isfinite((other := one.poses()).twist).any()}

    def curve_of(series: PoseEstimate, i: int) -> Curve:
        return interrupted(Curve(seconds(series.stamp_ns, result.origin_ns), series.twist[:, i],
                                 series.twist_sigma[:, i]))
    panels = []
    for i, ((name, unit), title) in enumerate(zip(
            TWIST_NAMES, ('forward velocity v_x', 'lateral velocity v_y', 'yaw rate'))):
        marks = [Mark(curve_of(poses, i), ESTIMATE), *reference_marks(_exact({
            source: curve_of(one, i) for source, one in known.items()}))]
        panels.append(Panel(marks, TIME_LABEL, f'{name} [{unit}]', title,
                            y_limits=limits([mark.curve.y for mark in marks], 0.05)))
    return Figure('velocity', 'Forward velocity, lateral velocity and yaw rate over time',
                  'Velocity of base_link (x forward, y left, yaw counter-clockwise). Bands: '
                  f'{TWO_SIGMA}{reference_caption(known)}', [[panel] for panel in panels])


def wheel_speed_figure(result: Result) -> Figure | None:
    """Return the measured speeds of the wheels; None without."""
    stamps, speeds = result.inputs.speeds()
    if not len(stamps):
        return None
    marks = [Mark(interrupted(Curve(seconds(stamps, result.origin_ns), speed), max_gap=1.0),
                  wheel.replace('_', ' '), color)
             for speed, (wheel, color) in zip(speeds.T, WHEEL_COLORS.items())]
    return Figure('wheel_speeds', 'Measured speeds of the four wheels over time',
                  'Measured wheel speeds, the input that shows what the robot was doing. '
                  'Lines are interrupted where no message arrived for 1 s.',
                  [[Panel(marks, TIME_LABEL, 'speed [rad/s]', 'Wheel speeds')]])


def tracking_figure(drive: DrivenPath, grounds: Grounds | None = None) -> Figure:
    """
    Return a followed path in the plane, and the distance from it over the driven distance.

    ``grounds`` are shown below the path; they do not change the limits of the axes.
    """
    shaded = () if grounds is None else grounds.areas
    colors = dict(zip(dict.fromkeys(area.surface for area in shaded), cycle(AREA_COLORS)))
    marks = [*wanted_marks([drive.wanted]), _path(drive.estimated, 'driven, estimate')]
    marks += truth_marks(_path(drive.true, '').curve)
    marks += [_dot(drive.estimated[:1], 'start'), *(
        Mark(Curve(*area.corners.T), area.surface, colors[area.surface], 'area', opacity=0.13)
        for area in shaded)]
    return Figure(
        'tracking', 'Path that was followed, and the distance from it',
        ' '.join(_tracking_caption(bool(len(drive.true)), grounds)),
        [[Panel(marks, 'x [m]', 'y [m]', equal=True),
          Panel(_tracking_errors(drive), 'driven distance [m]', 'distance from the path [m]')]],
        (5.0, 3.4))


def _tracking_errors(drive: DrivenPath) -> list[Mark]:
    own, true = (NONE if found is None else Curve(found.driven, found.error) for found in (
        track(drive.wanted, positions) for positions in (drive.estimated, drive.true)))
    ends = np.array([0.0, max(own.x.max(initial=0.0), true.x.max(initial=0.0))])
    return [Mark(Curve(ends, np.zeros(2)), '', 'shade', width=1.0),
            Mark(own, 'driven, estimate', width=1.6), *truth_marks(true)]


def _tracking_caption(has_truth: bool, grounds: Grounds | None) -> Iterator[str]:
    """Yield the sentences of the caption."""
    yield 'Left: path in the frame odom' + (
        ', ground truth aligned with the estimate where the path begins.' if has_truth else '.')
    if grounds is not None and grounds.areas:
        yield f'Around the shaded patches: {grounds.base}.'
    yield ('Right: distance from the wanted path, positive to the left of its direction'
           + ('; that in truth contains the error of the localization.' if has_truth else '.'))
