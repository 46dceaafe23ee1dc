# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Films of the simulated robot: in the tread of a wheel, with amplifiers and A/D converter."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.models.tire import brush_tire, tread_film
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.samples import NS_PER_S, WHEELS
from smart_tire.simulation.device_emulators import SensorNodeEmulator
from smart_tire.simulation.plant import Plant

VARIATION_PERIOD = 1021       # revolutions after which the variation of the films repeats
TAIL_RECOVERY_LENGTHS = 12.0  # recovery lengths after which the release signal is below 10 uV
# of bumps, by shape: inner and outer half width at half height over the full width at half height
BUMP_HALF_WIDTHS = {'raised_cosine': (0.5, 0.5), 'gaussian': (0.5, 0.5),
                    'asymmetric': (0.3, 0.7), 'exponential': (0.25, 0.75)}
NEGLIGIBLE_BUMP = 1e-5        # height at the end of shapes that do not vanish


@dataclass(frozen=True, slots=True)
class SignalChain:
    """
    Rest voltage and A/D converter of the films, as in paper B, IV.

    >>> chain = SignalChain(FilmParams())
    >>> counts = chain.counts(np.array([0.5, 2.0]))
    >>> print(counts, chain.max_count, chain.volts(counts).round(3))
    [ 666 1023] 1023 [0.498 1.65 ]
    """

    film: TreadFilmParams

    @property
    def max_count(self) -> int:
        """Largest count, that of ``voltage_range``."""
        return (1 << self.film.bits) - 1

    def counts(self, volts: Array) -> npt.NDArray[np.int64]:
        """Return the counts for an output ``volts`` [V] above rest, clipped to the range."""
        scale = self.max_count / self.film.voltage_range
        return np.clip(np.rint((self.film.rest_voltage + volts) * scale), 0,
                       self.max_count).astype(np.int64)

    def volts(self, counts: npt.NDArray[np.int64]) -> Array:
        """Return the output above rest [V] at the center of a count."""
        step = self.film.voltage_range / self.max_count
        return np.asarray(counts * step - self.film.rest_voltage)


def bump(offset: ArrayLike, width: ArrayLike, shape: str = 'raised_cosine') -> Array:
    """
    Return a bump of height 1 at ``offset`` [m], the distance beyond its center from the patch.

    ``width`` [m] is the full width at half height. ``shape`` is ``raised_cosine``, ``gaussian``,
    ``asymmetric`` (raised cosines, wider on the side away from the patch) or ``exponential`` (a
    raised cosine that decays exponentially away from the patch). Arguments broadcast.

    >>> print(bump([-0.010, -0.004, 0.0, 0.006], 0.009, 'gaussian').round(3))
    [0.033 0.578 1.    0.292]
    """
    inner, outer = BUMP_HALF_WIDTHS[shape]
    offset = np.asarray(offset, dtype=float)
    whole = 2.0 * np.where(offset < 0.0, inner, outer) * np.asarray(width, dtype=float)
    if shape == 'gaussian':
        return np.asarray(np.exp(-4.0 * math.log(2.0) * (offset / whole)**2))
    scale = math.pi / whole
    value: Array = 0.5 + 0.5 * np.cos(np.minimum(np.maximum(scale * offset, -math.pi), math.pi))
    if shape == 'exponential':
        decay = np.exp(-2.0 * math.log(2.0) * np.maximum(offset, 0.0) / whole)
        value = np.where(offset > 0.0, decay, value)
    return value


def bump_extent(distance: float, width: float, shape: str = 'raised_cosine') -> float:
    """
    Return the distance [m] from the patch beyond which a bump is negligible.

    >>> print(f'{bump_extent(0.010, 0.009):.3f} m')
    0.019 m
    """
    outer = BUMP_HALF_WIDTHS[shape][1] * width
    if shape == 'gaussian':
        return distance + outer * math.sqrt(-math.log2(NEGLIGIBLE_BUMP))
    if shape == 'exponential':
        return distance - outer * math.log2(NEGLIGIBLE_BUMP)
    return distance + 2.0 * outer


@dataclass(frozen=True, slots=True)
class WheelTrace:
    """Motion and contact of one wheel at n instants; the arrays have shape (n,)."""

    stamps_ns: tuple[int, ...]  # since the start of the plant
    angle: Array                # rad
    rolling_speed: Array        # m/s, r w
    v_x: Array                  # m/s, of the wheel center
    v_y: Array                  # m/s
    load: Array                 # N
    friction: Array             # -, mu of the surface
    stiffness: Array            # N, C_x on the surface
    slip_floor: float           # m/s, minimum denominator of the slip in the plant

    def slip_vector(self) -> tuple[Array, Array]:
        """Return the slip (s_x, s_y) [-] of the tire as in the plant."""
        return brush_tire.slip_vector(self.rolling_speed, self.v_x, self.v_y,
                                      floor=self.slip_floor)


@dataclass(frozen=True, slots=True)
class FilmBatch:
    """One batch of conversions of a sensor node."""

    wheel: str
    first: int                          # index of the first conversion
    codes: tuple[tuple[int, ...], ...]  # samples x films
    trace: WheelTrace                   # true instants and wheel states of the conversions


def patch_position(angle: Array, center_angle: npt.ArrayLike, radius: float,
                   ) -> tuple[Array, Array]:
    """
    Return the distance [m] of a film past the patch center, and the revolution.

    ``center_angle`` is the wheel angle [rad] at which the film is at the patch center; revolutions
    start half a circumference before it.
    """
    revolutions = (angle - np.asarray(center_angle)) / math.tau
    revolution = np.floor(revolutions + 0.5)
    past: Array = math.tau * radius * (revolutions - revolution)
    return past, revolution


class FilmSampler:
    """Samples the films of one wheel at the times of its sensor node; returns full batches."""

    def __init__(self, wheel: str, node: SensorNodeEmulator, params: SimulatorParams,
                 rng: np.random.Generator) -> None:
        self.wheel = wheel
        self._node, self._robot, self._rng = node, params.robot, rng
        self._index = WHEELS.index(wheel)
        film = params.robot.film
        self._chain = SignalChain(film)
        first_angle = rng.uniform(0.0, math.tau)
        # rad, wheel angles at which films 1, 2, ... are at the patch center
        self.center_angles = tuple(
            first_angle + (position - film.centers[0]) / params.robot.wheel_radius
            for position in film.centers)
        self._films = _Films(wheel, params, self.center_angles, rng)
        self._batch = params.radio.batch
        self._count = 0
        self._rows: list[tuple[float, ...]] = []
        self._stamps: list[int] = []
        self.due_ns = node.instant_ns(0)  # time of the next conversion

    @property
    def full_ns(self) -> int:
        """Return the time of the last conversion of the present batch."""
        return self._node.instant_ns(self._count - len(self._rows) + self._batch - 1)

    def observe(self, plant: Plant) -> list[FilmBatch]:
        """Sample up to the time of the plant; return the completed batches."""
        batches = []
        while self.due_ns <= plant.time_ns:
            self._rows.append(self._sample(plant))
            self._stamps.append(self.due_ns)
            self._count += 1
            self.due_ns = self._node.instant_ns(self._count)
            if len(self._rows) == self._batch:
                batches.append(self._close(plant.slip_floor))
        return batches

    def _sample(self, plant: Plant) -> tuple[float, ...]:
        i = self._index
        speed, surface = plant.wheel_speed[i], plant.surface[i]
        age = (plant.time_ns - self.due_ns) / NS_PER_S  # s since the conversion
        return (plant.wheel_angle[i] - age * speed, self._robot.wheel_radius * speed,
                plant.wheel_v_x[i], plant.wheel_v_y[i], plant.load[i],
                surface.friction, surface.stiffness)

    def _close(self, slip_floor: float) -> FilmBatch:
        angle, rolling, v_x, v_y, load, friction, stiffness = np.array(self._rows).T
        trace = WheelTrace(tuple(self._stamps), angle, rolling, v_x, v_y, load, friction,
                           stiffness, slip_floor)
        self._rows.clear()
        self._stamps.clear()
        codes = self._convert(self._films.volts(trace))
        return FilmBatch(self.wheel, self._count - len(codes), codes, trace)

    def _convert(self, volts: Array) -> tuple[tuple[int, ...], ...]:
        noise = self._robot.film.noise * self._rng.standard_normal(volts.shape)
        return tuple(tuple(row) for row in self._chain.counts(volts + noise).T.tolist())


class _Films:
    """Films of one wheel: voltage relative to the baseline, with cycle-to-cycle variation."""

    def __init__(self, wheel: str, params: SimulatorParams, center_angles: tuple[float, ...],
                 rng: np.random.Generator) -> None:
        self._robot, film, tire = params.robot, params.robot.film, params.robot.tire
        self._center_angles = np.array(center_angles)[:, np.newaxis]
        self._gain = np.array(film.gains(wheel))[:, np.newaxis]
        spread, shape = params.errors.bending_variation, (len(center_angles), VARIATION_PERIOD)
        self._peaks = (np.array(film.bending(wheel))[:, np.newaxis]
                       * (1.0 + rng.uniform(-spread, spread, shape)))
        low, high = params.errors.bumps
        self._bumps = rng.uniform(low, high, (2, *shape))  # before and after the patch
        self._errors = params.errors
        self._half_crossing = 0.5 * (tire.contact_length + film.length)
        self._reach = self._half_crossing + max(
            TAIL_RECOVERY_LENGTHS * tread_film.RECOVERY * film.length,
            *(bump_extent(distance, width, params.errors.bump_shape) for distance, width
              in zip(params.errors.bump_distance, params.errors.bump_width)))
        self._reverse = np.zeros((len(center_angles), 1), dtype=bool)

    def volts(self, trace: WheelTrace) -> Array:
        """Return the outputs relative to the baseline [V], shape (films, n)."""
        past, revolution = patch_position(
            trace.angle, self._center_angles, self._robot.wheel_radius)
        near = np.abs(past) < self._reach
        reverse = self._direction(near, trace.rolling_speed < 0.0)
        if not near.any():
            return np.zeros(near.shape)
        film, length = self._robot.film, self._robot.tire.contact_length
        index = revolution.astype(int) % VARIATION_PERIOD
        peak = np.take_along_axis(self._peaks, index, axis=1)
        x = past + 0.5 * (length - film.length)
        s_x, s_y = trace.slip_vector()

        def voltage(release: str) -> Array:
            return tread_film.crossing_voltage(
                x, slip=np.sign(trace.rolling_speed) * s_x, total_slip=np.hypot(s_x, s_y),
                critical_slip=brush_tire.critical_slip(
                    trace.friction, trace.load, trace.stiffness),
                film_length=film.length, contact_length=length, bending_peak=peak,
                bending_alpha=film.bending_alpha, stretch_gain=self._gain, release=release,
                reverse=reverse)

        crossing, share = voltage(film.release), self._errors.release_share
        if share > 0.0:
            other = voltage('state' if film.release == 'fig8' else 'fig8')
            crossing = (1.0 - share) * crossing + share * other
        before, after = (np.take_along_axis(bumps, index, axis=1) for bumps in self._bumps)
        bumps = np.where(past < 0.0, before, after) * self._bump(x, reverse)
        return np.where(near, crossing - peak * bumps, 0.0)

    def _bump(self, x: Array, reverse: npt.NDArray[np.bool_]) -> Array:
        """Return the bumps of height 1; in reverse, the first one is that beyond the patch."""
        errors, robot = self._errors, self._robot
        past = x - 0.5 * (robot.tire.contact_length - robot.film.length)
        before = (past < 0.0) != reverse
        distance, width = (np.where(before, *values)
                           for values in (errors.bump_distance, errors.bump_width))
        return bump(np.abs(past) - (self._half_crossing + distance), width,
                    errors.bump_shape)

    def _direction(self, near: npt.NDArray[np.bool_],
                   backward: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """
        Return whether each film entered the patch rolling backward, shape (films, n).

        The direction is that of the latest motion outside the patch: a film that stops inside and
        rolls back out retraces its signal instead of switching to that of the other direction.
        """
        away = np.where(near, -1, np.arange(near.shape[1]))
        last = np.maximum.accumulate(away, axis=1)
        reverse = np.where(last >= 0, backward[last], self._reverse)
        self._reverse = reverse[:, -1:]
        return reverse
