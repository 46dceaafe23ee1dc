"""
Fit of the whole waveform of a passage: all films of a wheel together.

Least squares with priors, by Gauss-Newton with Levenberg's damping: slip and sliding share are
those of all films, the rest belongs to each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.estimation.contact.records import CrossingSamples
from smart_tire.estimation.friction.levenberg_marquardt import (
    FitResult, HUBER_THRESHOLD, LevenbergMarquardt, Prior, solve_spd, upper_median)
from smart_tire.estimation.friction.motion_history import ValueSigma
from smart_tire.estimation.friction.waveform_model import Own, own, Shared, WaveformModel
from smart_tire.numerics.robust import MAD_TO_SIGMA
from smart_tire.parameters.robot import RobotParams


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
LEAST_STRAYS = 1e-4      # -, smallest sigma of a change of the sliding share beside the slip's
LEAST_TOLERANCE = 1e-6   # relative, of gains that are said to be exact


@dataclass(frozen=True, slots=True)
class SlipKnowledge:
    """What is known of the slip without the films."""

    slip: ValueSigma = (0.0, SLIP_SIGMA)  # -, at the reference
    change: ValueSigma = (0.0, 0.0)       # -, of the slip over a contact length
    follows: float = 1.0  # share of a relative change of the slip that the sliding share makes ...
    strays: float = 0.0   # -, ... and one sigma of what it changes beside, over a contact length


@dataclass(frozen=True, slots=True, eq=False)
class WaveformFit:
    """
    What was fitted to one passage.

    ``parameters`` and their ``covariance`` have the order of ``WaveformModel``; ``noise`` and
    ``lasting`` split the covariance (2, 2) of slip and sliding into what is new in every passage
    and what gains and the slip from elsewhere leave.
    """

    passage: CrossingSamples
    parameters: Array
    covariance: Array
    noise: Array
    lasting: Array
    residual: float  # V, rms
    excess: float    # mean square of residuals over that of the noise, at least 1

    @property
    def slip(self) -> ValueSigma:
        """Return the longitudinal slip ratio with one sigma."""
        return self._estimate(Shared.SLIP)

    @property
    def sliding(self) -> ValueSigma:
        """Return total slip / critical slip with one sigma; noise may make it negative."""
        return self._estimate(Shared.SLIDING)

    def shared(self, which: Shared) -> ValueSigma:
        """Return a parameter that the films share, with one sigma."""
        return self._estimate(which)

    def own(self, position: int, which: Own) -> ValueSigma:
        """Return a parameter of the film at ``position`` in the passage, with one sigma."""
        return self._estimate(own(position, which))

    def _estimate(self, index: int) -> ValueSigma:
        return (float(self.parameters[index]),
                math.sqrt(max(float(self.covariance[index, index]), 0.0)))


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
        self._passage: CrossingSamples | None = None  # that was fitted last
        self._descent: LevenbergMarquardt
        self._last: tuple[WaveformFit, FitResult] | None = None

    def fit(self, passage: CrossingSamples, known: SlipKnowledge = SlipKnowledge(),
            start: WaveformFit | None = None) -> WaveformFit | None:
        """
        Return the fit of ``passage``, None where a film has too few samples.

        A fit of the same passage with other knowledge of the slip is a good ``start``.
        """
        if min(len(one.distance) for one in passage.films) < FEWEST:
            return None
        if passage is not self._passage:
            self._descent = LevenbergMarquardt(self._model(passage), passage.films, self._variance)
            self._passage, self._last = passage, None
        if start is not None:
            last = self._last
            # the last fit ended where the model is known already
            return self._descend(passage, known, last[1].point.p if last and last[0] is start
                                 else start.parameters)
        p = self._start(passage)
        found = self._descend(passage, known, p)
        if found.excess > SUSPECT:
            p = p.copy()
            p[Shared.SLIP] *= -1.0
            found = min(found, self._descend(passage, known, p), key=lambda fit: fit.excess)
        return found

    def _descend(self, passage: CrossingSamples, known: SlipKnowledge, p: Array) -> WaveformFit:
        end = self._descent.run(p, self._prior(passage, known, float(p[Shared.SLIP])))
        found = _judged(passage, end)
        self._last = found, end
        return found

    def apart(self, fit: WaveformFit) -> list[ValueSigma]:
        """
        Return the sliding share as each film alone would tell it, to first order.

        ``fit`` must be the last one of this fitter.
        """
        if self._last is None or self._last[0] is not fit:
            raise EstimatorError('films can be told apart in the last fit only')
        return self._descent.per_film_sliding(self._last[1])

    def volts(self, fit: WaveformFit) -> list[Array]:
        """Return what the fit says of each sample [V] above rest, film by film."""
        passage = fit.passage
        output, _ = self._model(passage).linearised(fit.parameters)
        ends = np.cumsum([len(one.distance) for one in passage.films])[:-1]
        return np.split(output, ends)

    def _model(self, passage: CrossingSamples) -> WaveformModel:
        return WaveformModel(self._robot, self._gains, passage.films, passage.reference,
                             len(passage.errors.warps))

    def _start(self, passage: CrossingSamples) -> Array:
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

    def _prior(self, passage: CrossingSamples, known: SlipKnowledge, slip: float) -> Prior:
        count, errors = len(passage.films), passage.errors
        value, sigma = np.zeros((2, own(count, Own.PLACE) + len(errors.warps)))
        scale = math.copysign(max(abs(slip), LEAST_SLIP), slip)  # GROWTH is relative to the slip
        growth, strays = known.change[0] / scale, max(known.strays, LEAST_STRAYS)
        value[:len(Shared)] = (
            known.slip[0], TYPICAL_SLIDING, growth, known.follows * growth, 0.0, 0.0, 0.0)
        sigma[:len(Shared)] = (
            known.slip[1], SLIDING_SIGMA, known.change[1] / abs(scale), strays, errors.scale,
            ALPHA_SIGMA, self._length_sigma)
        sigma[own(count, Own.PLACE):] = errors.warps
        recovery = RECOVERY_SIGMA if self._robot.film.release == 'fig8' else 0.0
        for i, (one, seen) in enumerate(zip(passage.films, passage.sightings)):
            peak, block = self._bending[one.film], slice(own(i, Own.PLACE), own(i + 1, Own.PLACE))
            value[block] = seen.middle, 0.0, peak, BUMP * peak, BUMP * peak, 0.0, 0.0
            sigma[block] = (PLACE_SIGMA, OFFSET_SIGMA, BENDING_SIGMA * peak, BUMP_SIGMA * peak,
                            BUMP_SIGMA * peak, self._gain_sigma, recovery)
        free = np.flatnonzero(sigma > 0.0)
        precision = np.diag(sigma[free]**-2)
        if known.change[1] > 0.0:  # what is known of SPREAD is how it differs from that of GROWTH
            tie = np.array([-known.follows, 1.0])
            both = np.searchsorted(free, [Shared.GROWTH, Shared.SPREAD])
            precision[both[:, np.newaxis], both] += np.outer(tie, tie) / strays**2
            precision[both[1], both[1]] -= 1.0 / strays**2
        lasting = [Shared.SLIP, *(own(i, Own.GAIN) for i in range(count))]
        return Prior(value, precision, free, np.array(lasting, dtype=np.intp))


def _judged(passage: CrossingSamples, end: FitResult) -> WaveformFit:
    """Return what was fitted, with its covariance."""
    p, prior, counted = end.p, end.prior, end.weight > 0.0
    residual, weight = end.point.residual[counted], end.weight[counted]
    freedom = max(len(residual) - len(prior.free), 1)
    # stray samples count as far as they weigh, a model that does not hold as much as it fails
    squares = residual * residual
    size = weight * squares
    excess = max(1.0, float(np.minimum(size, HUBER_THRESHOLD**2).sum()) / freedom,
                 upper_median(size) * MAD_TO_SIGMA**2)
    covariance = np.zeros((len(p), len(p)))
    covariance[prior.free[:, np.newaxis], prior.free] = solve_spd(
        end.hessian, np.eye(len(end.hessian)))
    both = covariance[[Shared.SLIP, Shared.SLIDING]]
    through = both[:, prior.systematic]
    lasts = np.searchsorted(prior.free, prior.systematic)
    lasting = (through * prior.precision[lasts, lasts]) @ through.T
    noise = excess * (both[:, [Shared.SLIP, Shared.SLIDING]] - lasting)
    return WaveformFit(passage, p, excess * covariance, noise, lasting,
                       math.sqrt(float(squares.sum()) / len(squares)), excess)
