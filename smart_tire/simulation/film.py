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
Simulated film with its charge amplifier: motion, heat and hysteresis to frames of the device.

It rests flat, moves ``MOTION`` s, and so on. Its operator is that of paper A, Table I, with K and
alpha scaled to its length; the instrument errors are those of the test stand of the paper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.models.film.hysteresis import respond, TABLE_I, TABLE_I_GAIN
from smart_tire.parameters.film import FilmSimulatorParams
from smart_tire.protocol.film_charge import encode_charge, encode_frame
from smart_tire.samples import FilmCharge, NS_PER_S

MOTION = 10.0            # s between two rests, and between two steps of the temperature
HEATING_TIME = 2.0       # s, time constant of a step of the temperature
START_TEMPERATURE = 20.0  # degree Celsius
LOW_CORNER = 1e-3        # Hz, of the amplifier
NOISE_SHARE = 0.02 / 34.47  # of K, standard deviation of a sample; Table I, assumed noise
RANGE_SHARE = 50.0 / 34.47  # of K, limit of the converter
SUBSTEPS = np.linspace(-0.75, 0.0, 4)  # samples, of the deflection before each of the charge


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
        reference = FILMS['25x3']
        self.film = replace(reference, length=params.length)
        self.gain = TABLE_I_GAIN * self.film.gain / reference.gain  # C
        self.operator = replace(TABLE_I, alpha=TABLE_I.alpha * TABLE_I_GAIN / self.gain)
        self._params, self._rng = params, np.random.default_rng(params.seed)
        self._pyro = params.pyroelectric_coefficient * params.length * reference.width
        self._index = 0
        self._state = (0.0, 0.0)  # input and output [C] of the operator
        self._source = self._output = 0.0  # C, of film and amplifier

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
        rate = self._params.rate
        path = self.deflection(np.maximum(self._index + SUBSTEPS, 0.0) / rate)
        time = self._index / rate
        inputs = self.gain * self.film.normalized_charge(path)
        output = float(respond(inputs, self.operator, start=self._state)[-1])
        self._state = (float(inputs[-1]), output)
        temperature = self.temperature(time)
        source = output + self._pyro * (temperature - START_TEMPERATURE)
        self._output = self._output * math.exp(
            -2.0 * math.pi * LOW_CORNER / rate) + source - self._source
        self._source = source
        limit = RANGE_SHARE * self.gain
        measured = self._output + NOISE_SHARE * self.gain * self._rng.standard_normal()
        time_ns = round(time * NS_PER_S)
        charge = FilmCharge(time_ns, min(max(measured, -limit), limit), abs(measured) >= limit)
        lost = self._rng.random() < self._params.loss
        self._index += 1
        return FilmInstant(time_ns, float(path[-1]), temperature, charge,
                           b'' if lost else encode_frame(encode_charge(time_ns, charge)))
