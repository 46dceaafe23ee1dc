# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Patch crossings of a recording with the slip in each, and what one shows of the films.

Crossings of all instrumented wheels are detected first. The slips come afterwards, from a slip
estimator smoothed over the whole recording, without films.

An observation of gains, contact length and spacing comes from a single crossing: the waveform is
fitted with free gains and contact length, and the slip of the slip estimator. The priors of the
shared parameters are then removed from the covariance of the fit, because they must count once and
not in each crossing; parameters of the single crossing are marginalized.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.priors import PRIORS, UNINFORMATIVE
from smart_tire.calibration.results import MIN_ROBUST, SIGNIFICANT_SIGMAS
from smart_tire.estimation.contact.detection import is_plausible_bending
from smart_tire.estimation.contact.feed import ContactFeed, SampleBlock
from smart_tire.estimation.contact.records import CrossingSamples, PatchCrossing
from smart_tire.estimation.friction.constants import CHANGE_SIGMA, LOG_ALPHA_SIGMA
from smart_tire.estimation.friction.waveform_fit import (
    CrossingSlipPrior, WaveformFit, WaveformFitter)
from smart_tire.estimation.friction.waveform_method import slip_variation
from smart_tire.estimation.friction.waveform_model import film_index, PerFilm, Shared
from smart_tire.estimation.friction.waveform_shape import ShapeEstimator
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S, TireSample, WHEELS, WheelSample, WheelSlip
from smart_tire.uncertain import Uncertain

MEAN_MARGIN_NS = 50_000_000  # at least, on either side of a crossing, for the linear fit
EXACT_SIGMA = 1e-5  # of values that are exact, or whose errors enter later
# -, deviation of slip from a straight line that doubles the variance of a crossing with
# changing speed; from simulations
SLIP_DEVIATION_SCALE = 0.0025
MIN_INFORMATION = 1e-9  # relative eigenvalue that remains after removal of the prior


@dataclass(frozen=True, slots=True)
class CrossingWithSlip:
    """A patch crossing with waveforms of the films, and the slip in it."""

    wheel: str
    stamp_ns: int
    direction: int  # +1 forward, -1 backward
    speed: float    # m/s, r |omega|
    films: CrossingSamples
    slip: Uncertain    # -, B(3)'s lambda at the reference
    deviation: float   # -, standard deviation of slip from a straight line in this crossing
    change: Uncertain  # -, of the slip over a contact length
    origin: float      # rad, ``wheel_states.position`` at distance 0; NaN without positions


class CrossingCollector:
    """Collects the crossings of ``robot`` from samples in order of reception."""

    def __init__(self, robot: RobotParams, reorder_window: float) -> None:
        self.robot = robot
        self.tire_samples = 0  # of instrumented wheels
        self._feed = ContactFeed(robot, reorder_window)
        self._origins: dict[str, float] = {}
        self._found: list[tuple[PatchCrossing, str, float]] = []  # with wheel and origin

    def update(self, sample: TireSample | WheelSample) -> None:
        """Process one sample."""
        self._add(self._feed.add_sample(sample))

    def finish(self) -> None:
        """Collect the last crossings, at the end of all samples."""
        self._add(self._feed.finish())

    def _add(self, blocks: Iterable[SampleBlock]) -> None:
        for block in blocks:
            if block.restarted:
                self._origins.clear()
            for item in block.samples:
                if isinstance(item, WheelSample):
                    self._set_origins(item)
                else:
                    self.tire_samples += 1
            self._found += [(crossing, wheel, self._origins[wheel])
                            for wheel, crossing in block.crossings
                            if crossing.samples is not None]

    def _set_origins(self, sample: WheelSample) -> None:
        """Note the wheel positions at distance 0; NaN if distances are integrated speeds."""
        for wheel in self.robot.film.wheels:
            if sample.position is None:
                self._origins[wheel] = math.nan
            else:
                self._origins.setdefault(wheel, sample.position[WHEELS.index(wheel)])

    def with_slip(self, slips: Iterable[WheelSlip]) -> Iterator[CrossingWithSlip]:
        """Yield the crossings covered by ``slips``, which must be in the order of time."""
        rows = [(one.stamp_ns, *one.ratio, *one.sigma) for one in slips]
        stamps = np.array([row[0] for row in rows], np.int64)
        values = np.array([row[1:] for row in rows], float).reshape(-1, 2, len(WHEELS))
        for crossing, wheel, origin in sorted(self._found, key=lambda found: found[0].end_ns):
            yield from self._with_slip(crossing, wheel, origin, stamps,
                                       values[:, :, WHEELS.index(wheel)])

    def _with_slip(self, crossing: PatchCrossing, wheel: str, origin: float,
                   stamps: NDArray[np.int64], values: Array) -> Iterator[CrossingWithSlip]:
        """Yield the crossing unless a slip near it is unknown."""
        # wide enough for the entry of film 1 and the release of the last film
        around = max(MEAN_MARGIN_NS, crossing.end_ns - crossing.begin_ns)
        near = slice(*np.searchsorted(stamps, (crossing.begin_ns - around,
                                               crossing.end_ns + around + 1)))
        ratio, sigma = values[near].T
        if crossing.samples is None or not len(ratio) or not np.isfinite(ratio).all():
            return
        time = (stamps[near] - crossing.begin_ns) / NS_PER_S
        points = np.linspace(0.0, (crossing.end_ns - crossing.begin_ns) / NS_PER_S, MIN_ROBUST)
        # errors of a filter do not average out over a crossing
        slip = Uncertain(*(float(np.interp(points, time, column).mean())
                           for column in (ratio, sigma)))
        slope = residual = 0.0
        if len(ratio) >= MIN_ROBUST:
            slope, offset = np.polyfit(time, ratio, 1).tolist()
            residual = float(np.std(ratio - slope * time - offset))
        length = self.robot.tire.contact_length
        change = slope * length / crossing.speed
        spread = slip_variation(crossing, length)
        change_sigma = math.hypot(PRIORS['change of slip'].sigma, change,
                                  max(spread.change.sigma - CHANGE_SIGMA, 0.0))
        yield CrossingWithSlip(
            wheel, crossing.stamp_ns, crossing.direction, crossing.speed, crossing.samples,
            slip, math.hypot(residual, spread.residual), Uncertain(change, change_sigma), origin)


@dataclass(frozen=True, slots=True, eq=False)
class GainObservation:
    """
    Observation from a crossing: ``value`` with its ``precision``, without any prior.

    With ``gains`` it begins with the relative errors of the films' gains at the given slip. Then
    follow ln of contact length and of alpha over the nominal ones, then the positions [m] on the
    circumference of the other films relative to the first one that was detected.
    """

    crossing: CrossingWithSlip
    films: tuple[int, ...]  # indices of the detected films
    gains: bool
    value: Array                # (k,)
    precision: Array            # (k, k)
    by_scale: Array  # (k,), derivative of the value by the relative error of all distances
    bending: tuple[float, ...]  # V
    position: float  # m rolled forward when the center of the first film was at the patch center
    fit: WaveformFit


class ObservationFitter:
    """Fits crossings of the films of ``robot``, whose parameters must be approximately right."""

    def __init__(self, robot: RobotParams) -> None:
        film, self._sigma = robot.film, UNINFORMATIVE.sigma
        self._bending = {wheel: film.bending(wheel) for wheel in film.wheels}
        self._shapes = {wheel: ShapeEstimator() for wheel in film.wheels}
        self._fitters = {wheel: WaveformFitter(
            robot, film.gains(wheel), film.bending(wheel), self._shapes[wheel],
            gain_sigma=self._sigma, length_sigma=self._sigma) for wheel in film.wheels}

    def fit_crossing(self, crossing: CrossingWithSlip, *, gains: bool) -> GainObservation | None:
        """
        Return the observation of a crossing, None if the waveform does not fit.

        Without ``gains`` the slip is not used.
        """
        fitter, samples = self._fitters[crossing.wheel], crossing.films
        slip = crossing.slip.value
        fit = fitter.fit(samples, CrossingSlipPrior(
            Uncertain(slip, self._sigma), crossing.change))
        first = fit
        if fit is not None and gains:
            fit = fitter.fit(samples, CrossingSlipPrior(
                Uncertain(slip, EXACT_SIGMA), crossing.change), _with_slip(fit, slip))
        if fit is None or not self._plausible(fit, crossing.wheel):
            return None
        if first is not None:
            self._shapes[crossing.wheel].correct(*first.shape, excess=first.excess)
        count = len(samples.films)
        rows, value = _rows(fit, crossing.direction, gains)
        raw = fit.covariance / fit.excess
        prior, length = np.zeros(len(value)), count * gains
        prior[:length + 1], prior[length + 1] = self._sigma ** -2, LOG_ALPHA_SIGMA ** -2
        precision = _without_prior(np.linalg.inv(rows @ raw @ rows.T), prior)
        estimate = value + np.linalg.solve(precision, prior * value)
        scale = samples.errors.scale_sigma
        by_scale = rows @ raw[:, Shared.SCALE] / scale ** 2 if scale else np.zeros(len(value))
        variance_factor = fit.excess * (1.0 + (crossing.deviation / SLIP_DEVIATION_SCALE) ** 2)
        return GainObservation(
            crossing, tuple(film.film for film in samples.films), gains, estimate,
            precision / variance_factor, by_scale,
            tuple(fit.film_parameter(i, PerFilm.BENDING).value for i in range(count)),
            crossing.direction * fit.film_parameter(0, PerFilm.CENTER).value, fit)

    def volts(self, observation: GainObservation) -> list[Array]:
        """Return the fitted voltage of each sample [V] above the baseline, film by film."""
        return self._fitters[observation.crossing.wheel].volts(observation.fit)

    def _plausible(self, fit: WaveformFit, wheel: str) -> bool:
        return fit.excess < SIGNIFICANT_SIGMAS ** 2 and all(
            is_plausible_bending(fit.film_parameter(i, PerFilm.BENDING).value,
                                 self._bending[wheel][film.film])
            for i, film in enumerate(fit.samples.films))


def _with_slip(fit: WaveformFit, slip: float) -> WaveformFit:
    """Return a fit with another slip, and gains that compensate for it, as a start."""
    p = fit.parameters.copy()
    gains = [film_index(i, PerFilm.GAIN) for i in range(len(fit.samples.films))]
    p[gains] = (1.0 + p[gains]) * p[Shared.SLIP] / slip - 1.0
    p[Shared.SLIP] = slip
    return replace(fit, parameters=p)


def _rows(fit: WaveformFit, direction: int, gains: bool) -> tuple[Array, Array]:
    """Return the derivatives of the observation by the fit's parameters, and its value."""
    p, count = fit.parameters, len(fit.samples.films)
    columns = [film_index(i, PerFilm.GAIN) for i in range(count)] if gains else []
    columns += [Shared.LENGTH, Shared.ALPHA]
    rows = np.zeros((len(columns) + count - 1, len(p)))
    rows[np.arange(len(columns)), columns] = 1.0
    value = rows @ p
    scaled, first = direction * (1.0 + p[Shared.SCALE]), film_index(0, PerFilm.CENTER)
    for i in range(1, count):
        row, place = len(columns) + i - 1, film_index(i, PerFilm.CENTER)
        distance = p[place] - p[first]
        rows[row, [place, first, Shared.SCALE]] = scaled, -scaled, direction * distance
        value[row] = scaled * distance
    return rows, value


def _without_prior(precision: NDArray[np.floating], prior: Array) -> Array:
    """Return a precision without that of the prior, kept positive definite."""
    size = np.sqrt(np.diag(precision))
    values, vectors = np.linalg.eigh((precision - np.diag(prior)) / np.outer(size, size))
    clipped = np.maximum(values, MIN_INFORMATION)
    result: Array = np.outer(size, size) * ((vectors * clipped) @ vectors.T)
    return result
