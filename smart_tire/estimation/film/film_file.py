"""Parameters of an identified film, and reading them from their YAML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from smart_tire.arrays import Array
from smart_tire.errors import ParameterError
from smart_tire.models.film.buckling_film import BucklingFilm
from smart_tire.models.film.hysteresis import DuhemParams
from smart_tire.uncertain import MAX_RELATIVE_SIGMA

PRODUCTS = ('alpha_gain', 'a_gain', 'b_gain')
AMPLIFIER = ('low_corner', 'drift')  # Hz, C/s
REACH = 1.5   # of the range: chosen; linear errors of undetermined products end there


@dataclass(frozen=True, kw_only=True)
class FilmParams:
    """A calibrated film: ``measure`` needs no more."""

    film: BucklingFilm | None  # None: the input is that of the operator itself
    alpha_gain: float          # 1 / unit of the input
    a_gain: float              # C / unit of the input
    b_gain: float
    low_corner: float          # Hz, 0 where the amplifier showed none
    drift: float               # C/s, beside what the amplifier drains
    covariance: Array          # (5, 5) of the five
    span: float                # range of the input that they come from
    noise: float               # C, of one sample
    misfit: float              # C, rms of what the operator leaves beside noise

    @property
    def reach(self) -> float:
        """Return the largest input that they hold for: little beyond a loop that is too small."""
        products = np.array([self.alpha_gain, self.a_gain, self.b_gain])
        determined = np.sqrt(np.diag(self.covariance)[:3]) <= MAX_RELATIVE_SIGMA * np.abs(products)
        return math.inf if determined.all() else REACH * self.span

    @property
    def operator(self) -> DuhemParams:
        """Return the operator from the normalised input to the charge; ParameterError if none."""
        return DuhemParams(alpha=self.alpha_gain, a=self.a_gain, b=self.b_gain)


def read_params(path: Path) -> FilmParams:
    """Return the parameters in a file of ``write_params``; ParameterError names what is wrong."""
    try:
        tree = yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise ParameterError(f'{path}: cannot be read ({error.strerror})') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ParameterError(f'{path}: is no YAML: {error}') from error
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
    values.update({name: float(tree[name]) for name in ('span', 'noise', 'misfit')})
    covariance = np.array(tree['covariance'], dtype=float)
    if covariance.shape != (5, 5) or not np.isfinite([*values.values(), *covariance.flat]).all():
        raise ParameterError('products, amplifier, covariance (5 x 5), span, noise and misfit '
                             'must be finite numbers')
    return FilmParams(
        film=None if film is None else BucklingFilm(
            length=film['length_m'], width=film['width_m'], thickness=film['thickness_m'],
            convention=film['convention']),
        covariance=covariance, **values)
