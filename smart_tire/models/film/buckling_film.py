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
Buckled film as a sensor: geometry, material, and charge from deflection, paper A, section II.

A film of length 2 L is clamped at both ends and flat at deflection 0; ``deflection`` [m] is the
approach of its ends, the magnitude of the paper's Delta. The charge Q_en is that before
hysteresis, relative to the flat film, and negative: f (1 - delta) is below the Euler load.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.models import validation
from smart_tire.models.film import elastica, elastica_with_weight
from smart_tire.samples import GRAVITY

# stroke over deflection / L: A(8b) needs half of the end displacement for each half of the film,
# but delta = Delta / L is printed
STROKE_FACTOR = {'exact': 0.5, 'printed': 1.0}
# Q_en / K of a stroke delta, from the flat film: A(9), A(15) and A(16); and with weight
CHARGE_MODELS: dict[str, Callable[[Array], Array]] = {
    'exact': elastica.charge,
    'printed': lambda delta: -0.5 * delta * (1.0 + delta),
    'linear': lambda delta: -0.5 * delta}
WEIGHT_SIGNS = {'arched': 1.0, 'hanging': -1.0}
MODELS = (*CHARGE_MODELS, *WEIGHT_SIGNS)


@dataclass(frozen=True, kw_only=True)
class Material:
    """Film material: typical values of PVDF, assumed, since the paper gives no constants."""

    d31: float = 23e-12     # C/N
    c11: float = 3e9        # Pa, also Young's modulus E
    density: float = 1780.0  # kg/m3

    def __post_init__(self) -> None:
        for name in ('d31', 'c11', 'density'):
            validation.positive(name, getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class BucklingFilm:
    """
    Strip of film; ``convention`` names the normalization of its stroke, ``exact`` or ``printed``.

    Raises ParameterError unless all dimensions are positive.

    >>> film = FILMS['25x3']
    >>> print(f'{film.gain * 1e9:.3f} nC {film.stroke(0.0025):.3f} '
    ...       f'{film.normalized_charge(0.0025):.4f}')
    0.330 nC 0.100 -0.0523
    """

    length: float     # m, 2 L between the clamps
    width: float      # m, b
    thickness: float  # m, t_S
    material: Material = field(default_factory=Material)
    convention: str = 'exact'

    def __post_init__(self) -> None:
        for name in ('length', 'width', 'thickness'):
            validation.positive(name, getattr(self, name))
        validation.one_of('convention', self.convention, tuple(STROKE_FACTOR))

    @property
    def half_length(self) -> float:
        """Half length L [m]."""
        return 0.5 * self.length

    @property
    def second_moment(self) -> float:
        """Second moment of area I [m4]."""
        return self.width * self.thickness**3 / 12.0

    @property
    def weight(self) -> float:
        """Dimensionless weight w of A(6), weight over bending stiffness."""
        per_length = self.material.density * self.width * self.thickness * GRAVITY
        return per_length * self.half_length**3 / (self.material.c11 * self.second_moment)

    @property
    def gain(self) -> float:
        """Gain K [C] of A(15); the fitted one of Table I is a hundred times larger."""
        return (2.0 * math.pi**2 * self.material.d31 * self.material.c11 * self.second_moment
                / (self.half_length * self.thickness))

    def stroke(self, deflection: ArrayLike) -> Array:
        """Return the stroke delta [-]; ParameterError outside [0, 1), see ``elastica``."""
        factor = STROKE_FACTOR[self.convention] / self.half_length
        return elastica.checked_stroke(np.asarray(deflection, dtype=float) * factor)

    def deflection(self, stroke: ArrayLike) -> Array:
        """Return the deflection [m] for a stroke [-]."""
        factor = STROKE_FACTOR[self.convention] / self.half_length
        return elastica.checked_stroke(stroke) / factor

    def normalized_charge(self, deflection: ArrayLike, model: str = 'exact') -> Array:
        """
        Return Q_en / K [-] for a deflection [m].

        ``exact`` is the weightless elastica, ``printed`` A(15), ``linear`` A(16). ``arched`` and
        ``hanging`` include the weight, which matters below strokes of 0.05 only, and are slow.
        Raises ParameterError for another model or a deflection out of range.
        """
        stroke = self.stroke(deflection)
        if validation.one_of('model', model, MODELS) in CHARGE_MODELS:
            return CHARGE_MODELS[model](stroke)
        return elastica_with_weight.solve(stroke, WEIGHT_SIGNS[model] * self.weight).charge

    def deflection_from_charge(self, charge: ArrayLike) -> Array:
        """Return the deflection [m] for a charge Q_en / K in (-1, 0], the inverse of ``exact``."""
        return self.deflection(elastica.stroke_from_charge(charge))


# the films of paper A
FILMS = {
    '25x3': BucklingFilm(length=0.025, width=0.003, thickness=110e-6),  # Fig. 8, 9, Table I
    '32x3': BucklingFilm(length=0.032, width=0.003, thickness=110e-6),  # Fig. 4, 6(a)
    '10x1': BucklingFilm(length=0.010, width=0.001, thickness=28e-6),   # Fig. 2, 6(b), 7
}
