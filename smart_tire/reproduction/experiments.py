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

"""Interface of the experiments behind the figures; the caller provides them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from smart_tire.arrays import Array
from smart_tire.estimation.film.files import FilmRecording
from smart_tire.models.film.buckling_film import BucklingFilm, FILMS
from smart_tire.models.film.hysteresis import DuhemParams, TABLE_I, TABLE_I_GAIN
from smart_tire.parameters import SimulatorParams
from smart_tire.samples import Sample

Leg = tuple[float, float, float]  # s, rpm, rpm: time from which, left, right
Schedule = Callable[[float], tuple[float, float]] | Sequence[Leg]
Event = tuple[int, str, Sample]  # receive time [ns], topic, sample


@dataclass(frozen=True)
class Specimen:
    """A film on the test stand, with its parameters as a sensor."""

    film: BucklingFilm
    gain: float  # C, K
    hysteresis: DuhemParams

    def charge(self, deflection: Array, model: str = 'exact') -> Array:
        """Return Q_en [C] at ``deflection`` [m], before hysteresis."""
        charge: Array = self.gain * self.film.normalized_charge(deflection, model)
        return charge


# specimen, deflection [m] (n,), rate [Hz], seed -> recording
Bench = Callable[[Specimen, Array, float, int], FilmRecording]
# parameters, wheel speeds, duration [s] -> events in the order of reception
Drive = Callable[[SimulatorParams, Schedule, float], Iterable[Event]]


@dataclass(frozen=True)
class Laboratory:
    """A test stand for films and a robot to drive."""

    bench: Bench
    drive: Drive


def specimen(name: str) -> Specimen:
    """
    Return one of paper A's films by its key in FILMS.

    Table I is for one film. For the others K is scaled with the geometry as in A(15), and the loop
    has the same shape at the same stroke (alpha K is kept). Both are assumptions.
    """
    film = FILMS[name]
    gain = TABLE_I_GAIN * film.gain / FILMS['25x3'].gain
    alpha = TABLE_I.alpha * TABLE_I_GAIN / gain
    return Specimen(film, gain, DuhemParams(alpha=alpha, a=TABLE_I.a, b=TABLE_I.b))
