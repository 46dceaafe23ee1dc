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
Coarse matched-filter detection of film crossings, used to initialize the waveform fit.

The model waveform from entry to release is correlated with the samples at center positions a
fraction of a film apart, and its amplitudes are found by least squares; a parabola through the
three best positions interpolates to a fraction of a millimeter.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.contact import constants as c
from smart_tire.estimation.contact.prediction import MountPosition
from smart_tire.estimation.contact.records import (
    ActiveSegment, Detection, FilmCrossing, FilmGroup)
from smart_tire.estimation.contact.trajectory import WheelTrajectory
from smart_tire.models.tire import strain_charge, tread_film
from smart_tire.parameters.robot import RobotParams


class CrossingDetector:
    """Detects crossings of a robot's films in their samples."""

    def __init__(self, robot: RobotParams) -> None:
        film, patch = robot.film, robot.tire.contact_length
        self._film_length, self._patch = film.length, patch
        self._center_offset = 0.5 * (patch - film.length)  # x where the centers coincide
        self._variance = film.sample_variance
        # tables of the bending output, and of the stretch output per slip for NORMALIZED_SLIPS
        self._step = c.SEARCH_STEP * film.length
        self._table_step = self._step / c.TABLE_STEPS
        self._table_begin = -film.length - self._table_step
        x = np.arange(self._table_begin, patch + c.OUTER_LENGTH * film.length, self._table_step)
        t = c.NORMALIZED_SLIPS[:, np.newaxis]
        strain = strain_charge.overlap_integral(x, t, t, 1.0, film.length, patch) / t
        first, second = tread_film.RELEASE_WEIGHTS.values()
        between = 0.5 * (first[0] + second[0]), 0.5 * (first[1] + second[1])
        self._tables = [np.concatenate([
            tread_film.bending(x, film.length, patch, film.bending_alpha,
                               release)[np.newaxis], strain])
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
        if len(distance) < c.MIN_SAMPLES:
            return None
        found = (self._detect(table, distance, volts, bending, gain, between)
                 for table in self._tables)
        return next((one for one in found if one is not None), None)

    def _detect(self, table: Array, distance: Array, volts: Array, bending: float, gain: float,
                between: tuple[float, float]) -> Detection | None:
        centers = np.arange(between[0], between[1] + self._step, self._step)
        stride = max(len(distance) // c.MAX_SEARCH_SAMPLES, 1)
        shifted = distance + self._center_offset
        templates = self._templates(table, shifted[::stride] - centers[:, np.newaxis])
        *_, score = self._amplitudes(
            templates[0], templates[1:], volts[::stride], bending, gain)
        j, i = divmod(int(score.argmax()), len(centers))
        center = float(centers[i]) + self._step * _peak_offset(score[j], i)
        x = shifted - center
        inside = (x > -c.ENTRY_SHARE * self._film_length) & (x < self._patch)
        x, volts = x[inside], volts[inside]
        if len(x) < c.MIN_SAMPLES:
            return None
        bend, strain = self._templates(table, x)[[0, 1 + j]]
        amplitude, stretch, _ = map(float, self._amplitudes(bend, strain, volts, bending, gain))
        residual = volts - amplitude * bend - stretch * strain
        if not (is_plausible_bending(amplitude, bending)
                and math.sqrt(residual @ residual / len(residual)) < c.MAX_RESIDUAL * amplitude):
            return None
        return Detection(center, amplitude, stretch / gain, float(c.NORMALIZED_SLIPS[j]),
                         self._coverage(x))

    def _amplitudes(self, b: Array, s: Array, v: Array, bending: float, gain: float
                    ) -> tuple[Array, Array, Array]:
        """
        Return bending [V] and stretch [V/m] amplitudes, and the squared signal [V^2] explained.

        Solves the weakly regularized normal equations for all centers at once; ``b``, ``s`` and
        ``v`` are the bending template, the stretch template and the samples, on the last axis.
        """
        weak = self._variance / (c.BENDING_SIGMA * bending)**2
        bb = np.einsum('...i,...i', b, b) + weak
        ss = np.einsum('...i,...i', s, s) + self._variance / gain**2
        bs = np.einsum('...i,...i', b, s)
        bv, sv = b @ v + weak * bending, s @ v
        determinant = bb * ss - bs * bs
        amplitude, stretch = (ss * bv - bs * sv) / determinant, (bb * sv - bs * bv) / determinant
        return amplitude, stretch, amplitude * bv + stretch * sv

    def _templates(self, table: Array, x: Array) -> Array:
        """Return bending and stretch per slip at positions x, (1 + templates, ...)."""
        index = ((x - self._table_begin) / self._table_step + 0.5).astype(np.intp)
        found: Array = table.take(index, axis=1, mode='clip')
        return found

    def _coverage(self, x: Array) -> float:
        """Return the share of the crossing that the samples at positions x cover."""
        steps = np.diff(np.sort(x))
        median = float(np.sort(steps)[len(steps) // 2])
        covered = float(np.minimum(steps, c.GAP_PERIODS * median).sum())
        return min(covered / (self._patch + c.ENTRY_SHARE * self._film_length), 1.0)


def is_plausible_bending(peak: float, nominal: float) -> bool:
    """Return whether the bending ``peak`` [V] can be that of a film with the ``nominal`` one."""
    return nominal / c.MAX_BENDING_RATIO < peak < c.MAX_BENDING_RATIO * nominal


def _peak_offset(values: Array, i: int) -> float:
    """Return the offset, in steps, of a parabola's maximum from the ``i``-th of ``values``."""
    if not 0 < i < len(values) - 1:
        return 0.0
    below, top, above = values[i - 1:i + 2].tolist()
    curvature = below - 2.0 * top + above
    return min(max(0.5 * (below - above) / curvature, -0.5), 0.5) if curvature < 0.0 else 0.0


class FilmCrossingDetector:
    """Detects the crossing of one film of ``group`` in an active segment."""

    def __init__(self, group: FilmGroup, detector: CrossingDetector,
                 trajectory: WheelTrajectory) -> None:
        self._group, self._detector, self._trajectory = group, detector, trajectory

    def detect(self, segment: ActiveSegment, mount: MountPosition) -> FilmCrossing | None:
        """
        Return the crossing in ``segment``, None if there is none.

        The position expected from ``mount`` is searched first, then the whole segment.
        """
        group, instants = self._group, segment.instants
        trajectory = self._trajectory.smooth(int(instants[0]), int(instants[-1]))
        rolled = trajectory.distance_at(instants)
        begin, end = np.interp((segment.begin_ns, segment.end_ns), instants, rolled)
        direction = 1 if end >= begin else -1
        offset = group.offsets[segment.film]
        expected = direction * (mount.expected(0.5 * (begin + end) - offset) + offset)
        gate = c.POSITION_GATE * group.film_length
        latest = direction * begin + group.half_inside
        distance = direction * rolled
        for coverage, low, high in (
                (c.MIN_EXPECTED_COVERAGE, expected - gate, expected + gate),
                # the first active sample is at most a film length after the entry
                (c.MIN_FREE_COVERAGE, latest - 2.0 * group.half_crossing,
                 latest + group.film_length)):
            found = self._search(segment, distance, low, high)
            if found is not None and found.coverage >= coverage:
                instant = int(np.interp(found.center, np.maximum.accumulate(distance), instants))
                return FilmCrossing(direction * found.center, instant, direction, float(begin),
                                    found, segment)
        return None

    def _search(self, segment: ActiveSegment, distance: Array, low: float, high: float
                ) -> Detection | None:
        """Return a detection with its center between two distances [m], which may be NaN."""
        if not math.isfinite(low):
            return None
        bottom, top = self._group.rails
        unclipped = (segment.volts > bottom) & (segment.volts < top)
        return self._detector.detect(
            distance[unclipped], segment.volts[unclipped] - segment.baseline,
            bending=self._group.bending[segment.film], gain=self._group.gains[segment.film],
            between=(low, high))
