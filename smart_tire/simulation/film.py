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
Simulated film with its charge amplifier, and the test stand of paper A (III-A).

A stage moves one clamp of the film, and a charge amplifier band-limits the charge to the range
between its two corner frequencies. On the test stand a laser measures the deflection, too. The
film of the node ``film_simulator`` rests flat, moves ``MOTION`` s, and so on, while its
temperature changes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
import math

import numpy as np
from smart_tire.arrays import Array, ArrayLike
from smart_tire.models.film.buckling_film import BucklingFilm, FILMS
from smart_tire.models.film.hysteresis import DuhemParams, respond, TABLE_I, TABLE_I_GAIN
from smart_tire.parameters.film import FilmSimulatorParams
from smart_tire.protocol.film_charge import encode_charge, encode_frame
from smart_tire.samples import FilmCharge, NS_PER_S

OVERSAMPLING = 8         # steps of the amplifier per sample
BLOCK = 50               # samples that are simulated at once
MOTION = 10.0            # s between two rests, and between two steps of the temperature
HEATING_TIME = 2.0       # s, time constant of a step of the temperature
START_TEMPERATURE = 20.0  # degree Celsius


class AmplifierState:
    """State of film and amplifier: flat and without charge at first."""

    def __init__(self) -> None:
        self.operator = (0.0, 0.0)  # input and output [C]
        self.fast = self.slow = np.zeros(1)  # of the filters


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

    @classmethod
    def of(cls, film: BucklingFilm, rate: float = 1000.0) -> FilmTestStand:
        """
        Return the test stand with another film than that of Table I.

        K is scaled with the geometry as in A(15), and the loop has the same shape at the same
        stroke (alpha K is kept). Both are assumptions.
        """
        share = film.gain / FILMS['25x3'].gain
        return cls(film=film, gain=share * TABLE_I_GAIN, rate=rate,
                   hysteresis=replace(TABLE_I, alpha=TABLE_I.alpha / share),
                   charge_noise=share * cls.charge_noise, full_scale=share * cls.full_scale)

    def charge(self, deflection: Array, model: str = 'exact') -> Array:
        """Return Q_en [C] at ``deflection`` [m], before hysteresis."""
        charge: Array = self.gain * self.film.normalized_charge(deflection, model)
        return charge

    def amplified(self, deflection: Array, state: AmplifierState,
                  heat: Array | float = 0.0) -> Array:
        """
        Return the output [C] at ``deflection`` [m] (n,), ``OVERSAMPLING`` for each sample.

        ``heat`` [C], also (n,), is the charge by heat; ``state`` is moved on.
        """
        from scipy.signal import lfilter  # nodes start without
        charge = self.charge(deflection)
        source = respond(charge, self.hysteresis, start=state.operator)
        state.operator = float(charge[-1]), float(source[-1])
        step = 2.0 * math.pi / (OVERSAMPLING * self.rate)
        fast, slow = (-math.expm1(-corner * step) for corner in (self.high_corner,
                                                                 self.low_corner))
        passed, state.fast = lfilter([fast], [1.0, fast - 1.0], source + heat, zi=state.fast)
        # charge drained through the feedback resistor since the start
        drained, state.slow = lfilter([0.0, slow], [1.0, slow - 1.0], passed, zi=state.slow)
        amplified: Array = passed - drained
        return amplified

    def converted(self, charge: ArrayLike) -> Array:
        """Return charges [C] in steps of the converter, within its range."""
        lsb = 2.0 * self.full_scale / 2**self.bits
        return np.clip(np.round(np.divide(charge, lsb)) * lsb, -self.full_scale,
                       self.full_scale - lsb)


@dataclass(frozen=True)
class FilmInstant:
    """A sample of the simulated film, ``time_ns`` after its start."""

    time_ns: int
    deflection: float   # m
    temperature: float  # degree Celsius
    charge: FilmCharge  # of the amplifier, stamped with time_ns
    frame: bytes        # '' if it is lost


class SimulatedFilm:
    """A film in motion; ``next_instant`` advances it by one sample."""

    def __init__(self, params: FilmSimulatorParams) -> None:
        film = replace(FILMS['25x3'], length=params.length)
        self.stand = FilmTestStand.of(film, params.rate)
        self._params, self._rng = params, np.random.default_rng(params.seed)
        self._pyro = params.pyroelectric_coefficient * film.length * film.width
        self._limits = self.stand.converted([-math.inf, math.inf])
        self._index, self._state = 0, AmplifierState()

    def deflection(self, time: Array) -> Array:
        """Return the deflection [m] at ``time`` [s]; arrays."""
        rest, frequency = self._params.rest, self._params.frequency
        if not (cycles := round(MOTION * frequency)):
            return np.zeros_like(time)
        phase = np.maximum(time % (rest + cycles / frequency) - rest, 0.0)
        return 0.5 * self._params.stroke * (1.0 - np.cos(2.0 * math.pi * frequency * phase))

    def temperature(self, time: float) -> float:
        """Return the temperature [degree Celsius] at ``time`` [s]: steps up and down."""
        step, since = divmod(time, MOTION)
        up, decay = step % 2.0, math.exp(-since / HEATING_TIME)
        share = up + (1.0 - 2.0 * up) * decay if step else 0.0
        return START_TEMPERATURE + self._params.warming * share

    def next_instant(self) -> FilmInstant:
        """Return the next sample."""
        if self._index % BLOCK == 0:
            self._block = self._next_block()
        deflection, output = next(self._block)
        time = self._index / self._params.rate
        value = float(self.stand.converted(
            output + self.stand.charge_noise * self._rng.standard_normal()))
        time_ns = round(time * NS_PER_S)
        charge = FilmCharge(time_ns, value, value in self._limits)
        lost = self._rng.random() < self._params.loss
        self._index += 1
        return FilmInstant(time_ns, deflection, self.temperature(time), charge,
                           b'' if lost else encode_frame(encode_charge(time_ns, charge)))

    def _next_block(self) -> Iterator[tuple[float, float]]:
        """Return deflection [m] and output [C] of the next samples."""
        times = np.arange(self._index, self._index + BLOCK) / self._params.rate
        steps = np.arange(1 - OVERSAMPLING, 1) / OVERSAMPLING / self._params.rate
        path = self.deflection(np.maximum(times[:, None] + steps, 0.0))
        heat = self._pyro * (np.array([*map(self.temperature, times)]) - START_TEMPERATURE)
        output = self.stand.amplified(
            path.ravel(), self._state, np.repeat(heat, OVERSAMPLING)).reshape(path.shape)
        return zip(path[:, -1].tolist(), output[:, -1].tolist())
