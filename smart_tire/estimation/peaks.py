"""
One film's passage, measured: where it was in the patch, and its two peaks.

The two peaks of Fig. 8 are never read off raw samples: at 400 Hz the sharp minimum is read 0.1 V
short, and the maximum is flat. The known local shape is fitted through the samples from the
film's entry to its release, and the peaks are those of the fitted curve.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.models import tread_film
from smart_tire.parameters.robot import RobotParams

Array = NDArray[np.float64]

SEARCH_STEP = 0.0025   # m, of the first guess of the place; the fit converges from twice as far
SEARCH_SLIDING = np.array([0.15, 0.5, 1.0])  # -, shares of the critical slip that are tried
ENTRY = 0.75           # of the film's length: before, the charge is small and bumps disturb it
RELEASE_MARGIN = 3e-4  # m, kept from the sharp minimum, whose far side has no theory
OFFSET_SIGMA = 0.01    # V, of the tracked rest voltage
BENDING_SIGMA = 0.5    # relative, of the bending peak: cycle to cycle, and badly known
SLIP_SIGMA = 1.0       # -, weakest possible knowledge of the slip
TYPICAL_SLIDING = 0.3  # -, of total slip / critical slip ...
SLIDING_SIGMA = 1.0    # -, ... and the weakest possible knowledge of it
SLIDING_RANGE = (0.01, 3.0)  # -, of total slip / critical slip
ITERATIONS = 10
SHORTER = 0.4          # times a step that makes things worse ...
HALVINGS = 6           # ... so often
CONVERGED_SLIDING = 5e-3  # -, likewise
LARGEST_STEP = 0.003   # m, of the place in one iteration
CONVERGED = 5e-5       # m, of the place; the next step would be its square
SLOPE_STEP = 1e-5      # m, for slopes, against 20 mm of film
SLIDING_STEP = 1e-3    # relative, likewise
OUTLIER = 3.0          # sigmas, beyond which a sample counts less
FEWEST = 8             # samples for six unknowns
PLAUSIBLE_BENDING = (0.3, 3.0)  # of the nominal bending peak
LARGEST_RESIDUAL = 0.2          # of the bending peak, rms
PLACE_SIGMA = 0.003    # m, beyond which the place is not known


@dataclass(frozen=True, slots=True)
class Shape:
    """
    What was fitted to one passage of one film.

    ``sliding`` is total slip / critical slip, the share of the patch that slides while below 1;
    ``stretch`` is stretch gain times longitudinal slip. ``covariance`` and ``drift`` have the
    order (middle, stretch, sliding); ``drift`` is by how much these err when the slip changes in
    the passage, per relative change over a contact length.
    """

    middle: float      # m, rolled distance at which film's and patch's middle coincide
    stretch: float     # V/m
    sliding: float     # -
    bending: float     # V
    covariance: Array  # (3, 3)
    drift: Array       # (3,)
    coverage: float    # share of the way from entry to release that was sampled, 0 to 1
    residual: float    # V, rms


@dataclass(frozen=True, slots=True)
class Peaks:
    """The two peaks of one passage; ``position`` and ``height`` of the stretch maximum."""

    position: float        # m, x_m
    position_sigma: float  # m
    height: float          # V, q_sm
    height_sigma: float    # V


@dataclass(frozen=True, slots=True)
class _Track:
    """Samples over the rolled distance."""

    distance: Array  # m
    volts: Array     # V above rest
    warp: float      # m, one sigma of each distance

    def take(self, mask: NDArray[np.bool_]) -> _Track:
        return _Track(self.distance[mask], self.volts[mask], self.warp)


@dataclass(frozen=True, slots=True)
class _Known:
    """
    What is known before a passage is seen.

    The six parameters are the place of the middle [m], the error of the distances' scale [-],
    offset [V], bending [V], stretch [V/m] and sliding [-].
    """

    value: Array
    precision: Array  # 1 / variance


class PassageMeter:
    """Fits the shape of a passage, ``smart_tire.models.tread_film``, to samples."""

    def __init__(self, robot: RobotParams) -> None:
        film = robot.film
        self._film = film
        self._patch = robot.tire.contact_length
        self._lead = 0.5 * (self._patch - film.length)  # x when the middles coincide
        step = film.voltage_range / (2**film.bits - 1)
        self._variance = film.noise**2 + step**2 / 12.0

    def measure(self, distance: Array, volts: Array, *, bending: float, gain: float,
                scale_sigma: float, warp_sigma: float,
                between: tuple[float, float]) -> Shape | None:
        """
        Return the shape of the passage in ``volts`` above rest, None if there is no such shape.

        ``distance`` [m] is rolled in the direction of motion, up to a constant; its relative
        scale is uncertain by ``scale_sigma``, and each distance by ``warp_sigma`` [m], as if
        independent. ``bending`` [V] and ``gain`` [V/m] are nominal;
        the middle of the passage is looked for ``between`` two distances.
        """
        if len(distance) < FEWEST:
            return None
        middle, amplitude, stretch, sliding = self._search(
            distance, volts, bending, gain, between)
        sigma = np.array([math.inf, scale_sigma, OFFSET_SIGMA, BENDING_SIGMA * bending,
                          SLIP_SIGMA * gain, SLIDING_SIGMA])
        known = _Known(np.array([middle, 0.0, 0.0, bending, 0.0, TYPICAL_SLIDING]), sigma**-2)
        start = np.array([middle, 0.0, 0.0, amplitude, stretch, sliding])
        shape = self._fit(_Track(distance, volts, warp_sigma), start, known)
        return shape if shape is not None and self._plausible(shape, bending) else None

    def _plausible(self, shape: Shape, bending: float) -> bool:
        low, high = PLAUSIBLE_BENDING
        return (low * bending < shape.bending < high * bending
                and shape.residual < LARGEST_RESIDUAL * shape.bending
                and float(shape.covariance[0, 0]) < PLACE_SIGMA**2)

    def peaks(self, shape: Shape, change: float) -> Peaks:
        """
        Return the stretch peak that ``shape`` describes; the film must be the shorter.

        ``change`` is the slip's relative change over a contact length.
        """
        def position(sliding: float) -> float:
            stuck = max(1.0 - sliding, 0.0) * self._patch
            return float(tread_film.peak_position(stuck, self._film.length, self._patch))

        step = SLIDING_STEP
        x_m = position(shape.sliding)
        slope = (position(shape.sliding + step) - position(shape.sliding - step)) / (2.0 * step)
        unit, _, by_sliding = (float(part[0])
                               for part in self._stretch(np.array([x_m]), shape.sliding))
        drift = change * shape.drift
        covariance = shape.covariance + np.outer(drift, drift)
        by_place = np.array([1.0, 0.0, slope])  # the release is as uncertain as the place
        by_height = np.array([0.0, unit, shape.stretch * by_sliding])
        return Peaks(x_m, math.sqrt(float(by_place @ covariance @ by_place)),
                     shape.stretch * unit, math.sqrt(float(by_height @ covariance @ by_height)))

    def _search(self, distance: Array, volts: Array, bending: float, gain: float,
                between: tuple[float, float]) -> tuple[float, float, float, float]:
        """Return the best middle, bending, stretch and sliding on a coarse grid."""
        middles = np.arange(between[0], between[1] + SEARCH_STEP, SEARCH_STEP)
        x = (distance - middles[:, np.newaxis] + self._lead)[:, np.newaxis]
        b = self._bending(x)
        w = SEARCH_SLIDING[:, np.newaxis]
        s = tread_film.stretch_integral(x, w, w, 1.0, self._film.length, self._patch) / w
        # normal equations of bending and stretch for all places at once, weakly regularised
        weak = self._variance
        bb = np.sum(b * b, axis=-1) + weak / (BENDING_SIGMA * bending)**2
        ss = np.sum(s * s, axis=-1) + weak / (SLIP_SIGMA * gain)**2
        bs = np.sum(b * s, axis=-1)
        bv = np.sum(b * volts, axis=-1) + weak / (BENDING_SIGMA**2 * bending)
        sv = np.sum(s * volts, axis=-1)
        determinant = bb * ss - bs**2
        amplitude = (ss * bv - bs * sv) / determinant
        stretch = (bb * sv - bs * bv) / determinant
        explained = amplitude * bv + stretch * sv
        i, j = np.unravel_index(int(np.argmax(explained)), explained.shape)
        return (float(middles[i]), float(amplitude[i, j]), float(stretch[i, j]),
                float(SEARCH_SLIDING[j]))

    def _fit(self, track: _Track, p: Array, known: _Known) -> Shape | None:
        """Gauss-Newton from the parameters ``p``."""
        for _ in range(ITERATIONS):
            x = self._place(track.distance, p)
            used = track.take((x > -ENTRY * self._film.length)
                              & (x < self._patch - RELEASE_MARGIN))
            if len(used.distance) < FEWEST:
                return None
            jacobian, residual = self._linearised(used, p)
            weight = self._weights(residual, track.warp * jacobian[:, 0])
            inverse = np.linalg.inv((jacobian * weight[:, np.newaxis]).T @ jacobian
                                    + np.diag(known.precision))
            step = inverse @ (jacobian.T @ (weight * residual)
                              + known.precision * (known.value - p))
            last, p = p, self._descend(used, weight, known, p, step, residual)
            if abs(last[0] - p[0]) < CONVERGED and abs(last[5] - p[5]) < CONVERGED_SLIDING:
                break
        return self._judge(used, p, residual, jacobian, weight, inverse)

    def _descend(self, track: _Track, weight: Array, known: _Known, p: Array, step: Array,
                 residual: Array) -> Array:
        """Return ``p`` after so much of ``step`` that the misfit does not grow."""
        def misfit(q: Array, left: Array) -> float:
            return float(weight @ left**2 + known.precision @ (q - known.value)**2)

        step = step * min(1.0, LARGEST_STEP / max(abs(step[0]), CONVERGED))
        before = misfit(p, residual)
        for _ in range(HALVINGS):
            moved: Array = p + step
            moved[5] = min(max(moved[5], SLIDING_RANGE[0]), SLIDING_RANGE[1])
            if misfit(moved, track.volts - self._model(track.distance, moved)) <= before:
                return moved
            step = SHORTER * step
        return p

    def _judge(self, track: _Track, p: Array, residual: Array, jacobian: Array, weight: Array,
               inverse: Array) -> Shape:
        """Return what was fitted, with its covariance."""
        x = self._place(track.distance, p)
        freedom = max(len(x) - 6, 1)
        excess = max(1.0, float(weight @ residual**2) / freedom)
        # slip that grows linearly adds this to the model, per unit of ``Shape.drift``
        unit, _, by_sliding = self._stretch(x, p[5])
        growth = p[4] * (unit + p[5] * by_sliding) * (x - self._lead) / self._patch
        drift = inverse @ (jacobian.T @ (weight * growth))
        chosen = [0, 4, 5]
        return Shape(float(p[0]), float(p[4]), float(p[5]), float(p[3]),
                     excess * inverse[np.ix_(chosen, chosen)], drift[chosen],
                     self._coverage(x), math.sqrt(float(np.mean(residual**2))))

    def _coverage(self, x: Array) -> float:
        steps = np.diff(np.sort(x))
        # a lost batch is one long step
        seen = float(np.sum(np.minimum(steps, 2.5 * np.median(steps))))
        return min(seen / (self._patch + ENTRY * self._film.length), 1.0)

    def _weights(self, residual: Array, warp: Array) -> Array:
        """Return 1 / variance, less for outliers (Huber); ``warp`` [V] is that of the travel."""
        variance = self._variance + warp**2
        spread = 1.4826 * float(np.sort(np.abs(residual))[len(residual) // 2])
        size = np.abs(residual) / (OUTLIER * np.maximum(np.sqrt(variance), spread))
        weights: Array = 1.0 / (variance * np.maximum(size, 1.0))
        return weights

    def _place(self, distance: Array, p: Array) -> Array:
        return (distance - p[0]) * (1.0 + p[1]) + self._lead

    def _linearised(self, track: _Track, p: Array) -> tuple[Array, Array]:
        """Return the Jacobian (n, 6) and what the model leaves at parameters ``p``."""
        x = self._place(track.distance, p)
        h = SLOPE_STEP
        b, b_up, b_down = self._bending(np.stack([x, x + h, x - h]))
        s, s_x, s_w = self._stretch(x, p[5])
        slope = p[3] * (b_up - b_down) / (2.0 * h) + p[4] * s_x
        jacobian = np.stack([-slope * (1.0 + p[1]), slope * (track.distance - p[0]),
                             np.ones_like(x), b, s, p[4] * s_w], axis=1)
        return jacobian, track.volts - p[2] - p[3] * b - p[4] * s

    def _model(self, distance: Array, p: Array) -> Array:
        x = self._place(distance, p)
        stretch = tread_film.stretch_integral(
            x, p[5], p[5], 1.0, self._film.length, self._patch) / p[5]
        volts: Array = p[2] + p[3] * self._bending(x) + p[4] * stretch
        return volts

    def _bending(self, x: Array) -> Array:
        return tread_film.bending_passage(
            x, self._film.length, self._patch, self._film.bending_alpha, self._film.release)

    def _stretch(self, x: Array, sliding: float) -> tuple[Array, Array, Array]:
        """Return the stretch integral [m] per unit slip, and its slopes by x and sliding."""
        h, step = SLOPE_STEP, SLIDING_STEP * sliding
        w = np.array([sliding, sliding, sliding, sliding + step, sliding - step])[:, np.newaxis]
        places = np.stack([x, x + h, x - h, x, x])
        s, up, down, more, less = tread_film.stretch_integral(
            places, w, w, 1.0, self._film.length, self._patch) / w
        return s, (up - down) / (2.0 * h), (more - less) / (2.0 * step)
