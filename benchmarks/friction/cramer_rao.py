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
Cramer-Rao bound of mu from a single crossing.

Unknown parameters are mu and, per film, crossing time, offset, bending amplitude and both bumps.
Stretch gains are known to their tolerance; contact length, slip and wheel motion are known.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.estimation.contact.records import FilmSamples
from smart_tire.estimation.friction.waveform_model import (
    film_index, PerFilm, Shared, WaveformModel)
from smart_tire.parameters.robot import RobotParams

TRAVEL_MARGIN = 0.028    # m, before and after the contact: bumps and baseline
BUMP_AMPLITUDE = 0.12    # of the bending peak, Fig. 11(b)
SAMPLING_PHASES = 4      # positions of the first sample within a period, averaged
MIN_GAIN_SIGMA = 1e-9    # relative, for gains without tolerance
FREE_PARAMETERS = (PerFilm.CENTER, PerFilm.OFFSET, PerFilm.BENDING, PerFilm.BEFORE,
                   PerFilm.AFTER, PerFilm.GAIN)


def friction_bound(robot: RobotParams, wheel: str, *, slip: float, normalized_slip: float,
                   speed: float, films: Sequence[int] | None = None) -> float:
    """
    Return the least relative standard deviation of mu from one crossing.

    ``slip`` is B(3)'s lambda, ``normalized_slip`` is above 0, ``speed`` [m/s] is |r w|; ``films``
    are indices, all of ``wheel`` by default. Infinite without slip.
    """
    gains = robot.film.gains(wheel)
    chosen = range(len(gains)) if films is None else films
    variances = [
        _variance(robot, wheel, tuple(chosen), slip, normalized_slip, speed,
                  phase / SAMPLING_PHASES)
        for phase in range(SAMPLING_PHASES)]
    # mu and the normalized slip have the same relative error: mu = C_x |s| / (3 F_z w)
    return math.sqrt(float(np.mean(variances))) / normalized_slip


def _variance(robot: RobotParams, wheel: str, films: Sequence[int], slip: float,
              normalized_slip: float, speed: float, phase: float) -> float:
    """Return the variance of the normalized slip for one sampling phase."""
    film = robot.film
    reach = 0.5 * (robot.tire.contact_length + film.length) + TRAVEL_MARGIN
    step = speed / film.sample_rate
    distance = np.arange(-reach + phase * step, reach, step)
    none = np.zeros(len(distance))
    samples = [FilmSamples(one, distance, none, none.astype(np.int8)) for one in films]
    p = np.zeros(film_index(len(films), PerFilm.CENTER))
    p[Shared.SLIP], p[Shared.NORM_SLIP] = slip, normalized_slip
    precision = np.zeros_like(p)
    for i, one in enumerate(films):
        peak = film.bending(wheel)[one]
        bump = BUMP_AMPLITUDE * peak
        p[film_index(i, PerFilm.BENDING):film_index(i, PerFilm.GAIN)] = peak, bump, bump
        gain_sigma = max(film.stretch_gain_tolerance, MIN_GAIN_SIGMA)
        precision[film_index(i, PerFilm.GAIN)] = gain_sigma**-2
    free = [Shared.NORM_SLIP,
            *(film_index(i, which) for i in range(len(films)) for which in FREE_PARAMETERS)]
    _, slopes = WaveformModel(robot, film.gains(wheel), samples, 0.0).linearized(p)
    information = slopes[free] @ slopes[free].T / film.sample_variance + np.diag(precision[free])
    try:
        return max(float(np.linalg.inv(information)[0, 0]), 0.0)
    except np.linalg.LinAlgError:
        return math.inf
