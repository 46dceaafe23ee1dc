"""
What one passage tells of what stays the same in all passages: gains, contact length, spacing.

The whole waveform is fitted with gains and contact length free and the slip as it is known from
elsewhere. From the covariance of the fit the priors of what stays the same are taken out again,
for they must count once and not once in each passage; all else belongs to the passage and is gone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.film.crossing_collector import CrossingWithSlip
from smart_tire.estimation.friction.waveform_fit import (
    ALPHA_SIGMA, SlipKnowledge, WaveformFit, WaveformFitter)
from smart_tire.estimation.friction.waveform_model import Own, own, Shared
from smart_tire.parameters import RobotParams


GAIN_SIGMA, LENGTH_SIGMA = 0.5, 0.1  # relative, of a first fit: as good as nothing is known ...
NEAR_GAIN, NEAR_LENGTH = 0.2, 0.05   # ... and of the next ones, which begin near the truth
EXACT = 1e-5             # -, sigma of a slip whose error is dealt with later
UNKNOWN_SLIP = 1.0       # -, sigma where nothing is known
LARGEST_EXCESS = 9.0     # mean square of normalised residuals of a waveform that was understood
PLAUSIBLE_BENDING = (0.2, 5.0)  # of the nominal bending peak
STRAYED = 0.0025         # -, by which slip strays from a line for a waveform to be as wrong as its
#                          noise: where speeds change, of simulated runs
LEAST_INFORMATION = 1e-9  # relative eigenvalue: a prior that was taken out again leaves noise


@dataclass(frozen=True, slots=True, eq=False)
class GainObservation:
    """
    What a passage tells, in ``value`` with its ``precision`` and without any prior.

    Where ``gains`` it begins with the relative errors of the films' gains, for the slip that was
    given. Then come ln of contact length and of alpha over the nominal ones, then the places [m]
    on the circumference of the films behind the first that was seen, from that one.
    """

    known: CrossingWithSlip
    films: tuple[int, ...]  # indices, of those that were seen
    gains: bool
    value: Array      # (k,)
    precision: Array  # (k, k)
    by_scale: Array   # (k,), of the value, per relative error of all distances
    bending: tuple[float, ...]  # V
    place: float      # m, rolled forward when the first film's middle was at the patch's middle
    fit: WaveformFit


class EvidenceReader:
    """Fits passages of the films of ``robot``, whose gains and contact length are nearly right."""

    def __init__(self, robot: RobotParams, *, near: bool) -> None:
        self._sigmas = (NEAR_GAIN, NEAR_LENGTH) if near else (GAIN_SIGMA, LENGTH_SIGMA)
        film = robot.film
        self._bending = {wheel: film.bending(wheel) for wheel in film.wheels}
        self._fitters = {wheel: WaveformFitter(
            robot, film.gains(wheel), film.bending(wheel), gain_sigma=self._sigmas[0],
            length_sigma=self._sigmas[1]) for wheel in film.wheels}

    def read(self, known: CrossingWithSlip, *, gains: bool) -> GainObservation | None:
        """
        Return what a passage tells, None if it is not understood.

        Without ``gains`` its slip is taken for unknown.
        """
        fitter, passage = self._fitters[known.wheel], known.films
        fit = fitter.fit(passage, SlipKnowledge((known.slip[0], UNKNOWN_SLIP), known.change))
        if fit is not None and gains:
            fit = fitter.fit(passage, SlipKnowledge((known.slip[0], EXACT), known.change),
                             _with_slip(fit, known.slip[0]))
        if fit is None or not self._plausible(fit, known.wheel):
            return None
        count = len(passage.films)
        rows, value = _rows(fit, known.direction, gains)
        raw = fit.covariance / fit.excess
        prior = np.zeros(len(value))
        prior[:count * gains] = self._sigmas[0] ** -2
        prior[count * gains:count * gains + 2] = self._sigmas[1] ** -2, ALPHA_SIGMA ** -2
        precision = _without(np.linalg.inv(rows @ raw @ rows.T), prior)
        estimate = value + np.linalg.solve(precision, prior * value)
        scale = passage.errors.scale
        by_scale = rows @ raw[:, Shared.SCALE] / scale ** 2 if scale else np.zeros(len(value))
        return GainObservation(
            known, tuple(one.film for one in passage.films), gains, estimate,
            precision / (fit.excess * (1.0 + (known.stray / STRAYED) ** 2)), by_scale,
            tuple(fit.own(i, Own.BENDING)[0] for i in range(count)),
            known.direction * fit.own(0, Own.PLACE)[0], fit)

    def volts(self, told: GainObservation) -> list[Array]:
        """Return what the fit says of each sample [V] above rest, film by film."""
        return self._fitters[told.known.wheel].volts(told.fit)

    def _plausible(self, fit: WaveformFit, wheel: str) -> bool:
        low, high = PLAUSIBLE_BENDING
        return fit.excess < LARGEST_EXCESS and all(
            low < fit.own(i, Own.BENDING)[0] / self._bending[wheel][one.film] < high
            for i, one in enumerate(fit.passage.films))


def _with_slip(fit: WaveformFit, slip: float) -> WaveformFit:
    """Return a fit with another slip and the gains that make up for it, as a start."""
    p = fit.parameters.copy()
    gains = [own(i, Own.GAIN) for i in range(len(fit.passage.films))]
    p[gains] = (1.0 + p[gains]) * p[Shared.SLIP] / slip - 1.0
    p[Shared.SLIP] = slip
    return replace(fit, parameters=p)


def _rows(fit: WaveformFit, direction: int, gains: bool) -> tuple[Array, Array]:
    """Return the slopes of what is told by the parameters of a fit, and its value."""
    p, count = fit.parameters, len(fit.passage.films)
    columns = [own(i, Own.GAIN) for i in range(count)] if gains else []
    columns += [Shared.LENGTH, Shared.ALPHA]
    rows = np.zeros((len(columns) + count - 1, len(p)))
    rows[np.arange(len(columns)), columns] = 1.0
    value = rows @ p
    stretched, first = direction * (1.0 + p[Shared.SCALE]), own(0, Own.PLACE)
    for i in range(1, count):
        row, place = len(columns) + i - 1, own(i, Own.PLACE)
        apart = p[place] - p[first]
        rows[row, [place, first, Shared.SCALE]] = stretched, -stretched, direction * apart
        value[row] = stretched * apart
    return rows, value


def _without(whole: NDArray[np.floating], prior: Array) -> Array:
    """Return a precision without that of the priors; never less than nearly nothing is left."""
    size = np.sqrt(np.diag(whole))
    values, vectors = np.linalg.eigh((whole - np.diag(prior)) / np.outer(size, size))
    held = np.maximum(values, LEAST_INFORMATION)
    found: Array = np.outer(size, size) * ((vectors * held) @ vectors.T)
    return found
