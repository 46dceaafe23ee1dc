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
Simulated test stand of paper A (III-A): stage, film, charge amplifier, laser and sampling.

The stage moves one clamp of the film, a laser measures the deflection, and a charge amplifier
band-limits the charge to the range between its two corner frequencies. Both are sampled
simultaneously. ``identify film`` reads the recording.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import math

import numpy as np
from scipy.signal import lfilter

from smart_tire.arrays import Array, ArrayLike
from smart_tire.models.film.buckling_film import BucklingFilm, FILMS
from smart_tire.models.film.hysteresis import DuhemParams, respond, series, TABLE_I, TABLE_I_GAIN
from smart_tire.papers.film_files import FilmRecording

OVERSAMPLING = 8  # steps of the amplifier per sample


@dataclass(frozen=True, kw_only=True)
class FilmTestStand:
    """Test stand with a film; the instrument errors are assumed, the paper does not give them."""

    __test__ = False  # not a test class of pytest, despite its name

    film: BucklingFilm = field(default_factory=lambda: FILMS['25x3'])
    hysteresis: DuhemParams = TABLE_I
    gain: float = TABLE_I_GAIN     # C, K
    rate: float = 1000.0           # Hz
    low_corner: float = 0.001      # Hz, high-pass corner of the charge amplifier
    high_corner: float = 20_000.0  # Hz, low-pass corner of the charge amplifier
    charge_noise: float = 0.02e-9  # C, standard deviation of a sample
    laser_noise: float = 5e-6      # m, standard deviation of a sample
    full_scale: float = 50e-9      # C, the range of the converter is +-full_scale
    bits: int = 16                 # of the converter

    def charge(self, deflection: Array, model: str = 'exact') -> Array:
        """Return Q_en [C] at ``deflection`` [m], before hysteresis."""
        charge: Array = self.gain * self.film.normalized_charge(deflection, model)
        return charge

    def run(self, deflection: ArrayLike, seed: int) -> FilmRecording:
        """
        Return the recording of ``deflection`` [m] (n,), one value per sample.

        The film is flat and without hysteresis at first; between two samples the stage moves at
        constant speed.
        """
        path = series('deflection', deflection)
        rng = np.random.default_rng(seed)
        fine = np.interp(np.arange((path.size - 1) * OVERSAMPLING + 1) / OVERSAMPLING,
                         np.arange(path.size), path)
        charge = respond(self.charge(fine), self.hysteresis)
        output = self._amplified(charge)[::OVERSAMPLING]
        output = output + self.charge_noise * rng.standard_normal(path.size)
        return FilmRecording(np.arange(path.size) / self.rate,
                             path + self.laser_noise * rng.standard_normal(path.size),
                             self._converted(output))

    def _amplified(self, charge: Array) -> Array:
        step = 2.0 * math.pi / (OVERSAMPLING * self.rate)
        fast, slow = (-math.expm1(-corner * step) for corner in (self.high_corner,
                                                                 self.low_corner))
        passed = lfilter([fast], [1.0, fast - 1.0], charge)
        # charge drained through the feedback resistor since the start
        drained = lfilter([0.0, slow], [1.0, slow - 1.0], passed)
        amplified: Array = passed - drained
        return amplified

    def _converted(self, charge: Array) -> Array:
        lsb = 2.0 * self.full_scale / 2**self.bits
        return np.clip(np.round(charge / lsb) * lsb, -self.full_scale, self.full_scale - lsb)
