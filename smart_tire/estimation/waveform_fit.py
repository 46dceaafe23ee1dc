"""
Fit of the whole waveform of a passage: all films of a wheel together.

Least squares with priors, by Gauss-Newton with Levenberg's damping: slip and sliding share are
those of all films, the rest belongs to each. Samples far off count less, clipped ones only where
the fit stays short of the rail.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

from smart_tire.errors import EstimatorError
from smart_tire.estimation.course_errors import CourseErrors
from smart_tire.estimation.motion import Estimate
from smart_tire.estimation.sighting import Sighting
from smart_tire.estimation.waveform_model import FilmSamples, Own, own, Shared, WaveformModel
from smart_tire.parameters.robot import RobotParams

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

FEWEST = 8               # samples of a film; priors stand for what they do not tell
PLACE_SIGMA = 0.005      # m, of the place where a film was sighted
OFFSET_SIGMA = 0.01      # V, of the tracked rest voltage
BENDING_SIGMA = 0.5      # relative, of the bending peak: cycle to cycle, and badly known
BUMP, BUMP_SIGMA = 0.12, 0.12  # of the bending peak; 0.10 to 0.15 in Fig. 11(b)
RECOVERY_SIGMA = 0.5     # of the logarithm: some millimetres of travel
ALPHA_SIGMA = 0.03       # likewise, of the bending shape: assumed
SLIP_SIGMA = 1.0         # -, weakest possible knowledge of the slip
TYPICAL_SLIDING = 0.3    # -, of total slip / critical slip ...
SLIDING_SIGMA = 3.0      # -, ... and the weakest possible knowledge of it
TYPICAL_SLIP = 0.08      # -, at which a start takes the sliding for typical at most
LEAST_START = 0.1        # -, smallest sliding that a start takes
SUSPECT = 1.5            # mean square of normalised residuals, from which another start is tried
LEAST_SLIP = 0.02        # -, below which a relative change of slip means nothing
LEAST_TOLERANCE = 1e-6   # relative, of gains that are said to be exact
LARGEST_STEP = 0.003     # m, of a place in one iteration
SLIDING_RANGE = (-5.0, 10.0)  # -, far beyond all that can be told
ITERATIONS = 15
DAMPED, GROWS, SHRINKS = 1e-4, 10.0, 0.1  # Levenberg's damping: first, after failure and success
MOST_DAMPED = 1e6
CONVERGED = 0.03         # of the misfit, chi-squared: a step that saves less is the last
OUTLIER = 3.0            # sigmas, beyond which a sample counts less
AT_ONCE = 200_000        # multiplications in a product; OpenBLAS uses threads from 4 * 65536 on
MEDIAN_TO_SIGMA = 1.4826  # of the absolute values of Gaussian noise


@dataclass(frozen=True, slots=True)
class SlipKnowledge:
    """What is known of the slip without the films."""

    slip: Estimate = (0.0, SLIP_SIGMA)  # -, at the reference
    change: Estimate = (0.0, 0.0)       # -, of the slip over a contact length
    # -, relative, of the sliding share over a contact length; None: as that of the slip
    spread: Estimate | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """
    Samples of the films of a wheel in one passage, film by film, and where each was sighted.

    ``reference`` [m] is the distance for which slip and sliding are told.
    """

    films: tuple[FilmSamples, ...]
    sightings: tuple[Sighting, ...]
    reference: float
    errors: CourseErrors = field(default_factory=CourseErrors)


@dataclass(frozen=True, slots=True, eq=False)
class WaveformFit:
    """
    What was fitted to one passage.

    ``parameters`` and their ``covariance`` have the order of ``WaveformModel``; ``noise`` and
    ``lasting`` split the covariance (2, 2) of slip and sliding into what is new in every passage
    and what gains and the slip from elsewhere leave.
    """

    passage: Passage
    parameters: Array
    covariance: Array
    noise: Array
    lasting: Array
    residual: float  # V, rms
    excess: float    # mean square of residuals over that of the noise, at least 1

    @property
    def slip(self) -> Estimate:
        """Return the longitudinal slip ratio with one sigma."""
        return self._estimate(Shared.SLIP)

    @property
    def sliding(self) -> Estimate:
        """Return total slip / critical slip with one sigma; noise may make it negative."""
        return self._estimate(Shared.SLIDING)

    def shared(self, which: Shared) -> Estimate:
        """Return a parameter that the films share, with one sigma."""
        return self._estimate(which)

    def own(self, position: int, which: Own) -> Estimate:
        """Return a parameter of the film at ``position`` in the passage, with one sigma."""
        return self._estimate(own(position, which))

    def _estimate(self, index: int) -> Estimate:
        return (float(self.parameters[index]),
                math.sqrt(max(float(self.covariance[index, index]), 0.0)))


@dataclass(frozen=True, slots=True, eq=False)
class _Prior:
    """What is known before a passage is seen; a sigma of 0 fixes a parameter."""

    value: Array
    precision: Array  # 1 / variance, 0 of fixed parameters
    free: Indices     # of the parameters that are fitted
    lasting: Indices  # of those whose error is the same in other passages


@dataclass(frozen=True, slots=True, eq=False)
class _Point:
    """Parameters and what the model makes of them."""

    p: Array
    residual: Array  # V, (n,)
    slopes: Array    # (m, n), by all parameters


class WaveformFitter:
    """
    Fits ``WaveformModel`` to the passages of one wheel.

    ``gains`` [V/m] and ``bending`` [V] are the nominal ones of all films of the wheel;
    ``gain_sigma`` (that of the robot's description by default) and ``length_sigma`` are relative
    sigmas of gains and contact length; the latter is taken for known where its sigma is 0.
    """

    def __init__(self, robot: RobotParams, gains: Sequence[float], bending: Sequence[float], *,
                 gain_sigma: float | None = None, length_sigma: float = 0.0) -> None:
        self._robot, film = robot, robot.film
        self._gains, self._bending = tuple(gains), tuple(bending)
        tolerance = film.stretch_gain_tolerance if gain_sigma is None else gain_sigma
        self._gain_sigma = max(tolerance, LEAST_TOLERANCE)
        self._length_sigma = length_sigma
        self._variance = film.sample_variance
        self._descent: _Descent | None = None  # of the passage that was fitted last

    def fit(self, passage: Passage, known: SlipKnowledge = SlipKnowledge(),
            start: WaveformFit | None = None) -> WaveformFit | None:
        """
        Return the fit of ``passage``, None where a film has too few samples.

        A fit of the same passage with other knowledge of the slip is a good ``start``.
        """
        if min(len(one.distance) for one in passage.films) < FEWEST:
            return None
        descent = self._descent
        if descent is None or descent.passage is not passage:
            descent = self._descent = _Descent(self._model(passage), passage, self._variance)
        p = self._start(passage) if start is None else start.parameters
        if start is not None and start is descent.found:
            p = descent.point.p  # where the model is known already
        found = descent.run(p, self._prior(passage, known, float(p[Shared.SLIP])))
        if start is None and found.excess > SUSPECT:
            p = p.copy()
            p[Shared.SLIP] *= -1.0
            found = min(found, descent.run(p, self._prior(passage, known, float(p[Shared.SLIP]))),
                        key=lambda fit: fit.excess)
        return found

    def apart(self, fit: WaveformFit) -> list[Estimate]:
        """
        Return the sliding share as each film alone would tell it, to first order.

        ``fit`` must be the last one of this fitter.
        """
        if self._descent is None or self._descent.found is not fit:
            raise EstimatorError('films can be told apart in the last fit only')
        return self._descent.apart()

    def volts(self, fit: WaveformFit) -> list[Array]:
        """Return what the fit says of each sample [V] above rest, film by film."""
        passage = fit.passage
        output, _ = self._model(passage).linearised(fit.parameters)
        ends = np.cumsum([len(one.distance) for one in passage.films])[:-1]
        return np.split(output, ends)

    def _model(self, passage: Passage) -> WaveformModel:
        return WaveformModel(self._robot, self._gains, passage.films, passage.reference,
                             len(passage.errors.warps))

    def _start(self, passage: Passage) -> Array:
        p = np.zeros(own(len(passage.films), Own.PLACE) + len(passage.errors.warps))
        for i, (one, seen) in enumerate(zip(passage.films, passage.sightings)):
            bump = BUMP * self._bending[one.film]
            p[own(i, Own.PLACE):own(i, Own.GAIN)] = seen.middle, 0.0, seen.bending, bump, bump
        slip, sliding = np.mean(
            [(seen.slip, seen.sliding) for seen in passage.sightings], axis=0).tolist()
        # a small slip shows no sliding, and is likely far from the critical one
        likely = max(TYPICAL_SLIDING * abs(slip) / TYPICAL_SLIP, LEAST_START)
        p[Shared.SLIP], p[Shared.SLIDING] = slip, min(sliding, likely)
        return p

    def _prior(self, passage: Passage, known: SlipKnowledge, slip: float) -> _Prior:
        count, errors = len(passage.films), passage.errors
        value, sigma = np.zeros((2, own(count, Own.PLACE) + len(errors.warps)))
        scale = math.copysign(max(abs(slip), LEAST_SLIP), slip)  # GROWTH is relative to the slip
        growth = known.change[0] / scale, known.change[1] / abs(scale)
        spread = growth if known.spread is None else known.spread
        value[:len(Shared)] = (
            known.slip[0], TYPICAL_SLIDING, growth[0], spread[0], 0.0, 0.0, 0.0)
        sigma[:len(Shared)] = (
            known.slip[1], SLIDING_SIGMA, growth[1], spread[1], errors.scale, ALPHA_SIGMA,
            self._length_sigma)
        sigma[own(count, Own.PLACE):] = errors.warps
        recovery = RECOVERY_SIGMA if self._robot.film.release == 'fig8' else 0.0
        for i, (one, seen) in enumerate(zip(passage.films, passage.sightings)):
            peak, block = self._bending[one.film], slice(own(i, Own.PLACE), own(i + 1, Own.PLACE))
            value[block] = seen.middle, 0.0, peak, BUMP * peak, BUMP * peak, 0.0, 0.0
            sigma[block] = (PLACE_SIGMA, OFFSET_SIGMA, BENDING_SIGMA * peak, BUMP_SIGMA * peak,
                            BUMP_SIGMA * peak, self._gain_sigma, recovery)
        free = np.flatnonzero(sigma > 0.0)
        precision = np.zeros_like(sigma)
        precision[free] = sigma[free]**-2
        lasting = [Shared.SLIP, *(own(i, Own.GAIN) for i in range(count))]
        return _Prior(value, precision, free, np.array(lasting, dtype=np.intp))


class _Descent:
    """
    Fits of one passage, from a start to the least misfit.

    The last fit is kept as ``found``, with the ``point`` at which the model was last evaluated for
    it: a fit with other knowledge goes on from there.
    """

    def __init__(self, model: WaveformModel, passage: Passage, variance: float) -> None:
        self._model, self.passage = model, passage
        self._variance = variance
        self._volts = np.concatenate([one.volts for one in passage.films])
        self._rail = np.concatenate([one.rail for one in passage.films])
        self._clips = bool(self._rail.any())
        self.found: WaveformFit | None = None
        self.point: _Point
        self._known: _Prior  # of the last fit

    def run(self, p: Array, prior: _Prior) -> WaveformFit:
        """Return the fit from the start ``p``; what is fixed takes the value of ``prior``."""
        start = prior.value.copy()
        start[prior.free] = p[prior.free]
        point = self._at(start) if self.found is None or p is not self.point.p or np.any(
            start != p) else self.point
        damping = DAMPED
        for _ in range(ITERATIONS):
            weight = self._weights(point)
            slopes = point.slopes.take(prior.free, axis=0)
            hessian = _product(slopes, weight)
            hessian.reshape(-1)[::len(hessian) + 1] += prior.precision[prior.free]
            gradient = slopes @ (weight * point.residual) + (
                prior.precision * (prior.value - point.p))[prior.free]
            last, moved, damping = self._step(point, prior, weight, hessian, gradient, damping)
            if moved is None:
                break
            point = moved
        self.point, self._known = point, prior
        self.found = self._judge(point, last, prior, weight, hessian)
        return self.found

    def apart(self) -> list[Estimate]:
        """Return the sliding share by one step from the last point with each film's samples."""
        prior, point = self._known, self.point
        weight, slopes = self._weights(point), point.slopes.take(prior.free, axis=0)
        sliding = int(np.searchsorted(prior.free, Shared.SLIDING))
        pull = (prior.precision * (prior.value - point.p))[prior.free]
        right = np.zeros((len(prior.free), 2))
        right[sliding, 1] = 1.0
        found, begin = [], 0
        for one in self.passage.films:
            own_part = slice(begin, begin + len(one.distance))
            begin = own_part.stop
            hessian = _product(slopes[:, own_part], weight[own_part])
            hessian.reshape(-1)[::len(hessian) + 1] += prior.precision[prior.free]
            right[:, 0] = slopes[:, own_part] @ (
                weight[own_part] * point.residual[own_part]) + pull
            step, inverse = _solved(hessian, right)[sliding].tolist()
            found.append((float(point.p[Shared.SLIDING]) + step, math.sqrt(inverse)))
        return found

    def _at(self, p: Array) -> _Point:
        output, slopes = self._model.linearised(p)
        return _Point(p, self._volts - output, slopes)

    def _step(self, point: _Point, prior: _Prior, weight: Array, hessian: Array, gradient: Array,
              damping: float) -> tuple[Array, _Point | None, float]:
        """
        Return the parameters after a step, the point there, and the damping after it.

        No point where the step saves little or none saves anything: then it is the last.
        """
        before = self._misfit(point, prior, weight)
        while damping < MOST_DAMPED:
            damped = hessian.copy()
            damped.reshape(-1)[::len(damped) + 1] *= 1.0 + damping
            step = _solved(damped, gradient)
            p = self._moved(point.p, prior, step)
            if float(gradient @ step) < CONVERGED:
                return p, None, damping
            trial = self._at(p)
            if self._misfit(trial, prior, weight) <= before:
                return p, trial, SHRINKS * damping
            damping *= GROWS
        return point.p, None, damping

    def _moved(self, p: Array, prior: _Prior, step: NDArray[np.floating]) -> Array:
        """Return ``p`` after ``step``, shortened where a place would jump."""
        whole = np.zeros_like(p)
        whole[prior.free] = step
        places = whole[own(0, Own.PLACE):own(len(self.passage.films), Own.PLACE):len(Own)]
        farthest = max(map(abs, places.tolist()))
        moved: Array = p + whole * min(1.0, LARGEST_STEP / max(farthest, LARGEST_STEP))
        low, high = SLIDING_RANGE
        moved[Shared.SLIDING] = min(max(float(moved[Shared.SLIDING]), low), high)
        return moved

    def _misfit(self, point: _Point, prior: _Prior, weight: Array) -> float:
        if self._clips:
            weight = np.where(self._rail * point.residual < 0.0, 0.0, weight)
        off = point.p - prior.value
        return float(weight @ (point.residual * point.residual) + prior.precision @ (off * off))

    def _weights(self, point: _Point) -> Array:
        """Return 1 / variance, less for outliers (Huber), none for what is beyond its rail."""
        size = np.abs(point.residual)
        spread = max(math.sqrt(self._variance), MEDIAN_TO_SIGMA * _middle(size))
        edge = OUTLIER * spread
        weight: Array = (edge / self._variance) / np.maximum(size, edge)
        return np.where(self._rail * point.residual < 0.0, 0.0, weight) if self._clips else weight

    def _judge(self, point: _Point, p: Array, prior: _Prior, weight: Array,
               hessian: Array) -> WaveformFit:
        """Return what was fitted, with its covariance; ``p`` is a small step from ``point``."""
        counted = weight > 0.0
        residual, weight = (point.residual[counted], weight[counted]) if self._clips else (
            point.residual, weight)
        freedom = max(len(residual) - len(prior.free), 1)
        # stray samples count as far as they weigh, a model that does not hold as much as it fails
        squares = residual * residual
        size = weight * squares
        excess = max(1.0, float(np.minimum(size, OUTLIER**2).sum()) / freedom,
                     _middle(size) * MEDIAN_TO_SIGMA**2)
        covariance = np.zeros((len(p), len(p)))
        covariance[prior.free[:, np.newaxis], prior.free] = _solved(hessian, np.eye(len(hessian)))
        both = covariance[[Shared.SLIP, Shared.SLIDING]]
        through = both[:, prior.lasting]
        lasting = (through * prior.precision[prior.lasting]) @ through.T
        noise = excess * (both[:, [Shared.SLIP, Shared.SLIDING]] - lasting)
        return WaveformFit(self.passage, p, excess * covariance, noise, lasting,
                           math.sqrt(float(squares.sum()) / len(squares)), excess)


def _solved(matrix: Array, right: Array) -> NDArray[np.floating]:
    """Return matrix^-1 @ right of a positive definite matrix; without the detours of NumPy."""
    _, found, failed = dposv(matrix, right)
    return np.linalg.solve(matrix, right) if failed else found


def _product(slopes: Array, weight: Array) -> Array:
    """
    Return slopes @ diag(weight) @ slopes.T, for (m, n) slopes.

    In parts so small that no library spreads them over threads, which takes ten times as long.
    """
    weighted, part = slopes * weight, max(AT_ONCE // len(slopes)**2, 1)
    total = weighted[:, :part] @ slopes[:, :part].T
    for i in range(part, len(weight), part):
        total += weighted[:, i:i + part] @ slopes[:, i:i + part].T
    return total


def _middle(values: Array) -> float:
    """Return the median, the upper one of two: sorted by hand, which is ten times as fast."""
    return float(np.sort(values)[len(values) // 2])
