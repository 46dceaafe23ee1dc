"""
From measured passages to friction: the physics of B(22) and its sigma.

A film tells two things: its stretch, which with the calibrated gain is the longitudinal slip, and
the sliding share w = total slip / critical slip, from the place of its peak. Then
``mu = C_x |s| / (3 F_z w)``. What limits it splits in two: noise, new in every revolution, and
what stays from one to the next (slip, gains, stiffness, load), which averaging must not remove.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.estimation.motion import Estimate, UNKNOWN
from smart_tire.models import brush_tire, tread_film

Array = NDArray[np.float64]

SLIDES = 0.8              # of the critical slip: above, the waveform no longer shows how far
SLIDES_SIGMAS = 4.0       # within which of it a film's noise may hide that ...
TIED = 0.5                # ... if slip and sliding are so correlated that both may be larger
DISAGREEMENT = 4.0        # mean square of normalised differences that is believed
KNOWN = 0.5               # relative sigma of mu above which it is not known
TYPICAL, FACTOR = 0.45, 2.0  # mu of the grounds that there are, and one sigma; assumed
SHARP = 0.05              # relative sigma of mu below which other grounds do not matter
SMALLEST_SLIDING = 0.005  # of the critical slip
STEP = 1e-3               # of sliding, for slopes
GROUNDS = np.geomspace(0.02, 4.0, 1000)  # mu, -
PRIOR = np.exp(-0.5 * (np.log(GROUNDS / TYPICAL) / math.log(FACTOR))**2)  # per ln(mu)


@dataclass(frozen=True, slots=True)
class FilmReading:
    """
    What one film's passage says.

    ``stretch`` is gain times slip, ``sliding`` is total slip / critical slip; ``covariance``
    (2, 2) is that of their noise, ``drift`` (2,) what a slip that changed may have added.
    """

    stretch: float     # V/m
    sliding: float     # -
    covariance: Array
    gain: float        # V/m, calibrated
    drift: Array


@dataclass(frozen=True, slots=True)
class Evidence:
    """Slip and sliding share of one passage with covariances (2, 2) of what errs in them."""

    slip: float     # -, B(3)'s lambda
    sliding: float  # -, total slip / critical slip
    noise: Array    # new in every revolution
    lasting: Array  # gains and the error of the slip estimator

    @property
    def slip_sigma(self) -> float:
        """One sigma of ``slip``."""
        return math.sqrt(self.noise[0, 0] + self.lasting[0, 0])

    @property
    def sliding_sigma(self) -> float:
        """One sigma of ``sliding``."""
        return math.sqrt(self.noise[1, 1] + self.lasting[1, 1])


@dataclass(frozen=True, slots=True)
class Single:
    """
    Friction from one passage: what is measured with Gaussian noise is 1 / mu.

    ``noise`` is new in every revolution; relative to mu, ``slip`` is the sigma from slip and
    gains, which lasts but may change, and ``constant`` that from stiffness and load.
    """

    inverse: float   # 1 / mu
    noise: float     # sigma of it
    slip: float      # relative
    constant: float  # relative

    def estimate(self) -> Estimate:
        """Return mu and one sigma."""
        return friction_estimate(
            self.inverse, math.hypot(self.noise, self.inverse * self.slip), self.constant)


def friction_estimate(inverse: float, sigma: float, relative: float) -> Estimate:
    """
    Return mu and one sigma from 1 / mu and its sigma, and a ``relative`` sigma of mu on top.

    Median and deviation over the grounds that there are: a noisy 1 / mu alone would make large
    or tiny mu out of nothing. UNKNOWN where the passage says little beyond them.
    """
    if sigma < SHARP * inverse:
        return 1.0 / inverse, math.hypot(sigma / inverse, relative) / inverse
    weight = PRIOR * np.exp(-0.5 * ((1.0 / GROUNDS - inverse) / sigma)**2)
    share = np.cumsum(weight)
    if not share[-1] > 0.0:
        return UNKNOWN
    mu = float(GROUNDS[np.searchsorted(share, 0.5 * share[-1])])
    spread = math.sqrt(float(weight @ (GROUNDS - mu)**2) / float(share[-1]))
    return (mu, math.hypot(spread, mu * relative)) if spread < KNOWN * mu else UNKNOWN


def weigh(films: Sequence[FilmReading], tolerance: float) -> Evidence:
    """
    Return slip and sliding from the films of a wheel, at least one, alone.

    ``tolerance`` is the gains' relative sigma. Where films contradict each other, sigmas grow.
    """
    seen = np.array([(film.stretch / film.gain, film.sliding) for film in films])
    noises = [_slip_noise(film) for film in films]
    lastings = [np.diag([(tolerance * slip)**2, 0.0]) for slip, _ in seen]
    weights = [np.linalg.inv(noise + lasting) for noise, lasting in zip(noises, lastings)]
    total = np.linalg.inv(sum(weights))
    best = total @ sum(weight @ one for weight, one in zip(weights, seen))
    chi = sum(float((one - best) @ weight @ (one - best)) for weight, one in zip(weights, seen))
    scale = max(1.0, chi / max(2 * len(films) - 2, 1) / DISAGREEMENT)
    gains = [total @ weight for weight in weights]
    noise, lasting = (scale * sum(gain @ part @ gain.T for gain, part in zip(gains, parts))
                      for parts in (noises, lastings))
    return _where_all_slides(Evidence(
        float(best[0]), max(float(best[1]), SMALLEST_SLIDING), noise, lasting))


def _slip_noise(film: FilmReading) -> Array:
    """Return the covariance of slip and sliding from the noise of a film."""
    to_slip = np.array([1.0 / film.gain, 1.0])
    noise: Array = (film.covariance + np.diag(film.drift**2)) * np.outer(to_slip, to_slip)
    return noise


def _where_all_slides(evidence: Evidence) -> Evidence:
    """Return ``evidence`` that knows: if the whole patch may slide, slip / sliding shows only."""
    noise = evidence.noise
    tied = noise[0, 1] * math.copysign(1.0, evidence.slip)
    if (evidence.sliding + SLIDES_SIGMAS * math.sqrt(noise[1, 1]) < SLIDES
            or tied < TIED * math.sqrt(noise[0, 0] * noise[1, 1])):
        return evidence
    both = np.array([evidence.slip, evidence.sliding])
    return replace(evidence, noise=noise + np.outer(both, both))


def join_slip(evidence: Evidence, slip: Estimate) -> Evidence:
    """Return ``evidence`` with the slip estimator's slip; where they disagree, sigmas grow."""
    if not math.isfinite(slip[0]):
        return evidence
    both, variance = evidence.noise + evidence.lasting, slip[1]**2
    off, spread = slip[0] - evidence.slip, both[0, 0] + variance
    scale = max(1.0, off**2 / spread / DISAGREEMENT)
    gain = both[:, 0] / spread
    keep = np.eye(2) - np.outer(gain, [1.0, 0.0])
    return Evidence(
        evidence.slip + float(gain[0]) * off,
        max(evidence.sliding + float(gain[1]) * off, SMALLEST_SLIDING),
        scale * keep @ evidence.noise @ keep.T,
        scale * (keep @ evidence.lasting @ keep.T + variance * np.outer(gain, gain)))


def map_sliding(evidence: Evidence, film_length: float, contact_length: float,
                method: str) -> Evidence:
    """Return ``evidence`` as the ``method`` (exact or printed) would read it off the peaks."""
    if method == 'exact':
        return evidence

    def printed(sliding: float) -> float:
        stuck = contact_length * max(1.0 - sliding, 0.0)
        x_m = tread_film.peak_position(stuck, film_length, contact_length)
        length = tread_film.adhesion_length(x_m, film_length, contact_length, 'printed')
        return 1.0 - float(length) / contact_length

    slope = (printed(evidence.sliding + STEP) - printed(evidence.sliding - STEP)) / (2.0 * STEP)
    scale = np.outer([1.0, slope], [1.0, slope])
    return replace(evidence, sliding=max(printed(evidence.sliding), SMALLEST_SLIDING),
                   noise=evidence.noise * scale, lasting=evidence.lasting * scale)


def total_slip(slip: Estimate, lateral_slip: Estimate) -> Estimate:
    """Return the magnitude of the combined slip."""
    total = math.hypot(slip[0], lateral_slip[0])
    if not total > 0.0:
        return UNKNOWN
    return total, math.hypot(slip[0] * slip[1], lateral_slip[0] * lateral_slip[1]) / total


def single_friction(evidence: Evidence, lateral_slip: Estimate, load: Estimate,
                    stiffness: Estimate) -> Single | None:
    """Return mu of one passage, None where the sliding share or the slip do not tell."""
    total = math.hypot(evidence.slip, lateral_slip[0])
    if not (total > 0.0 and load[0] > 0.0):
        return None
    inverse = 3.0 * load[0] * evidence.sliding / (stiffness[0] * total)
    # d ln(1 / mu) by slip and sliding
    slope = np.array([-evidence.slip / total**2, 1.0 / evidence.sliding])
    noise = inverse * math.sqrt(slope @ evidence.noise @ slope)
    lasting = math.sqrt(slope @ evidence.lasting @ slope)
    lateral = lateral_slip[0] * lateral_slip[1] / total**2
    return Single(inverse, noise, math.hypot(lasting, lateral),
                  math.hypot(load[1] / load[0], stiffness[1] / stiffness[0]))


def traction_force(evidence: Evidence, lateral_slip: Estimate, direction: int, load: Estimate,
                   stiffness: Estimate) -> Estimate:
    """
    Return the longitudinal force [N] on the robot, positive forward, from the brush model.

    It needs no friction coefficient: the sliding share stands for it.
    """
    if not math.isfinite(lateral_slip[0]) or not load[0] > 0.0:
        return UNKNOWN

    def force(slip: float, sliding: float, slope: float) -> float:
        total = math.hypot(slip, lateral_slip[0])
        mu = slope * total / (3.0 * load[0] * max(sliding, SMALLEST_SLIDING))
        return float(brush_tire.brush_force(
            direction * slip, lateral_slip[0], mu, load[0], slope)[0])

    slip, sliding, slope = evidence.slip, evidence.sliding, stiffness[0]
    slip_sigma, sliding_sigma = evidence.slip_sigma, evidence.sliding_sigma
    here = force(slip, sliding, slope)
    return here, math.hypot(force(slip + slip_sigma, sliding, slope) - here,
                            force(slip, sliding + sliding_sigma, slope) - here,
                            force(slip, sliding, slope + stiffness[1]) - here)
