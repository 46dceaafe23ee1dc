"""
Jitter of the stamps of ``wheel_states``, from positions that run on more evenly than the stamps.

Within a few readings angles are a parabola in time. What a stamp is off shows as the same error in
time on both sides, whatever their speeds; what their speeds fluctuate differs between the sides.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import WheelRecord
from smart_tire.errors import EstimatorError
from smart_tire.numerics.robust import MAD_TO_SIGMA
from smart_tire.parameters import RobotParams
from smart_tire.samples import LEFT, RIGHT
from smart_tire.uncertain import Uncertain


# Savitzky and Golay, five readings: what remains of the middle one beside a parabola, and slope.
BESIDE = np.array([3.0, -12.0, 18.0, -12.0, 3.0]) / 35.0
SLOPE = np.array([-2.0, -1.0, 0.0, 1.0, 2.0]) / 10.0
KEPT = 18.0 / 35.0   # of the variance of independent errors
REGULAR = 0.5        # of the period: readings of more uneven stretches are left out
COUNTS = 10.0        # of an encoder between readings, below which rounding hides the stamps
LONGEST = 0.5        # s that five readings may last: within more, a speed is no straight line
FEW = 30             # readings, below which their scatter tells nothing
SIGNIFICANT = 3.0    # sigmas


def fit_jitter(wheels: WheelRecord, robot: RobotParams) -> Uncertain:
    """Return the standard deviation of a stamp [s]; EstimatorError where it does not show."""
    if wheels.position is None:
        raise EstimatorError('wheel_states have no positions')
    if len(wheels.time) < len(BESIDE):
        raise EstimatorError(f'{len(wheels.time)} readings')
    period = float(np.median(np.diff(wheels.time)))
    if (len(BESIDE) - 1) * period > LONGEST:
        raise EstimatorError(f'five readings last {(len(BESIDE) - 1) * period:.2g} s, expected at '
                             f'most {LONGEST:g} s: the wheels change their speed meanwhile')
    sides = np.stack([wheels.position[:, LEFT].mean(axis=1),
                      wheels.position[:, RIGHT].mean(axis=1)], axis=1)
    stamp, step = _filtered(wheels.time, BESIDE), _filtered(wheels.time, SLOPE)
    turned = np.stack([_filtered(side, SLOPE) for side in sides.T], axis=1)  # rad per reading
    count = 2.0 * math.pi / robot.encoder.counts_per_revolution
    gaps = np.lib.stride_tricks.sliding_window_view(np.diff(wheels.time), len(BESIDE) - 1)
    good = (np.abs(turned).min(axis=1) > COUNTS * count) & (
        np.abs(gaps - period).max(axis=1) < REGULAR * period)
    if good.sum() < FEW:
        raise EstimatorError(f'{int(good.sum())} readings with both sides in motion, expected at '
                             f'least {FEW}')
    beside = np.stack([_filtered(side, BESIDE) for side in sides.T], axis=1)
    errors = stamp[good, None] - beside[good] / turned[good] * step[good, None]
    return _shared(errors)


def _filtered(values: Array, kernel: Array) -> Array:
    return np.asarray(np.convolve(values, kernel[::-1], 'valid'))


def _shared(errors: Array) -> Uncertain:
    """Return the standard deviation of what two columns of errors (n, 2) share."""
    both, apart = (MAD_TO_SIGMA * np.median(np.abs(errors @ sign)) for sign in ((1, 1), (1, -1)))
    variance = float(both ** 2 - apart ** 2) / 4.0 / KEPT
    # standard error of a variance by the median absolute deviation of n / 2 independent errors
    doubt = float(both ** 2 + apart ** 2) / 4.0 / KEPT * 2.0 * math.sqrt(2.7 / len(errors))
    if variance < SIGNIFICANT * doubt:
        limit = math.sqrt(max(variance, 0.0) + SIGNIFICANT * doubt)
        raise EstimatorError(f'the speeds fluctuate more than the stamps (below {limit:.2g} s)')
    return Uncertain(math.sqrt(variance), 0.5 * doubt / math.sqrt(variance))
