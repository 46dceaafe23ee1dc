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

"""Signal chain of a film: charge, amplifier, rest voltage, counts of the A/D converter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models import validation

Counts = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
AMPLIFIER_GAIN = 0.5e9  # V/C, 0.5 mV/pC: paper B, IV
MAX_BITS = 32


@dataclass(frozen=True, kw_only=True)
class SignalChain:
    """
    Amplifier and A/D converter of one film, as in paper B, IV.

    A count is ``voltage_range / (2^bits - 1)`` wide, as in the radio payload. All methods take and
    return arrays of any shape and raise ParameterError for values that are not finite or out of
    range.

    >>> chain = SignalChain()
    >>> volts = chain.amplified([1e-9, 4e-9])
    >>> print(volts, chain.counts(volts), chain.saturated(chain.counts(volts)))
    [0.5 2. ] [ 666 1023] [False  True]
    """

    bits: int = 10
    voltage_range: float = 3.3   # V, at the highest count
    rest_voltage: float = 1.65   # V, output without charge
    amplifier: float = AMPLIFIER_GAIN  # V/C

    def __post_init__(self) -> None:
        if isinstance(self.bits, bool) or not isinstance(self.bits, int) or not (
                1 <= self.bits <= MAX_BITS):
            raise ParameterError(f'bits is {self.bits!r}, expected a whole number of 1 to '
                                 f'{MAX_BITS}')
        validation.positive('voltage_range', self.voltage_range)
        validation.within('rest_voltage', self.rest_voltage, 0.0, self.voltage_range,
                          f'expected 0 to the range of {self.voltage_range} V')
        if validation.finite('amplifier', self.amplifier) == 0.0:
            raise ParameterError('amplifier is 0, expected a number that is not zero')

    @property
    def max_count(self) -> int:
        """Largest count."""
        return (1 << self.bits) - 1

    @property
    def step(self) -> float:
        """Width [V] of one count."""
        return self.voltage_range / self.max_count

    def amplified(self, charge: ArrayLike) -> Array:
        """Return the output of the amplifier above rest [V] for a charge [C]."""
        volts: Array = self.amplifier * validation.finite('charge', charge)
        return volts

    def counts(self, volts: ArrayLike) -> Counts:
        """Return the counts for an output ``volts`` [V] above rest, clipped to the range."""
        output = self.rest_voltage + validation.finite('volts', volts)
        scale = self.max_count / self.voltage_range
        return np.clip(np.rint(output * scale), 0, self.max_count).astype(np.int64)

    def volts(self, counts: ArrayLike) -> Array:
        """Return the output above rest [V] at the center of a count."""
        above: Array = self._checked(counts) * self.step - self.rest_voltage
        return above

    def saturated(self, counts: ArrayLike) -> Flags:
        """Return which counts are at an end of the range, where the output may be clipped."""
        array = self._checked(counts)
        flags: Flags = (array == 0.0) | (array == self.max_count)
        return flags

    def _checked(self, counts: ArrayLike) -> Array:
        array = validation.within('counts', counts, 0.0, float(self.max_count),
                                  f'expected 0 to {self.max_count}')
        if (broken := array != np.rint(array)).any():
            raise ParameterError(f'counts holds {array[broken].flat[0]}, expected whole numbers')
        return array
