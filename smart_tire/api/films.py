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

"""Buckled film as a sensor, paper A: charge from deflection and deflection from charge."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.estimation.film.film_file import FilmParams, read_params
from smart_tire.estimation.film.measure import FilmMeasurement, measure
from smart_tire.models.film.buckling_film import BucklingFilm, FILMS
from smart_tire.models.film.hysteresis import respond, TABLE_I, TABLE_I_GAIN

__all__ = ['BucklingFilm', 'FilmMeasurement', 'FilmParams', 'FilmSensor']


def table_i() -> FilmParams:
    """Return the film of Table I of paper A, with exact parameters."""
    return FilmParams(
        film=FILMS['25x3'], alpha_gain=TABLE_I.alpha * TABLE_I_GAIN,
        a_gain=TABLE_I.a * TABLE_I_GAIN, b_gain=TABLE_I.b * TABLE_I_GAIN, low_corner=0.0,
        drift=0.0, covariance=np.zeros((5, 5)), span=1.0, noise=0.0, model_error=0.0)


@dataclass(frozen=True, kw_only=True)
class FilmSensor:
    """
    Film with hysteresis, by default that of Table I of paper A; ``load`` reads a calibrated one.

    >>> sensor = FilmSensor()
    >>> print(sensor.charge([0.001, 0.002, 0.001]))
    [-2.05758178e-10 -4.37315277e-10 -2.58238810e-10]
    """

    params: FilmParams = field(default_factory=table_i)

    @classmethod
    def load(cls, path: str | Path) -> FilmSensor:
        """Return the film in a file of ``smart_tire identify film``; raise ParameterError."""
        return cls(params=read_params(Path(path)))

    def charge(self, deflection: ArrayLike) -> Array:
        """
        Return the charge [C] (n,) for the deflections [m] (n,) of a fresh film, in sequence.

        Raises ParameterError for deflections out of range, or if the film has no geometry.
        """
        if self.params.film is None:
            raise ParameterError('this film was calibrated without its geometry: its deflection '
                                 'is unknown')
        return respond(self.params.film.normalized_charge(deflection), self.params.operator)

    def measure(self, time: ArrayLike, charge: ArrayLike, *, used: bool = False
                ) -> FilmMeasurement:
        """
        Return the deflections ``value`` and ``sigma`` (n,) [m] for a charge (n,) [C].

        ``time`` (n,) [s] increases. The film is flat and at rest at first; ``used`` if it was
        moved before, so that its state of hysteresis is unknown. NaN with an infinite sigma where
        the deflection is not observable. Raises ParameterError for invalid arguments.
        """
        return measure(np.asarray(time, dtype=float), np.asarray(charge, dtype=float),
                       self.params, used=used)
