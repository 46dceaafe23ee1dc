"""
How well friction can be told from one revolution at best: the Cramer-Rao bound.

Unknown are mu and, of each film, contact instant, offset, bending amplitude and both bumps; the
stretch gains are known to their tolerance; contact length, slip and the wheel's motion are known.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.estimation.contact.records import FilmSamples
from smart_tire.estimation.friction.waveform_model import Own, own, Shared, WaveformModel
from smart_tire.parameters.robot import RobotParams


MARGIN = 0.028     # m of travel before and after the contact: bumps, and some rest
BUMP = 0.12        # of the bending peak, Fig. 11(b)
PHASES = 4         # places of the first sample, between two samples, that are averaged
LEAST_GAIN_SIGMA = 1e-9  # relative, of gains that are said to be exact
FREE = (Own.PLACE, Own.OFFSET, Own.BENDING, Own.BEFORE, Own.AFTER, Own.GAIN)


def friction_bound(robot: RobotParams, wheel: str, *, slip: float, sliding: float, speed: float,
                   films: Sequence[int] | None = None) -> float:
    """
    Return the least relative standard deviation of mu that one revolution leaves.

    ``slip`` is B(3)'s lambda, ``sliding`` total slip / critical slip (above 0), ``speed`` [m/s]
    is |r w|; ``films`` are indices, all of ``wheel`` by default. Infinite without slip.
    """
    gains = robot.film.gains(wheel)
    chosen = range(len(gains)) if films is None else films
    variances = [_variance(robot, wheel, tuple(chosen), slip, sliding, speed, phase / PHASES)
                 for phase in range(PHASES)]
    # mu is as wrong as the sliding share, relatively: mu = C_x |s| / (3 F_z w)
    return math.sqrt(float(np.mean(variances))) / sliding


def _variance(robot: RobotParams, wheel: str, films: Sequence[int], slip: float, sliding: float,
              speed: float, phase: float) -> float:
    """Return the variance of the sliding share for one place of the samples."""
    film = robot.film
    reach = 0.5 * (robot.tire.contact_length + film.length) + MARGIN
    step = speed / film.sample_rate
    distance = np.arange(-reach + phase * step, reach, step)
    none = np.zeros(len(distance))
    samples = [FilmSamples(one, distance, none, none.astype(np.int8)) for one in films]
    p = np.zeros(own(len(films), Own.PLACE))
    p[Shared.SLIP], p[Shared.SLIDING] = slip, sliding
    precision = np.zeros_like(p)
    for i, one in enumerate(films):
        peak = film.bending(wheel)[one]
        p[own(i, Own.BENDING):own(i, Own.GAIN)] = peak, BUMP * peak, BUMP * peak
        precision[own(i, Own.GAIN)] = max(film.stretch_gain_tolerance, LEAST_GAIN_SIGMA)**-2
    free = [Shared.SLIDING, *(own(i, which) for i in range(len(films)) for which in FREE)]
    _, slopes = WaveformModel(robot, film.gains(wheel), samples, 0.0).linearised(p)
    information = slopes[free] @ slopes[free].T / film.sample_variance + np.diag(precision[free])
    try:
        return max(float(np.linalg.inv(information)[0, 0]), 0.0)
    except np.linalg.LinAlgError:
        return math.inf
