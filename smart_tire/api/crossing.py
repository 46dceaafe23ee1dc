# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Fit of the waveform of one patch crossing, without a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.api.params import Params
from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import EstimatorError, ParameterError
from smart_tire.estimates import check_wheel
from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.contact.tracker import ContactTracker
from smart_tire.estimation.friction.output import friction_estimate, stamp_of
from smart_tire.estimation.friction.waveform_fit import WaveformFit
from smart_tire.estimation.friction.waveform_method import FilmResult, WaveformMethod
from smart_tire.estimation.friction.waveform_model import Shared
from smart_tire.models.tire.brush_tire import critical_slip
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import four, GRAVITY, NS_PER_S, TireSample, WheelSample
from smart_tire.uncertain import Uncertain, UNKNOWN

WHEEL_PERIOD = 0.02  # s, between two samples of the wheel speed; assumed: an encoder at 50 Hz
EXTRAPOLATED_TIME = 1.0  # s, for which the first and the last speed hold beyond the samples


@dataclass(frozen=True)
class CrossingFit:
    """
    One patch crossing of a wheel's films; values with standard deviation, NaN where unknown.

    * ``time``: s, at which the center of the films was at the patch center
    * ``slip``: -, slip ratio of B(3) from the films
    * ``normalized_slip``: -, total slip over critical slip; 1: the whole patch slides
    * ``adhesion_ratio``: -, L_a / L
    * ``adhesion_length``: m, L_a
    * ``contact_length``: m, L
    * ``contact_angle``: rad, of the patch as seen from the axle
    * ``tread_deflection``: m, of the brush elements at the end of the adhesion zone
    * ``friction_coefficient``: -, mu; NaN where the crossing adds little to what is likely
    * ``residual``: V, rms of the samples from the fit
    """

    time: float
    slip: Uncertain
    normalized_slip: Uncertain
    adhesion_ratio: Uncertain
    adhesion_length: Uncertain
    contact_length: Uncertain
    contact_angle: Uncertain
    tread_deflection: Uncertain
    friction_coefficient: Uncertain
    residual: float


def fit_crossing(time: ArrayLike, volts: ArrayLike, wheel_speed: ArrayLike, *,
                 params: Params | None = None, wheel: str | None = None, film: int = 0,
                 load: float | None = None, lateral_slip: float = 0.0,
                 speed_sigma: float = 0.01, length_sigma: float = 0.1) -> CrossingFit:
    """
    Return what the waveform of one patch crossing shows: slip, contact length, friction.

    ``time`` (n,) [s] increases, ``volts`` (n,) or (n, films) [V] are the samples of the film with
    index ``film`` (0: film 1) of ``wheel``, by default the first of ``film.wheels``, and of the
    next films. Samples of two film lengths of travel before and after the contact belong to it.
    ``wheel_speed`` [rad/s], a number or (n,), is positive forward; ``speed_sigma`` is its relative
    standard deviation, ``length_sigma`` that of the contact length in ``params`` (0: it is
    known), which have the wheel radius and the films. The friction coefficient follows from
    ``load`` [N], by default a quarter of the weight, and the stiffness in ``params``;
    ``lateral_slip`` [-] is that of the wheel. ``estimate`` is more accurate: it knows slip, load
    and stiffness of a drive.
    Raises ParameterError for invalid arguments, EstimatorError if not exactly one crossing is
    found or if its waveform is not that of films in the tread.
    """
    params = params or Params()
    robot = params.robot
    wheel = (robot.film.wheels or ('',))[0] if wheel is None else wheel
    check_wheel(wheel)
    times, rows, speeds = _checked(time, volts, wheel_speed)
    films = range(film, film + rows.shape[1])
    if wheel not in robot.film.wheels or not 0 <= film <= robot.film.count - len(films):
        raise ParameterError(f'films {film + 1} to {films[-1] + 1} of {wheel}: {wheel} has '
                             f'{robot.film.count * (wheel in robot.film.wheels)} films')
    robot = replace(robot, film=replace(
        robot.film, sample_rate=1.0 / float(np.median(np.diff(times)))))
    crossing = _found(times, rows, speeds, robot, wheel, films)
    samples = crossing.samples
    assert samples is not None
    crossing = replace(crossing, samples=replace(samples, errors=replace(
        samples.errors, scale_sigma=math.hypot(samples.errors.scale_sigma, speed_sigma))))
    result = WaveformMethod(wheel, robot, length_sigma=length_sigma).measure(crossing)
    if result is None or result.waveform is None:
        raise EstimatorError('the waveform is not that of a film in the tread: compare '
                             'film.bending_peak, film.length and wheel_radius with it')
    return _interpreted(result, result.waveform, robot, time=float(times[0]) + stamp_of(
        crossing, result) / NS_PER_S, load=0.25 * robot.mass * GRAVITY if load is None else load,
        load_sigma=params.estimators.friction.load_sigma, lateral_slip=lateral_slip)


def _checked(time: ArrayLike, volts: ArrayLike, wheel_speed: ArrayLike
             ) -> tuple[Array, Array, Array]:
    """Return times (n,), volts (n, films) and wheel speeds (n,), or raise ParameterError."""
    times, rows, speeds = (np.array(one, dtype=float) for one in (time, volts, wheel_speed))
    rows = rows.reshape(len(rows), -1) if rows.ndim == 1 else rows
    if times.ndim != 1 or len(times) < 2 or rows.ndim != 2 or len(rows) != len(times) or (
            speeds.shape not in ((), times.shape)):
        raise ParameterError(f'time, volts and wheel_speed have shapes {times.shape}, '
                             f'{rows.shape} and {speeds.shape}, expected (n,), (n, films) and () '
                             'or (n,)')
    for name, values in ('time', times), ('volts', rows), ('wheel_speed', speeds):
        if not np.isfinite(values).all():
            raise ParameterError(f'{name} has NaN or infinite values')
    if (np.diff(times) <= 0.0).any():
        row = int(np.argmax(np.diff(times) <= 0.0)) + 1
        raise ParameterError(f'time does not increase in row {row}')
    return times, rows, np.broadcast_to(speeds, times.shape)


def _found(times: Array, rows: Array, speeds: Array, robot: RobotParams, wheel: str,
           films: range) -> PatchCrossing:
    """Return the only crossing of ``films``, or raise EstimatorError; it begins at time 0."""
    group = tuple(films)
    tracker = ContactTracker(wheel, robot, group)
    since = times - times[0]
    angles = np.append(0.0, np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(since)))
    for at in np.arange(-EXTRAPOLATED_TIME, since[-1] + EXTRAPOLATED_TIME, WHEEL_PERIOD):
        inside = min(max(at, 0.0), since[-1])
        speed = float(np.interp(inside, since, speeds))
        angle = float(np.interp(inside, since, angles)) + speed * (at - inside)
        tracker.add_wheels(WheelSample(
            round(at * NS_PER_S), four([speed] * 4), four([angle] * 4)))
        if at == -EXTRAPOLATED_TIME:  # it follows the wheel from there on
            tracker.advance(-round(EXTRAPOLATED_TIME * NS_PER_S))
    for at, volts in zip((since * NS_PER_S).round().astype(int).tolist(), rows.tolist()):
        tracker.films.add(TireSample(at, wheel, (math.nan,) * group[0] + tuple(volts)))
    found = [one for one in tracker.finish(round((since[-1] + EXTRAPOLATED_TIME) * NS_PER_S))
             if one.samples is not None]
    if len(found) != 1:
        raise EstimatorError(
            f'{len(found)} patch crossings in {since[-1]:.3f} s, expected one: compare '
            'film.rest_voltage, film.bending_peak, wheel_radius and wheel_speed with the samples')
    return found[0]


def _interpreted(result: FilmResult, fit: WaveformFit, robot: RobotParams, *, time: float,
                 load: float, load_sigma: float, lateral_slip: float) -> CrossingFit:
    """Return the quantities that follow from slip, normalized slip t and ln of the length."""
    chosen = [Shared.SLIP, Shared.NORM_SLIP, Shared.LENGTH]
    covariance = fit.covariance[np.ix_(chosen, chosen)]
    covariance[:2, :2] = result.slips.covariance

    def uncertain(value: float, *slopes: float) -> Uncertain:
        return Uncertain(value, math.sqrt(np.array(slopes) @ covariance @ np.array(slopes)))

    slip, t = result.slips.slip, result.slips.normalized_slip
    total = math.hypot(slip, lateral_slip)
    share = slip / total  # derivative of total
    length = robot.tire.contact_length * math.exp(fit.shared(Shared.LENGTH).value)
    adhesion = min(max(1.0 - t, 0.0), 1.0)
    scale = float(critical_slip(1.0, load, robot.tire.longitudinal_stiffness)) / total
    mu, spread = friction_estimate(*uncertain(scale * t, -scale * t * share / total, scale, 0.0))
    return CrossingFit(
        time, uncertain(slip, 1.0, 0.0, 0.0), uncertain(t, 0.0, 1.0, 0.0),
        uncertain(adhesion, 0.0, 1.0, 0.0),
        uncertain(adhesion * length, 0.0, -length, adhesion * length),
        uncertain(length, 0.0, 0.0, length),
        uncertain(length / robot.wheel_radius, 0.0, 0.0, length / robot.wheel_radius),
        uncertain(total * adhesion * length, share * adhesion * length, -total * length,
                  total * adhesion * length),
        UNKNOWN if math.isnan(mu) else Uncertain(mu, math.hypot(
            spread, mu * load_sigma, mu * robot.tire.longitudinal_stiffness_sigma)),
        fit.residual_rms)
