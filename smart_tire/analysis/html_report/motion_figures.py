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

"""Interactive figures of motion: path, velocity, wheel speeds, slip and ground."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.analysis.curves import (
    Curve, interrupted, limits, MAX_SLIP_SIGMA, observable, share_outside)
from smart_tire.analysis.errors import TWIST_NAMES
from smart_tire.analysis.html_report.decimation import equidistant
from smart_tire.analysis.html_report.layout import Figure, Panel
from smart_tire.analysis.html_report.traces import estimate, line, numbers, SIGMAS, Spec, truth
from smart_tire.analysis.metrics import aligned
from smart_tire.analysis.series import Floats, seconds, Series
from smart_tire.samples import WHEELS

ELLIPSES = 12        # along the path
ELLIPSE_POINTS = 48
WHEEL_COLORS = dict(zip(WHEELS, ('blue', 'vermillion', 'sky', 'orange')))
ESTIMATE = 'estimate ± 2σ'
BAND = 'Shaded bands: ± 2σ, where σ is the standard deviation that the estimator reports.'
TRUTH = 'Dashed: ground truth.'
GROUND_LABELS = 'C<sub>x</sub> [N]', 'rolling resistance [-]'


def path_figure(estimates: Series, true_poses: Series,
                wanted: Sequence[Floats] = ()) -> Figure | None:
    """
    Return the path with ellipses of two standard deviations; None without poses.

    ``wanted`` are the paths (n, 2) that were to be followed.
    """
    poses = estimates.poses()
    if not len(poses.stamp_ns):
        return None
    position = poses.pose[:, :2]
    rows = equidistant(position)
    traces = [_xy(path, 'wanted', {'color': '@ink', 'width': 5}) for path in wanted]
    for number, trace in enumerate(traces):
        trace.update(opacity=0.25, showlegend=number == 0)
    traces.append(_ellipses(position, poses.pose_covariance))
    traces.append(_xy(position[rows], 'estimate', {'color': '@blue', 'width': 2}))
    true = aligned(true_poses.poses(), poses)[1]
    if len(true):
        traces.append(_xy(true[equidistant(true[:, :2]), :2], 'truth',
                          {'color': '@ink', 'width': 1.4, 'dash': 'dash'}))
    traces += [_mark(position[0], 'start', 'circle'), _mark(position[-1], 'end', 'square')]
    return Figure(
        'path', 'Path of the robot in the plane, estimate and ground truth',
        'Path of the robot in the frame odom. Ellipses: two standard deviations of the position; '
        'they contain 86 % of Gaussian errors.' + (
            f' {TRUTH} It is aligned with the estimate at the start.' if len(true) else ''),
        [Panel('Path', 'y [m]', traces)], 'x [m]', 460,
        {'hovermode': 'closest', 'yaxis': {'scaleanchor': 'x', 'scaleratio': 1}})


def _xy(position: Floats, name: str, style: Spec) -> Spec:
    return {'type': 'scatter', 'mode': 'lines', 'name': name, 'line': style,
            'x': numbers(position[:, 0]), 'y': numbers(position[:, 1]),
            'hovertemplate': 'x %{x:.3f} m, y %{y:.3f} m'}


def _mark(position: Floats, name: str, symbol: str) -> Spec:
    return {'type': 'scatter', 'mode': 'markers', 'name': name,
            'x': numbers(position[:1]), 'y': numbers(position[1:]),
            'marker': {'symbol': symbol, 'size': 9, 'color': '@ink'},
            'hovertemplate': 'x %{x:.3f} m, y %{y:.3f} m'}


def _ellipses(position: Floats, covariance: Floats) -> Spec:
    """Return ellipses at about equal distances along the path, as one trace."""
    angle = np.linspace(0.0, 2.0 * math.pi, ELLIPSE_POINTS)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    parts = []
    for row in equidistant(position, ELLIPSES + 1):
        values, vectors = np.linalg.eigh(covariance[row, :2, :2])
        shape = vectors @ (SIGMAS * np.sqrt(np.maximum(values, 0.0))[:, None] * circle)
        parts += [position[row] + shape.T, np.full((1, 2), math.nan)]
    drawn = np.concatenate(parts)
    return {'type': 'scatter', 'mode': 'lines', 'fill': 'toself', 'name': '2σ of the position',
            'x': numbers(drawn[:, 0]), 'y': numbers(drawn[:, 1]), 'fillcolor': '@blue_band',
            'line': {'color': '@blue', 'width': 0.8}, 'hoverinfo': 'skip'}


def velocity_figure(estimates: Series, truths: Series, origin_ns: int) -> Figure | None:
    """Return the velocities of the body; None without poses."""
    poses, true = estimates.poses(), truths.poses()
    if not len(poses.stamp_ns):
        return None
    time, sigma = seconds(poses.stamp_ns, origin_ns), np.sqrt(poses.twist_variance)
    known = np.isfinite(true.twist).any()
    panels = []
    for i, ((name, unit), long) in enumerate(zip(TWIST_NAMES, ('forward', 'lateral', 'yaw rate'))):
        own = interrupted(Curve(time, poses.twist[:, i], sigma[:, i]))
        traces = estimate(own, ESTIMATE, 'blue', f' {unit}', legend=i == 0)
        if known:
            traces.append(truth(interrupted(Curve(
                seconds(true.stamp_ns, origin_ns), true.twist[:, i])), f' {unit}', legend=i == 0))
        panels.append(Panel(long if i == 2 else f'{long} velocity {name}', f'{name} [{unit}]',
                            traces, limits([poses.twist[:, i], true.twist[:, i]], 0.05)))
    return Figure('velocity', 'Forward velocity, lateral velocity and yaw rate over time',
                  f'Velocity of base_link (x forward, y left, yaw counter-clockwise). {BAND}'
                  + (f' {TRUTH}' if known else ''), panels)


def wheel_speed_figure(inputs: Series, origin_ns: int) -> Figure | None:
    """Return the measured speeds of the wheels; None without."""
    stamps, speeds = inputs.speeds()
    if not len(stamps):
        return None
    traces = []
    for i, (wheel, color) in enumerate(WHEEL_COLORS.items()):
        curve = interrupted(Curve(seconds(stamps, origin_ns), speeds[:, i]), max_gap=1.0)
        traces.append(line(curve, wheel.replace('_', ' '), f'@{color}', ' rad/s'))
    return Figure('wheel_speeds', 'Measured speeds of the four wheels over time',
                  'Measured wheel speeds, the input that shows what the robot was doing. '
                  'Lines are interrupted where no message arrived for 1 s.',
                  [Panel('Wheel speeds', 'speed [rad/s]', traces)])


def slip_figure(estimates: Series, truths: Series, origin_ns: int) -> Figure | None:
    """Return the slip of each wheel; None without."""
    own, true = estimates.slips(), truths.slips()
    if not len(own.stamp_ns):
        return None
    time, true_time = seconds(own.stamp_ns, origin_ns), seconds(true.stamp_ns, origin_ns)
    curves, hidden = zip(*(observable(interrupted(Curve(time, own.ratio[:, i], own.sigma[:, i])))
                           for i in range(len(WHEELS))))
    low, high = limits([*(curve.value for curve in curves), true.ratio], 0.1)
    low, high = max(low, -1.05), min(high, 1.05)
    panels = []
    for i, wheel in enumerate(WHEELS):
        traces = estimate(curves[i], ESTIMATE, 'blue', '', legend=i == 0)
        if len(true_time):
            traces.append(truth(interrupted(Curve(true_time, true.ratio[:, i])), '',
                                legend=i == 0))
        panels.append(Panel(wheel.replace('_', ' '), 'slip ratio [-]', traces, (low, high)))
    outside = share_outside([curve.value for curve in curves], low, high)
    return Figure(
        'slip', 'Longitudinal slip ratio of each wheel over time',
        'Longitudinal slip ratio, positive in traction; undefined at standstill. '
        f'{BAND} {TRUTH if len(true_time) else ""} Not drawn: {100.0 * np.mean(hidden):.1f} % of '
        f'the values, with σ above {MAX_SLIP_SIGMA}, where slip is not observable. '
        f'{100.0 * outside:.1f} % of the others are outside of the axes at first: double-click to '
        'show all.', panels)


def ground_figure(estimates: Series, truths: Series, origin_ns: int) -> Figure | None:
    """Return stiffness and rolling resistance of the ground; None without."""
    ground = estimates.grounds()
    if not len(ground.stamp_ns):
        return None
    time, panels = seconds(ground.stamp_ns, origin_ns), []
    for i, label in enumerate(GROUND_LABELS):
        own = interrupted(Curve(time, ground.value[:, i], ground.sigma[:, i]), max_gap=5.0)
        unit = ' N' if i == 0 else ''
        panels.append(Panel(
            ('longitudinal stiffness', 'rolling resistance')[i], label,
            estimate(own, ESTIMATE, 'blue', unit, legend=i == 0), _band_limits(own)))
    crossings = sorted(truths.crossings, key=lambda one: one.stamp_ns)
    if crossings:
        stamps = np.array([one.stamp_ns for one in crossings], np.int64)
        stiffness = np.array([one.stiffness.value for one in crossings])
        panels[0].traces.append(truth(Curve(seconds(stamps, origin_ns), stiffness), ' N',
                                      shape='hv'))
    return Figure('ground', 'Stiffness and rolling resistance of the ground over time',
                  'Longitudinal stiffness C_x of a tire on the present ground, and rolling '
                  f'resistance as a share of the load. {BAND}'
                  + (f' {TRUTH}' if crossings else ''), panels)


def _band_limits(curve: Curve) -> tuple[float, float]:
    """Return axis limits that include the band, except a few extreme values of it."""
    reach = SIGMAS * (np.zeros(0) if curve.sigma is None else curve.sigma)
    return limits([curve.value - reach, curve.value + reach], 0.01)
