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

"""Buffer for film samples until the wheel angle at their timestamps is known."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
import math

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.estimation.contact.stamp_regularizer import StampRegularizer
from smart_tire.samples import TireSample


class FilmSampleBuffer:
    """Buffers samples of ``films`` of one wheel, in the order of their timestamps."""

    def __init__(self, films: Sequence[int], period_ns: int) -> None:
        self._films = tuple(films)
        self._regularizer = StampRegularizer(period_ns)
        self._stamps: list[int] = []
        self._volts: list[tuple[float, ...]] = []

    def add(self, sample: TireSample) -> None:
        """Add one conversion of all films of the wheel; the last films may be absent."""
        self._stamps.append(sample.stamp_ns)
        self._volts.append(sample.volts)

    def clear(self) -> None:
        """Drop all samples."""
        del self._stamps[:], self._volts[:]

    def take(self, until_ns: int) -> tuple[Instants, Array]:
        """
        Remove and return the samples up to an instant.

        Regularized timestamps (n,) [ns] and volts (n, films), NaN where a film is absent.
        """
        count = bisect_right(self._stamps, until_ns)
        instants = self._regularizer.regularize(self._stamps[:count])
        volts = self._columns(self._volts[:count])
        del self._stamps[:count], self._volts[:count]
        return instants, volts

    def _columns(self, volts: list[tuple[float, ...]]) -> Array:
        films, lengths = max(self._films) + 1, set(map(len, volts))
        if len(lengths) != 1 or min(lengths) < films:
            volts = [(row + (math.nan,) * films)[:films] for row in volts]
        columns = len(volts[0]) if volts else films
        found: Array = np.array(volts).reshape(len(volts), columns)[:, self._films]
        return found
