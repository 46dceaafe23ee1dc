# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of a calibrated film: what ``smart_tire identify film`` writes (YAML)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from smart_tire.arrays import Array
from smart_tire.errors import ParameterError
from smart_tire.models.film import elastica
from smart_tire.models.film.buckling_film import BucklingFilm
from smart_tire.models.film.hysteresis import DuhemParams
from smart_tire.paths import explained, read_file
from smart_tire.uncertain import MAX_RELATIVE_SIGMA
from smart_tire.yaml_text import MAX_SIZE, parse_yaml

Mask = NDArray[np.bool_]

PRODUCTS = ('alpha_gain', 'a_gain', 'b_gain')  # alpha K, a K, b K with the input gain K
AMPLIFIER = ('low_corner', 'drift')  # Hz, C/s
# of the calibrated range, up to which the covariance of undetermined products describes the error;
# assumed
EXTRAPOLATION_FACTOR = 1.5
TENSION_SIGMAS = 4.0  # beyond flat: the film is under tension, not buckled; assumed
STROKES = np.linspace(0.0, 0.999, 2000)  # of the table of charges; interpolation error below 1e-6


@dataclass(frozen=True, kw_only=True)
class FilmParams:
    """Parameters of a calibrated film, the input of ``measure``; see ``PRODUCTS``."""

    film: BucklingFilm | None  # geometry; None: the input is that of the operator itself
    alpha_gain: float          # 1 / unit of the input
    a_gain: float              # C / unit of the input
    b_gain: float              # C / unit of the input
    low_corner: float   # Hz, 0 if no amplifier was found
    drift: float        # C/s, in addition to the discharge of the amplifier
    covariance: Array   # (5, 5), of ``alpha_gain`` to ``drift``
    span: float         # range of the input in the calibration
    noise: float        # C, of one sample
    model_error: float  # C, rms of the residuals without noise

    @property
    def max_input(self) -> float:
        """Return the largest valid input, which is limited only if a product is undetermined."""
        products = np.array([self.alpha_gain, self.a_gain, self.b_gain])
        determined = np.sqrt(np.diag(self.covariance)[:3]) <= MAX_RELATIVE_SIGMA * np.abs(products)
        return math.inf if determined.all() else EXTRAPOLATION_FACTOR * self.span

    @property
    def max_charge(self) -> float:
        """Return the largest charge [C] of the calibrated inputs, in magnitude."""
        return abs(self.a_gain) * (self.span if self.film is None else 1.0)

    @property
    def operator(self) -> DuhemParams:
        """Return the operator from the normalized input to the charge; raise ParameterError."""
        return DuhemParams(alpha=self.alpha_gain, a=self.a_gain, b=self.b_gain)

    def is_possible(self, value: Array, sigma: Array) -> Mask:
        """Return which inputs of the operator, with standard deviations, a buckled film has."""
        return (value <= TENSION_SIGMAS * sigma) & (value > -1.0) | (self.film is None)

    def deflections(self, value: Array, sigma: Array) -> tuple[Array, Array]:
        """
        Return deflections [m] and standard deviations for inputs of the operator; arrays.

        NaN and infinite where the film is under tension, or where nothing is known. Without
        geometry, the inputs themselves.
        """
        known = self.is_possible(value, sigma) & np.isfinite(value)
        if self.film is not None:
            charges, slopes = _charge_table()
            per_stroke = float(self.film.deflection(0.5)) / 0.5
            sigma = sigma * per_stroke / np.interp(-value, charges, slopes)
            known &= sigma <= self.film.length / 12.0**0.5  # better than any deflection
            value = per_stroke * np.interp(-value, charges, STROKES)
        return np.where(known, value, np.nan), np.where(known, sigma, np.inf)


@cache
def _charge_table() -> tuple[Array, Array]:
    """Return minus the charge and minus its slope at ``STROKES``."""
    return -elastica.charge(STROKES), -elastica.charge_slope(STROKES)


def read_params(path: Path) -> FilmParams:
    """Return the parameters in a file of ``smart_tire identify film``, or raise ParameterError."""
    with explained(path, 'read'):
        text = read_file(path, MAX_SIZE)
    try:
        tree = parse_yaml(text)
    except ValueError as error:
        raise ParameterError(f'{path}: not valid YAML: {error}') from error
    try:
        return _params(tree)
    except KeyError as error:
        raise ParameterError(f'{path}: {error.args[0]} is missing') from error
    except (TypeError, ValueError) as error:
        raise ParameterError(f'{path}: {error}') from error


def _params(tree: Mapping[str, Any]) -> FilmParams:
    film = tree['film']
    values = {name: float(tree[group][name]['value'])
              for group, names in (('products', PRODUCTS), ('amplifier', AMPLIFIER))
              for name in names}
    values.update({name: float(tree[name]) for name in ('span', 'noise', 'model_error')})
    covariance = np.array(tree['covariance'], dtype=float)
    if covariance.shape != (5, 5) or not np.isfinite([*values.values(), *covariance.flat]).all():
        raise ParameterError('products, amplifier, covariance (5 x 5), span, noise and '
                             'model_error must be finite numbers')
    return FilmParams(
        film=None if film is None else BucklingFilm(
            length=film['length_m'], width=film['width_m'], thickness=film['thickness_m'],
            convention=film['convention']),
        covariance=covariance, **values)
