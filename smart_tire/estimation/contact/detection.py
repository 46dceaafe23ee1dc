"""
First look at a contact: whether it is a film's passage, and roughly where.

The waveform from entry to release is laid over the samples at places a few millimetres apart, and
amplitudes are solved for; a parabola through the best three places gives a fraction of a
millimetre. A fit of the whole waveform starts from here.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.contact.records import Detection
from smart_tire.models.tire import strain_charge, tread_film
from smart_tire.parameters.robot import RobotParams


STEP = 0.0025          # m, between the places that are tried
FINE = 1e-4            # m, between entries of the table
TAIL = 12.0 * tread_film.RECOVERY  # m, after which the release has died away
MOST = 60              # samples that a search takes; more are thinned out
SLIDINGS = np.array([0.15, 0.5, 1.0])  # -, of total slip / critical slip, that are tried
ENTRY = 0.75           # of the film's length: before, the charge is small and bumps disturb it
BENDING_SIGMA = 0.5    # relative, of the bending peak: cycle to cycle, and badly known
SLIP_SIGMA = 1.0       # -, weakest possible knowledge of the slip
FEWEST = 8             # samples from entry to release
PLAUSIBLE_BENDING = (0.3, 3.0)  # of the nominal bending peak
LARGEST_RESIDUAL = 0.2  # of the bending peak, rms
LONG_STEP = 2.5         # of the median step between samples: a longer one is a gap


class CrossingDetector:
    """Looks for passages of a robot's films."""

    def __init__(self, robot: RobotParams) -> None:
        film, patch = robot.film, robot.tire.contact_length
        self._film_length, self._patch = film.length, patch
        self._lead = 0.5 * (patch - film.length)  # x where the middles coincide
        self._variance = film.sample_variance
        # bending, and stretch per slip for each of SLIDINGS, read off a table
        self._first = -film.length - FINE
        x = np.arange(self._first, patch + TAIL, FINE)
        w = SLIDINGS[:, np.newaxis]
        self._table = np.concatenate([
            tread_film.bending(x, film.length, patch, film.bending_alpha,
                                       film.release).value[np.newaxis],
            strain_charge.overlap_integral(x, w, w, 1.0, film.length, patch) / w])
        self._table[:, -1] = 0.0

    def look(self, distance: Array, volts: Array, *, bending: float, gain: float,
             between: tuple[float, float]) -> Detection | None:
        """
        Return the passage in ``volts`` above rest, None if there is none.

        ``distance`` (n,) [m] is rolled in the direction of motion, up to a constant; the middle
        is looked for ``between`` two distances. ``bending`` [V] and ``gain`` [V/m] are nominal.
        """
        if len(distance) < FEWEST:
            return None
        middles = np.arange(between[0], between[1] + STEP, STEP)
        thin, lead = max(len(distance) // MOST, 1), distance + self._lead
        explained = self._explained(self._parts(lead[::thin] - middles[:, np.newaxis]),
                                    volts[::thin], bending, gain)
        j, i = divmod(int(explained.argmax()), len(middles))
        middle = float(middles[i]) + STEP * _vertex(explained[j], i)
        x = lead - middle
        inside = (x > -ENTRY * self._film_length) & (x < self._patch)
        x, volts = x[inside], volts[inside]
        if len(x) < FEWEST:
            return None
        parts = self._parts(x)
        bend, strain = parts[0], parts[1 + j]
        amplitude, stretch = map(float, self._amplitudes(
            bend @ bend, strain @ strain, bend @ strain, bend @ volts, strain @ volts, bending,
            gain))
        left = volts - amplitude * bend - stretch * strain
        low, high = PLAUSIBLE_BENDING
        if not (low * bending < amplitude < high * bending
                and math.sqrt(left @ left / len(left)) < LARGEST_RESIDUAL * amplitude):
            return None
        return Detection(middle, amplitude, stretch / gain, float(SLIDINGS[j]), self._coverage(x))

    def _explained(self, parts: Array, volts: Array, bending: float, gain: float) -> Array:
        """Return how much [V^2] of ``volts`` each place of each sliding explains."""
        b, s = parts[0], parts[1:]
        bv, sv = b @ volts, s @ volts
        amplitude, stretch = self._amplitudes(
            np.einsum('ij,ij->i', b, b), np.einsum('kij,kij->ki', s, s),
            np.einsum('ij,kij->ki', b, s), bv, sv, bending, gain)
        bv = bv + self._variance / (BENDING_SIGMA**2 * bending)
        return amplitude * bv + stretch * sv

    def _amplitudes(self, bb: Array, ss: Array, bs: Array, bv: Array, sv: Array, bending: float,
                    gain: float) -> tuple[Array, Array]:
        """
        Return bending [V] and stretch [V/m] from the products of both parts and of the samples.

        Normal equations, for all places at once, weakly regularised.
        """
        weak = self._variance / (BENDING_SIGMA * bending)**2
        bb, ss = bb + weak, ss + self._variance / (SLIP_SIGMA * gain)**2
        bv = bv + weak * bending
        determinant = bb * ss - bs * bs
        return (ss * bv - bs * sv) / determinant, (bb * sv - bs * bv) / determinant

    def _parts(self, x: Array) -> Array:
        """Return bending and stretches per slip, (1 + slidings, ...), at places x."""
        index = ((x - self._first) * (1.0 / FINE) + 0.5).astype(np.intp)
        found: Array = self._table.take(index, axis=1, mode='clip')
        return found

    def _coverage(self, x: Array) -> float:
        x = np.sort(x)
        steps = x[1:] - x[:-1]
        middle = float(np.sort(steps)[len(steps) // 2])
        seen = float(np.minimum(steps, LONG_STEP * middle).sum())
        return min(seen / (self._patch + ENTRY * self._film_length), 1.0)


def _vertex(values: Array, i: int) -> float:
    """Return by how many steps the top of the parabola around the ``i``-th value is off it."""
    if not 0 < i < len(values) - 1:
        return 0.0
    below, top, above = values[i - 1:i + 2].tolist()
    bend = below - 2.0 * top + above
    return min(max(0.5 * (below - above) / bend, -0.5), 0.5) if bend < 0.0 else 0.0
