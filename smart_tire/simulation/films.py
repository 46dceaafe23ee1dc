"""Films of the simulated robot: in the tread of a wheel, with amplifiers and converter."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array
from smart_tire.models.film.signal_chain import SignalChain
from smart_tire.models.tire import brush_tire, tread_film
from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.samples import NS_PER_S, WHEELS
from smart_tire.simulation.device_emulators import SensorNodeEmulator
from smart_tire.simulation.plant import Plant


CYCLES = 1021  # turns of a wheel after which the variation from cycle to cycle repeats
TAIL = 12.0    # lengths of recovery after which the release has died away, to microvolts


@dataclass(frozen=True, slots=True)
class Trace:
    """What one wheel did at some instants; the arrays have shape (n,)."""

    stamps_ns: tuple[int, ...]  # since the start of the plant
    angle: Array                # rad
    rolling_speed: Array        # m/s, r w
    v_x: Array                  # m/s, of the wheel's centre
    v_y: Array                  # m/s
    load: Array                 # N
    friction: Array             # -, mu of the ground there
    stiffness: Array            # N, C_x there
    slip_floor: float           # m/s, of the plant

    def slip_vector(self) -> tuple[Array, Array]:
        """Return the slip (s_x, s_y) [-] that the plant's tire felt."""
        return brush_tire.slip_vector(self.rolling_speed, self.v_x, self.v_y,
                                      floor=self.slip_floor)


@dataclass(frozen=True, slots=True)
class FilmBatch:
    """One batch of conversions of a wheel unit."""

    wheel: str
    first: int                          # conversions of the unit before the batch
    codes: tuple[tuple[int, ...], ...]  # samples x films
    trace: Trace                        # the true instants, and what made the codes


def locate(angle: Array, place: npt.ArrayLike, radius: float) -> tuple[Array, Array]:
    """
    Return how far [m] a place on the circumference is past the patch's middle, and its turn.

    ``place`` is the wheel angle [rad] at which it stands over the middle; half a circumference
    further on the next turn begins.
    """
    turns = (angle - np.asarray(place)) / math.tau
    cycle = np.floor(turns + 0.5)
    past: Array = math.tau * radius * (turns - cycle)
    return past, cycle


class FilmSampler:
    """Samples the films of one wheel when its unit does, and hands over full batches."""

    def __init__(self, wheel: str, unit: SensorNodeEmulator, params: SimulatorParams,
                 rng: np.random.Generator) -> None:
        self.wheel = wheel
        self._unit, self._robot, self._rng = unit, params.robot, rng
        self._index = WHEELS.index(wheel)
        film = params.robot.film
        self._chain = SignalChain(bits=film.bits, voltage_range=film.voltage_range,
                                  rest_voltage=film.rest_voltage)
        first_place = rng.uniform(0.0, math.tau)
        # rad, wheel angles at which films 1, 2, ... stand over the middle of the patch
        self.places = tuple(first_place + (place - film.places[0]) / params.robot.wheel_radius
                            for place in film.places)
        self._films = _Films(wheel, params, self.places, rng)
        self._batch = params.radio.batch
        self._count = 0
        self._rows: list[tuple[float, ...]] = []
        self._stamps: list[int] = []
        self.due_ns = unit.instant_ns(0)  # instant of the next conversion

    @property
    def full_ns(self) -> int:
        """Return the instant of the conversion that fills the present batch."""
        return self._unit.instant_ns(self._count - len(self._rows) + self._batch - 1)

    def observe(self, plant: Plant) -> list[FilmBatch]:
        """Sample what is due up to the plant's time; return the batches that are now full."""
        batches = []
        while self.due_ns <= plant.time_ns:
            self._rows.append(self._sample(plant))
            self._stamps.append(self.due_ns)
            self._count += 1
            self.due_ns = self._unit.instant_ns(self._count)
            if len(self._rows) == self._batch:
                batches.append(self._close(plant.slip_floor))
        return batches

    def _sample(self, plant: Plant) -> tuple[float, ...]:
        i = self._index
        speed, surface = plant.wheel_speed[i], plant.surface[i]
        back = (plant.time_ns - self.due_ns) / NS_PER_S  # s, since the conversion
        return (plant.wheel_angle[i] - back * speed, self._robot.wheel_radius * speed,
                plant.wheel_v_x[i], plant.wheel_v_y[i], plant.load[i],
                surface.friction, surface.stiffness)

    def _close(self, slip_floor: float) -> FilmBatch:
        angle, rolling, v_x, v_y, load, friction, stiffness = np.array(self._rows).T
        trace = Trace(tuple(self._stamps), angle, rolling, v_x, v_y, load, friction, stiffness,
                      slip_floor)
        self._rows.clear()
        self._stamps.clear()
        codes = self._convert(self._films.volts(trace))
        return FilmBatch(self.wheel, self._count - len(codes), codes, trace)

    def _convert(self, volts: Array) -> tuple[tuple[int, ...], ...]:
        noise = self._robot.film.noise * self._rng.standard_normal(volts.shape)
        return tuple(tuple(row) for row in self._chain.counts(volts + noise).T.tolist())


class _Films:
    """The films of one wheel: volts above rest, with what varies from cycle to cycle."""

    def __init__(self, wheel: str, params: SimulatorParams, places: tuple[float, ...],
                 rng: np.random.Generator) -> None:
        self._robot, film, tire = params.robot, params.robot.film, params.robot.tire
        self._places = np.array(places)[:, np.newaxis]
        self._gain = np.array(film.gains(wheel))[:, np.newaxis]
        spread = params.errors.bending_variation
        self._peaks = (np.array(film.bending(wheel))[:, np.newaxis]
                       * (1.0 + rng.uniform(-spread, spread, (len(places), CYCLES))))
        low, high = params.errors.bumps
        self._bumps = rng.uniform(low, high, (2, len(places), CYCLES))  # sides x films x cycles
        self._reach = 0.5 * (tire.contact_length + film.length) + TAIL * tread_film.RECOVERY
        self._reverse = np.zeros((len(places), 1), dtype=bool)

    def volts(self, trace: Trace) -> Array:
        """Return the outputs above rest [V], shape (films, n)."""
        past, cycle = locate(trace.angle, self._places, self._robot.wheel_radius)
        near = np.abs(past) < self._reach
        reverse = self._direction(near, trace.rolling_speed < 0.0)
        if not near.any():
            return np.zeros(near.shape)
        film, length = self._robot.film, self._robot.tire.contact_length
        turn = cycle.astype(int) % CYCLES
        peak = np.take_along_axis(self._peaks, turn, axis=1)
        x = past + 0.5 * (length - film.length)
        s_x, s_y = trace.slip_vector()
        passage = tread_film.passage(
            x, slip=np.sign(trace.rolling_speed) * s_x, total_slip=np.hypot(s_x, s_y),
            critical_slip=brush_tire.critical_slip(trace.friction, trace.load, trace.stiffness),
            film_length=film.length, contact_length=length, bending_peak=peak,
            bending_alpha=film.bending_alpha, stretch_gain=self._gain, release=film.release,
            reverse=reverse)
        before, after = (np.take_along_axis(bumps, turn, axis=1) for bumps in self._bumps)
        bumps = np.where(past < 0.0, before, after) * tread_film.contact_bumps(
            x, film.length, length)
        return np.where(near, passage - peak * bumps, 0.0)

    def _direction(self, near: npt.NDArray[np.bool_],
                   backward: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """
        Return whether each film came in reverse, shape (films, n).

        The direction counts with which it last moved away from the patch: a film that stops
        inside and rolls back out retraces its signal instead of jumping to the other one.
        """
        away = np.where(near, -1, np.arange(near.shape[1]))
        last = np.maximum.accumulate(away, axis=1)
        reverse = np.where(last >= 0, backward[last], self._reverse)
        self._reverse = reverse[:, -1:]
        return reverse
