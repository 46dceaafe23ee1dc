# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Coarse matched-filter detection of a film crossing, used to initialize the waveform fit.

The model waveform from entry to release is correlated with the samples at center positions a few
millimeters apart, and its amplitudes are found by least squares; a parabola through the three
best positions interpolates to a fraction of a millimeter.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.contact.records import Detection
from smart_tire.models.tire import strain_charge, tread_film
from smart_tire.parameters.robot import RobotParams

SEARCH_STEP = 0.0025   # m, between tried center positions
TABLE_STEP = 1e-4      # m, between entries of the waveform table
RELEASE_TAIL = 12.0 * tread_film.RECOVERY  # film lengths, after which it has decayed
MAX_SEARCH_SAMPLES = 60  # longer segments are decimated for the search
NORMALIZED_SLIPS = np.array([0.15, 0.5, 1.0])  # -, total slip / critical slip of the templates
ENTRY_SHARE = 0.75     # of the film length: before, the signal is small and disturbed by bumps
BENDING_SIGMA = 0.5    # relative, of the bending peak: varies by cycle and is poorly calibrated
SLIP_SIGMA = 1.0       # -, of the weak prior on slip
MIN_SAMPLES = 8        # from entry to release
PLAUSIBLE_BENDING = (0.3, 3.0)  # range of the bending peak over its nominal value
MAX_RESIDUAL = 0.2     # of the bending peak, rms
GAP_STEPS = 2.5        # median steps between samples: a longer step is a gap


class CrossingDetector:
    """Detects crossings of a robot's films in their samples."""

    def __init__(self, robot: RobotParams) -> None:
        film, patch = robot.film, robot.tire.contact_length
        self._film_length, self._patch = film.length, patch
        self._center_offset = 0.5 * (patch - film.length)  # x where the centers coincide
        self._variance = film.sample_variance
        # tables of the bending output, and of the stretch output per slip for NORMALIZED_SLIPS
        self._table_begin = -film.length - TABLE_STEP
        x = np.arange(self._table_begin, patch + RELEASE_TAIL * film.length, TABLE_STEP)
        t = NORMALIZED_SLIPS[:, np.newaxis]
        strain = strain_charge.overlap_integral(x, t, t, 1.0, film.length, patch) / t
        first, second = tread_film.RELEASE_WEIGHTS.values()
        between = 0.5 * (first[0] + second[0]), 0.5 * (first[1] + second[1])
        self._tables = [np.concatenate([
            tread_film.bending(x, film.length, patch, film.bending_alpha,
                               release).value[np.newaxis], strain])
                        for release in (film.release, between)]
        for table in self._tables:
            table[:, -1] = 0.0

    def detect(self, distance: Array, volts: Array, *, bending: float, gain: float,
               between: tuple[float, float]) -> Detection | None:
        """
        Return the film crossing in ``volts`` above baseline, None if there is none.

        ``distance`` (n,) [m] is rolled in the direction of motion, up to a constant. The center
        is searched ``between`` two distances. ``bending`` [V] and ``gain`` [V/m] are nominal. A
        release between the two conventions is tried if the configured one does not fit.
        """
        if len(distance) < MIN_SAMPLES:
            return None
        for table in self._tables:
            found = self._detect(table, distance, volts, bending, gain, between)
            if found is not None:
                return found
        return None

    def _detect(self, table: Array, distance: Array, volts: Array, bending: float, gain: float,
                between: tuple[float, float]) -> Detection | None:
        centers = np.arange(between[0], between[1] + SEARCH_STEP, SEARCH_STEP)
        stride = max(len(distance) // MAX_SEARCH_SAMPLES, 1)
        shifted = distance + self._center_offset
        score = self._score(self._templates(table, shifted[::stride] - centers[:, np.newaxis]),
                            volts[::stride], bending, gain)
        j, i = divmod(int(score.argmax()), len(centers))
        center = float(centers[i]) + SEARCH_STEP * _peak_offset(score[j], i)
        x = shifted - center
        inside = (x > -ENTRY_SHARE * self._film_length) & (x < self._patch)
        x, volts = x[inside], volts[inside]
        if len(x) < MIN_SAMPLES:
            return None
        templates = self._templates(table, x)
        bend, strain = templates[0], templates[1 + j]
        amplitude, stretch = map(float, self._amplitudes(
            bend @ bend, strain @ strain, bend @ strain, bend @ volts, strain @ volts, bending,
            gain))
        residual = volts - amplitude * bend - stretch * strain
        low, high = PLAUSIBLE_BENDING
        if not (low * bending < amplitude < high * bending
                and math.sqrt(residual @ residual / len(residual)) < MAX_RESIDUAL * amplitude):
            return None
        return Detection(center, amplitude, stretch / gain, float(NORMALIZED_SLIPS[j]),
                         self._coverage(x))

    def _score(self, templates: Array, volts: Array, bending: float, gain: float) -> Array:
        """Return the squared signal [V^2] that each template explains at each center."""
        b, s = templates[0], templates[1:]
        bv, sv = b @ volts, s @ volts
        amplitude, stretch = self._amplitudes(
            np.einsum('ij,ij->i', b, b), np.einsum('kij,kij->ki', s, s),
            np.einsum('ij,kij->ki', b, s), bv, sv, bending, gain)
        bv = bv + self._variance / (BENDING_SIGMA**2 * bending)
        return amplitude * bv + stretch * sv

    def _amplitudes(self, bb: Array, ss: Array, bs: Array, bv: Array, sv: Array, bending: float,
                    gain: float) -> tuple[Array, Array]:
        """
        Return bending [V] and stretch [V/m] amplitudes from inner products.

        Solves the weakly regularized normal equations for all centers at once; ``b``, ``s`` and
        ``v`` name the bending template, the stretch template and the samples.
        """
        weak = self._variance / (BENDING_SIGMA * bending)**2
        bb, ss = bb + weak, ss + self._variance / (SLIP_SIGMA * gain)**2
        bv = bv + weak * bending
        determinant = bb * ss - bs * bs
        return (ss * bv - bs * sv) / determinant, (bb * sv - bs * bv) / determinant

    def _templates(self, table: Array, x: Array) -> Array:
        """Return bending and stretch per slip at positions x, (1 + templates, ...)."""
        index = ((x - self._table_begin) * (1.0 / TABLE_STEP) + 0.5).astype(np.intp)
        found: Array = table.take(index, axis=1, mode='clip')
        return found

    def _coverage(self, x: Array) -> float:
        """Return the share of the crossing that the samples at positions x cover."""
        x = np.sort(x)
        steps = x[1:] - x[:-1]
        median = float(np.sort(steps)[len(steps) // 2])
        covered = float(np.minimum(steps, GAP_STEPS * median).sum())
        return min(covered / (self._patch + ENTRY_SHARE * self._film_length), 1.0)


def _peak_offset(values: Array, i: int) -> float:
    """Return the offset, in steps, of a parabola's maximum from the ``i``-th of ``values``."""
    if not 0 < i < len(values) - 1:
        return 0.0
    below, top, above = values[i - 1:i + 2].tolist()
    curvature = below - 2.0 * top + above
    return min(max(0.5 * (below - above) / curvature, -0.5), 0.5) if curvature < 0.0 else 0.0
