# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Figures of what was identified: geometry, ICR, motor, stiffness, gains, and films."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smart_tire.analysis.figure import (
    Curve, dots, Figure, Mark, PAIR, Panel, straight, TIME_LABEL)
from smart_tire.arrays import Array
from smart_tire.calibration.film_gains import FilmGain, GainFit, Waveform
from smart_tire.calibration.geometry import Geometry
from smart_tire.calibration.latency import YawRateFit
from smart_tire.calibration.motor import FEED_FORWARD, MotorFit
from smart_tire.calibration.reference import RadiusFit
from smart_tire.calibration.stiffness import StiffnessFit
from smart_tire.calibration.turning import IcrFit

SHOWN_DURATION = 20.0  # s, where the yaw rate changes most, so that the latency is visible
MM = 1e3
ERRORS = 'Values are given with their standard errors.'


def _figure(name: str, title: str, caption: str, rows: Sequence[Sequence[Panel]],
            cell: tuple[float, float] = (5.2, 3.8)) -> Figure | None:
    """Return a figure of panels, each with a legend of its own; None without any."""
    return Figure(name, title, caption, rows, cell, panel_legends=True) if any(rows) else None


def geometry_figure(found: Geometry) -> Figure | None:
    """Return the available fits; None without any."""
    delay, radius = found.yaw_rate_fit, found.radius_fit
    panels = [*([] if delay is None else [_track_panel(delay)]),
              *([] if radius is None else [_radius_panel(radius)])]
    rows = [panels] if delay is None else [[_delay_panel(delay)] * len(panels), panels]
    return _figure(
        'geometry', 'Encoder latency, effective track and rolling radius',
        f'{ERRORS} The yaw rate is shown in the {SHOWN_DURATION:.0f} s in which it changes most; '
        'an interval is the time between two wheel messages, or between reference poses.', rows,
        (10.4 / max(len(panels), 1), 3.8))


def _delay_panel(fit: YawRateFit) -> Panel:
    """Return the wheel speed difference with and without latency, and the gyro rate."""
    changed = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(fit.yaw_rate)))])
    last = np.searchsorted(fit.time, fit.time + SHOWN_DURATION)
    first = int(np.argmax(changed[last - 1] - changed))
    shown = slice(first, int(last[first]))
    time, difference, latency = fit.time[shown], fit.wheel_difference[shown], fit.latency
    return Panel([
        Mark(Curve(time, difference), 'right minus left, as stamped', 'shade', width=0.9),
        Mark(Curve(time - latency.value, difference),
             f'shifted by {1e3 * latency.value:.1f} ± {1e3 * latency.sigma:.1f} ms', 'orange'),
        Mark(Curve(time - latency.value, fit.slope.value * fit.yaw_rate[shown]),
             'gyro, times track over radius', 'ink', width=0.9)],
        TIME_LABEL, 'wheel speed difference [rad/s]')


def _track_panel(fit: YawRateFit) -> Panel:
    """Return the wheel speed difference over the yaw rate; the slope is track over radius."""
    slope = fit.slope
    return Panel([
        dots(fit.yaw_rate, fit.wheel_difference, 'intervals'),
        straight(fit.yaw_rate, slope.value,
                 f'{slope.value:.3f} ± {slope.sigma:.3f} wheel rad per yaw rad', 'ink')],
        'yaw rate [rad/s]', 'wheel speed, right minus left [rad/s]')


def _radius_panel(fit: RadiusFit) -> Panel:
    """Return the difference of reference and wheel distances over time."""
    radius = fit.radius
    return Panel([
        straight(fit.time, 0.0, '', 'ink'),
        dots(fit.time, MM * (fit.reference_distance - fit.wheel_distance),
             f'intervals; radius {MM * radius.value:.1f} ± {MM * radius.sigma:.1f} mm',
             'vermillion')], TIME_LABEL, 'distance, reference minus wheels [mm]')


def icr_figure(fit: IcrFit) -> Figure | None:
    """Return the fit of S and its value in each turn."""
    x, y, icr = fit.regressor, fit.response, fit.icr
    low, high = np.quantile(y, (0.01, 0.99))
    margin = 0.3 * (high - low)
    x_label, y_label = (('minus yaw change [rad]', 'lateral displacement') if fit.unit == 'm'
                        else ('minus yaw acceleration [rad/s2]', 'lateral acceleration'))
    slope = Panel([
        dots(x, y, 'intervals in turns'),
        straight(x, icr.value, f'S = {MM * icr.value:.1f} ± {MM * icr.sigma:.1f} mm', 'ink')],
        x_label, f'{y_label} [{fit.unit}]', y_limits=(low - margin, high + margin))
    ends = fit.turn_time[[0, -1]]
    turns = Panel([
        Mark(Curve(ends, np.full(2, MM * icr.value), np.full(2, MM * fit.initial_sigma)),
             'S ± 2σ'),
        dots(fit.turn_time, MM * fit.turn_icr, 'turns ± 2σ', 'orange', MM * fit.turn_sigma)],
        TIME_LABEL, 'S [mm]')
    return _figure(
        'icr', 'Instantaneous centers of rotation',
        'Left: the slope is S, the x coordinate of the instantaneous centers of rotation, given '
        'with its standard error; points beyond the axes are extreme intervals. Right: S of each '
        'turn; band: two standard deviations of S in another recording.', [[slope, turns]])


def motor_figure(found: MotorFit) -> Figure | None:
    """Return the available fits; None without any."""
    panels = []
    if found.balance is not None:
        kappa, (balance, torque) = found.kappa, found.balance
        panels.append(Panel([
            dots(balance, torque, 'measured, without friction'),
            straight(balance, kappa, f'slope {kappa:.3f}'),
            straight(balance, 1.0, 'equal', 'ink', dashed=True)],
            'r m f + J dw/dt of all wheels [N m]', 'measured motor torque [N m]'))
    if found.duty is not None:
        speed, duty = found.duty
        marks = [dots(speed, duty, 'in motion')]
        if (gain := found.get(FEED_FORWARD)) is not None:
            marks.append(straight(speed, gain.value,
                                  f'feed-forward {gain.value:.4f} ± {gain.sigma:.1g} s/rad'))
        panels.append(Panel(marks, 'wheel speed [rad/s]', 'duty [-]'))
    return _figure(
        'motor', 'Motor torque and duty',
        'Torque: with the right torque constant, the measured torque equals the one that force '
        f'and inertia require (dashed). {ERRORS}', [panels])


def stiffness_figure(found: StiffnessFit) -> Figure | None:
    """Return force over slip of each interval, fit and slope C_x."""
    stiffness, force = found.stiffness, np.array([found.force.min(), found.force.max()])
    return _figure(
        'stiffness', 'Stiffness of the tire',
        'Force of one wheel over its slip; the slope at zero is C_x, given with its standard '
        'error.', [[Panel([
            dots(found.slip, found.force, 'intervals of the recording'),
            Mark(Curve(*found.curve), 'fit, with rolling drag', 'ink'),
            Mark(Curve(force / stiffness.value, force),
                 f'C_x = {stiffness.value:.1f} ± {stiffness.sigma:.1f} N', 'vermillion',
                 dashed=True)],
            'slip ratio [-]', 'force of one wheel, positive in traction [N]')]], (7.0, 3.8))


def gains_figure(found: GainFit) -> Figure | None:
    """Return the identified gains and an example waveform; None without any."""
    wheels = list(dict.fromkeys(one.wheel for one in found.films if one.gain is not None))
    panels = [_gain_panel(wheel, [one for one in found.films if one.wheel == wheel])
              for wheel in wheels]
    caption = ('Points: patch crossings, bars: ± 2σ of stretch voltage and slip. Lines: '
               'identified gains with their standard errors.')
    if panels and found.example is not None:
        panels.append(_waveform_panel(found.example))
        caption += (' Right: the films during one crossing; samples at the limit of the amplifier '
                    'output are not fitted.')
    return _figure('gains', 'Gains of the films', caption, [panels])


def _gain_panel(wheel: str, films: Sequence[FilmGain]) -> Panel:
    """Return stretch voltage over slip of the films of a wheel, and their gains as lines."""
    marks = []
    for one, color in zip(films, PAIR * len(films)):
        if (volts := one.per_slip) is not None:
            marks += [dots(one.slip, one.stretch, '', color, one.stretch_sigma, one.slip_sigma),
                      straight(np.append(one.slip, 0.0), volts.value,
                               f'film {one.film + 1}: {volts.value:.3f} ± {volts.sigma:.3f} V per '
                               'unit', color)]
    return Panel(marks, 'slip ratio ± 2σ [-]', 'stretch voltage at full adhesion ± 2σ [V]',
                 wheel.replace('_', ' '))


def _waveform_panel(example: Waveform) -> Panel:
    """Return the samples and the fitted waveform of one crossing."""
    marks = []
    for i, (film, color) in enumerate(zip(example.films, PAIR * len(example.films))):
        distance = MM * example.distance[i]
        marks += [dots(distance, example.volts[i], f'film {film + 1}, samples', color),
                  Mark(Curve(distance, example.fitted[i]), f'film {film + 1}, fit', color)]
    return Panel(marks, 'rolled distance [mm]', 'voltage above baseline [V]',
                 f'{example.wheel.replace("_", " ")}, slip {example.slip:+.3f}')


def fit_figure(name: str, time: Array, inputs: Array, measured: Array, fitted: Array, *,
               input_label: str, output_label: str) -> Figure:
    """Return measured and fitted output over input and time, and the residual over time."""
    rest = measured - fitted
    size = 5.0 * float(np.quantile(np.abs(rest), 0.9))
    loop, over_time = (Panel([
        Mark(Curve(x, measured), 'measured', 'sky', width=1.6),
        Mark(Curve(x, fitted), 'Duhem operator, fitted', 'ink', width=0.9)], label, output_label)
        for x, label in ((inputs, input_label), (time, TIME_LABEL)))
    residual = Panel([Mark(Curve(time, rest), '', 'vermillion', width=0.8)], TIME_LABEL,
                     f'residual, {output_label}', y_limits=(-size, size) if size > 0.0 else None)
    return Figure(
        name, 'Output of the film, measured and fitted',
        'Output of the film over its input and over time, measured and fitted. Residual: measured '
        'minus fitted; its axis ends at five times the 90 % quantile.',
        [[loop, over_time], [loop, residual]], (5.5, 2.2))


def measurement_figure(name: str, time: Array, value: Array, sigma: Array,
                       reference: Array | None, *, label: str) -> Figure:
    """Return the measured values with a two-sigma band, and the reference if given."""
    marks = [Mark(Curve(time, value, sigma), 'film ± 2σ')]
    if reference is not None:
        marks.append(Mark(Curve(time, reference), 'reference', 'ink', width=1.1, dashed=True))
    return Figure(name, 'Measurement with the film',
                  'Measurement with the film. Band: ± 2σ, where σ is its standard deviation.',
                  [[Panel(marks, TIME_LABEL, label)]])
