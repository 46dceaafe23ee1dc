"""From the film's charge to the converter's counts: amplifier, resting voltage, 10 bits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models import validation

Counts = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
AMPLIFIER = 0.5e9  # V/C, 0.5 mV/pC: paper B, IV
MOST_BITS = 32


@dataclass(frozen=True, kw_only=True)
class SignalChain:
    """
    Amplifier and converter of one film, as in paper B, IV.

    A count is ``voltage_range / (2^bits - 1)`` wide, as the radio's payload has it.
    """

    bits: int = 10
    voltage_range: float = 3.3   # V, at the highest count
    rest_voltage: float = 1.65   # V, of a film without charge
    amplifier: float = AMPLIFIER  # V/C

    def __post_init__(self) -> None:
        if isinstance(self.bits, bool) or not isinstance(self.bits, int) or not (
                1 <= self.bits <= MOST_BITS):
            raise ParameterError(f'bits is {self.bits!r}, expected a whole number of 1 to '
                                 f'{MOST_BITS}')
        validation.positive('voltage_range', self.voltage_range)
        validation.within('rest_voltage', self.rest_voltage, 0.0, self.voltage_range,
                       f'expected 0 to the range of {self.voltage_range} V')
        if validation.finite('amplifier', self.amplifier) == 0.0:
            raise ParameterError('amplifier is 0, expected a number that is not zero')

    @property
    def highest(self) -> int:
        """Return the highest count."""
        return (1 << self.bits) - 1

    @property
    def step(self) -> float:
        """Return the width [V] of one count."""
        return self.voltage_range / self.highest

    def amplified(self, charge: ArrayLike) -> Array:
        """Return the amplifier's output above rest [V] for a charge [C]."""
        volts: Array = self.amplifier * validation.finite('charge', charge)
        return volts

    def counts(self, volts: ArrayLike) -> Counts:
        """Return the counts for an output ``volts`` above rest; clipped to the range."""
        output = self.rest_voltage + validation.finite('volts', volts)
        scale = self.highest / self.voltage_range
        return np.clip(np.rint(output * scale), 0, self.highest).astype(np.int64)

    def volts(self, counts: ArrayLike) -> Array:
        """Return the output above rest [V] in the middle of a count."""
        above: Array = self._checked(counts) * self.step - self.rest_voltage
        return above

    def saturated(self, counts: ArrayLike) -> Flags:
        """Return which counts are at an end of the range, where the output may lie beyond."""
        array = self._checked(counts)
        flags: Flags = (array == 0.0) | (array == self.highest)
        return flags

    def _checked(self, counts: ArrayLike) -> Array:
        array = validation.within('counts', counts, 0.0, float(self.highest),
                               f'expected 0 to {self.highest}')
        if (broken := array != np.rint(array)).any():
            raise ParameterError(f'counts holds {array[broken].flat[0]}, expected whole numbers')
        return array
