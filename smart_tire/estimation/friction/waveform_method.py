"""
What the waveforms of a passage tell: slip and sliding share, from the films alone and with slip.

The films alone are read first, for ``film_slip`` must not know what the slip estimator says; then
the same fit goes on with the estimated slip as a prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.brush_inversion import (
    consistency_inflation, flag_full_sliding, SlipFit)
from smart_tire.estimation.friction.motion_history import ValueSigma, WheelMotion
from smart_tire.estimation.friction.waveform_fit import (
    LEAST_SLIP, SlipKnowledge, WaveformFit, WaveformFitter)
from smart_tire.estimation.friction.waveform_model import Own, own, Shared
from smart_tire.models.tire import strain_charge
from smart_tire.parameters.robot import RobotParams


PLAUSIBLE_BENDING = (0.3, 3.0)  # of the nominal bending peak
LARGEST_RESIDUAL = 0.2          # of the bending peak, rms
PLACE_SIGMA = 0.003      # m, beyond which the place is not known
KNOWN_PEAK = 0.3         # of the contact length, one sigma of x_m above which it is not known
CHANGE_NOISE = 0.0005   # -, change of slip over a contact length while nothing changes ...
UNSEEN_CHANGE = 0.01     # -, ... and as long as nobody tells whether it does
CHANGE_ERROR = 0.5       # share of a change that the slip estimator may have wrong
UNSEEN = 0.5             # share of a wheel's change of speed that may go into its slip
TRANSIENT = 0.05         # share of a wheel's change of speed by which its slip strays from a line
CURVED = 0.5             # of the square of the slip's relative change, which a line leaves out
SMALL_SLIP = 0.01        # -, below which a relative change means nothing
SPEED_NOISE = 0.01       # relative change of speed that a jittering angle shows in one pass
MISFIT = 1.25            # mean square of normalised residuals from which films are compared
DIFFERENT = 2.0          # sigmas between two films that are two grounds
UNKNOWN_GAIN = 1.0       # relative sigma of gains of which nothing is used
STEP = 1e-3              # -, of the sliding share, for a slope


@dataclass(frozen=True, slots=True)
class WaveformResult:
    """What a passage tells before load and stiffness come in."""

    alone: SlipFit   # from the films
    joined: SlipFit  # with what the slip estimator says
    shift: float      # m, by which the passage was later than it was sighted
    peaks: dict[str, ValueSigma]  # ``stretch_voltage`` and ``peak_interval``, where they exist
    fit: WaveformFit | None = None  # that of ``joined``, where the method is a fit


class WaveformReader:
    """Reads the passages of one wheel by fits of the whole waveform."""

    def __init__(self, wheel: str, robot: RobotParams) -> None:
        self._film, self._patch = robot.film, robot.tire.contact_length
        self._gains, self._bending = robot.film.gains(wheel), robot.film.bending(wheel)
        self._fitter = WaveformFitter(robot, self._gains, self._bending)
        # the films' slip is in the estimated one already: their gains must not tell it twice
        self._joining = self._fitter if not robot.slip.film_aided else WaveformFitter(
            robot, self._gains, self._bending, gain_sigma=UNKNOWN_GAIN)

    def read(self, passage: PatchCrossing, motion: WheelMotion) -> WaveformResult | None:
        """Return what ``passage`` tells, None if it does not look like one."""
        samples = passage.samples
        if samples is None:
            return None
        turned = max(passage.speed_change - SPEED_NOISE, 0.0)
        unseen, stray = UNSEEN * turned * self._patch / passage.way, TRANSIENT * turned
        unknown = SlipKnowledge(change=(0.0, math.hypot(UNSEEN_CHANGE, unseen)))
        first = self._fitter.fit(samples, unknown)
        if first is None or not self._plausible(first):
            return None
        shown = _strayed(first, stray)
        alone = flag_full_sliding(shown, first.noise)
        best, joined = first, alone
        if math.isfinite(motion.slip[0]):
            change = motion.slip_rate * self._patch / passage.speed
            sigma = math.hypot(CHANGE_NOISE, CHANGE_ERROR * change, unseen)
            known = SlipKnowledge(motion.slip, (change, sigma), *_spread(
                motion, passage.speed, change))
            start = first if alone is shown else _along(first, motion.slip[0])
            found = self._joining.fit(samples, known, start)
            assert found is not None  # as the first was not
            best = found
            joined = self._compared(
                best, known, math.hypot(motion.slip_bend, stray)).inflated(
                    consistency_inflation(alone, motion.slip))
        return WaveformResult(alone, joined, self._shift(first), self._peaks(best, passage), best)

    def _plausible(self, fit: WaveformFit) -> bool:
        low, high = PLAUSIBLE_BENDING
        for i, one in enumerate(fit.passage.films):
            bending = fit.own(i, Own.BENDING)[0]
            if not (low < bending / self._bending[one.film] < high
                    and fit.residual < LARGEST_RESIDUAL * bending
                    and fit.own(i, Own.PLACE)[1] < PLACE_SIGMA):
                return False
        return True

    def _compared(self, fit: WaveformFit, known: SlipKnowledge, stray: float) -> SlipFit:
        """Return what ``fit`` tells, less sharply where the films met two grounds."""
        evidence, passage = _strayed(fit, stray), fit.passage
        if fit.excess < MISFIT or len(passage.films) < 2 or not self._differ(
                self._joining.apart(fit), fit):
            return evidence
        parts = [self._joining.fit(replace(passage, films=(one,), sightings=(seen,)), known)
                 for one, seen in zip(passage.films, passage.sightings)]
        slidings = [part.sliding for part in parts if part is not None]
        if not self._differ(slidings, fit):
            return evidence
        off = np.array([sliding for sliding, _ in slidings]) - fit.sliding[0]
        return replace(evidence, noise=evidence.noise + np.diag([0.0, float(np.mean(off**2))]))

    @staticmethod
    def _differ(slidings: list[ValueSigma], fit: WaveformFit) -> bool:
        """Return whether one of ``slidings`` is another one than that of ``fit``."""
        return any(abs(sliding - fit.sliding[0]) > DIFFERENT * sigma
                   for sliding, sigma in slidings)

    @staticmethod
    def _shift(fit: WaveformFit) -> float:
        """Return how much later [m] the films passed than they were sighted."""
        sightings = fit.passage.sightings
        return float(np.average(
            [fit.own(i, Own.PLACE)[0] - seen.middle for i, seen in enumerate(sightings)],
            weights=[seen.coverage for seen in sightings]))

    def _peaks(self, fit: WaveformFit, passage: PatchCrossing) -> dict[str, ValueSigma]:
        """Return the two peaks of film 1 as Fig. 8 draws them; none when braking."""
        length = self._film.length
        slip, sliding = fit.slip[0], fit.sliding[0]
        if fit.passage.films[0].film or length >= self._patch or slip <= 0.0 or sliding <= 0.0:
            return {}

        def position(share: float) -> float:
            stuck = max(1.0 - share, 0.0) * self._patch
            return float(strain_charge.peak_position(stuck, length, self._patch))

        x_m = position(sliding)
        by_sliding = (position(sliding + STEP) - position(sliding - STEP)) / (2.0 * STEP)
        if by_sliding * fit.sliding[1] > KNOWN_PEAK * self._patch:
            return {}
        part = strain_charge.overlap(np.array([x_m]), sliding, length, self._patch)
        unit, gain = float(part.value[0]), self._gains[0] * (1.0 + fit.own(0, Own.GAIN)[0])
        chosen = [Shared.SLIP, Shared.SLIDING, own(0, Own.GAIN)]
        slope = np.array([gain * unit, gain * slip * float(part.by_normalized_slip[0]),
                          self._gains[0] * slip * unit])
        covariance = fit.covariance[np.ix_(chosen, chosen)]
        scale, scale_sigma = fit.shared(Shared.SCALE)
        interval = (self._patch - x_m) / (passage.speed * (1.0 + scale))
        spread = math.hypot(by_sliding * fit.sliding[1] / passage.speed, scale_sigma * interval)
        return {'stretch_voltage': (gain * slip * unit, math.sqrt(slope @ covariance @ slope)),
                'peak_interval': (interval, spread)}


def _spread(motion: WheelMotion, speed: float, change: float) -> tuple[float, float]:
    """
    Return which share of a relative change of slip the sliding makes, and sigma of what else.

    The sliding share follows the total slip, in which the longitudinal and the lateral slip count
    by their squares; while the one changes the other may as much, either way.
    """
    slip, scale = motion.slip[0]**2, max(abs(motion.slip[0]), LEAST_SLIP)
    lateral = (motion.lateral[0] / speed)**2
    own = slip / (slip + lateral) if math.isfinite(lateral) and slip > 0.0 else UNSEEN
    return own, (1.0 - own) * math.hypot(change, CHANGE_NOISE) / scale


def _along(fit: WaveformFit, slip: float) -> WaveformFit:
    """Return ``fit`` moved to ``slip`` with slip / sliding as it is: where all slides, a start."""
    scale = slip / fit.slip[0] if fit.slip[0] else 0.0
    if not scale > 0.0:
        return fit
    parameters = fit.parameters.copy()
    parameters[[Shared.SLIP, Shared.SLIDING]] *= scale
    return replace(fit, parameters=parameters)


def _strayed(fit: WaveformFit, stray: float) -> SlipFit:
    """
    Return what ``fit`` tells of a slip that strayed by so much [-] from a straight line.

    Where the slip changes by much of itself a straight line does not hold either.
    """
    slip, sliding = fit.slip[0], fit.sliding[0]
    size = max(abs(slip), SMALL_SLIP)
    growth, spread = (math.hypot(CURVED * sum(map(_squared, fit.shared(which))), stray / size)
                      for which in (Shared.GROWTH, Shared.SPREAD))
    off = np.array([growth * size, spread * sliding])
    return SlipFit(slip, sliding, fit.noise + np.diag(off**2), fit.lasting)


def _squared(value: float) -> float:
    return value * value
