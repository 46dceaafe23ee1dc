"""
The buckled film as a sensor: geometry, material, and charge from deflection, paper A, II.

A film of length 2 L is clamped at both ends, flat at deflection 0; ``deflection`` [m] is how far
its ends have come together, the paper's Delta without its sign. Charge is counted from the flat
film and before hysteresis (Q_en), so it is negative: the load falls below the Euler load's share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models.film import elastica, elastica_with_weight, printed_elastica

GRAVITY = 9.80665  # m/s2, standard

# stroke of a deflection over the film's half length L: A(8b) needs half the end's stroke for each
# half of the film, but delta = Delta / L is printed
STROKE_FACTOR = {'exact': 0.5, 'printed': 1.0}
CHARGE_MODELS: dict[str, Callable[[ArrayLike], Array]] = {
    'exact': elastica.charge, 'printed': printed_elastica.charge,
    'linear': printed_elastica.linear_charge}


@dataclass(frozen=True, kw_only=True)
class Material:
    """Film material; the paper gives no constants, these are assumed: usual values of PVDF."""

    d31: float = 23e-12     # C/N
    c11: float = 3e9        # Pa, also Young's modulus E
    density: float = 1780.0  # kg/m3

    def __post_init__(self) -> None:
        _check_positive(self, 'd31', 'c11', 'density')


@dataclass(frozen=True, kw_only=True)
class BucklingFilm:
    """A strip of film; ``convention`` names the normalisation of its stroke."""

    length: float     # m, 2 L between the clamps
    width: float      # m, b
    thickness: float  # m, t_S
    material: Material = field(default_factory=Material)
    convention: str = 'exact'

    def __post_init__(self) -> None:
        _check_positive(self, 'length', 'width', 'thickness')
        if self.convention not in STROKE_FACTOR:
            raise ParameterError(
                f'convention is {self.convention!r}, expected one of {", ".join(STROKE_FACTOR)}')

    @property
    def half_length(self) -> float:
        """Return L [m]."""
        return 0.5 * self.length

    @property
    def second_moment(self) -> float:
        """Return I [m4] of the cross section."""
        return self.width * self.thickness**3 / 12.0

    @property
    def weight(self) -> float:
        """Return w of A(6), weight over bending stiffness."""
        per_length = self.material.density * self.width * self.thickness * GRAVITY
        return per_length * self.half_length**3 / (self.material.c11 * self.second_moment)

    @property
    def gain(self) -> float:
        """Return K [C] of A(15); Table I's fitted one is a hundred times larger."""
        return (2.0 * math.pi**2 * self.material.d31 * self.material.c11 * self.second_moment
                / (self.half_length * self.thickness))

    def stroke(self, deflection: ArrayLike) -> Array:
        """Return the normalised stroke delta; ParameterError where there is none, see elastica."""
        factor = STROKE_FACTOR[self.convention] / self.half_length
        return elastica.checked_stroke(np.asarray(deflection, dtype=float) * factor)

    def deflection(self, stroke: ArrayLike) -> Array:
        """Return the deflection [m] of a normalised stroke."""
        factor = STROKE_FACTOR[self.convention] / self.half_length
        return elastica.checked_stroke(stroke) / factor

    def normalised_charge(self, deflection: ArrayLike, model: str = 'exact') -> Array:
        """
        Return Q_en / K of a deflection [m].

        ``exact`` is the weightless elastica, ``printed`` A(15), ``linear`` A(16); ``arched`` and
        ``hanging`` have the film's weight, which counts below strokes of 0.05 only, and are slow.
        """
        stroke = self.stroke(deflection)
        if model in ('arched', 'hanging'):
            weight = self.weight if model == 'arched' else -self.weight
            return elastica_with_weight.solve(stroke, weight).charge
        if model not in CHARGE_MODELS:
            raise ParameterError(f'model is {model!r}, expected one of '
                                 f'{", ".join([*CHARGE_MODELS, "arched", "hanging"])}')
        return CHARGE_MODELS[model](stroke)

    def deflection_from_charge(self, charge: ArrayLike) -> Array:
        """Return the deflection [m] of a charge Q_en / K in (-1, 0]: inverse of ``exact``."""
        return self.deflection(elastica.stroke_from_charge(charge))


def _check_positive(record: object, *names: str) -> None:
    for name in names:
        value = getattr(record, name)
        if not (math.isfinite(value) and value > 0.0):
            raise ParameterError(f'{name} is {value}, expected a positive number')


# the films of paper A
FILMS = {
    '25x3': BucklingFilm(length=0.025, width=0.003, thickness=110e-6),  # Fig. 8, 9, Table I
    '32x3': BucklingFilm(length=0.032, width=0.003, thickness=110e-6),  # Fig. 4, 6(a)
    '10x1': BucklingFilm(length=0.010, width=0.001, thickness=28e-6),   # Fig. 2, 6(b), 7
}
