# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameter files with calibrated values: standard errors and sources are comments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.errors import ParameterError
from smart_tire.parameters import NODE_PARAMS
from smart_tire.parameters.spec import Spec, specs

ERROR_DIGITS = 2  # significant digits of a standard error
VALUE_DIGITS = 7  # significant digits of a value

Value = float | tuple[float, ...]


@dataclass(frozen=True)
class Identified:
    """A parameter identified from recordings."""

    name: str                   # as in the parameter files
    value: Value
    sigma: Value | None = None  # standard error; None if not available
    note: str = ''

    def rounded(self) -> Identified:
        """
        Return the parameter with as many digits as two significant digits of its error have.

        A value without a standard error is rounded to two significant digits itself.

        >>> one = Identified('wheel_radius', 0.571975, 0.001705).rounded()
        >>> one.value, one.sigma, Identified('wheel_radius', 0.0563).rounded().value
        (0.572, 0.0017, 0.056)
        """
        if not isinstance(self.value, tuple):
            assert not isinstance(self.sigma, tuple)
            value, sigma = _rounded(self.value, self.sigma)
            return replace(self, value=value, sigma=sigma)
        sigmas = self.sigma if isinstance(self.sigma, tuple) else (self.sigma,) * len(self.value)
        values, errors = zip(*map(_rounded, self.value, sigmas))
        return replace(self, value=values, sigma=None if self.sigma is None else errors)


def identified_text(header: Sequence[str], identified: Iterable[Identified]) -> str:
    """
    Return a ROS parameter file for all nodes with the ``identified`` parameters.

    ``header`` are comment lines. A comment after each value holds standard error, unit and note.
    Raises ParameterError for an unknown name or a value that is not allowed.
    """
    body = list(_body(identified))
    top = ['/**:', '  ros__parameters:'] if body else []
    return '\n'.join([*(f'# {line}' for line in header), *top, *body]) + '\n'


def _body(identified: Iterable[Identified]) -> Iterator[str]:
    known = {name: spec for cls in NODE_PARAMS.values() for name, spec in specs(cls).items()}
    open_group = ''
    for one in sorted(identified, key=lambda one: one.name.rpartition('.')[0]):
        if one.name not in known:
            raise ParameterError(f'unknown parameter {one.name}')
        known[one.name].check(one.value)
        group, _, name = one.name.rpartition('.')
        if group != open_group:
            yield f'    {group}:'
            open_group = group
        yield f'    {"  " if group else ""}{name}: {number_text(one.value)}' + _comment(
            one, known[one.name])


def _comment(one: Identified, spec: Spec) -> str:
    unit = '' if spec.unit == '-' else spec.unit
    error = '' if one.sigma is None else f'standard error {number_text(one.sigma, ERROR_DIGITS)} '
    comment = ', '.join(part for part in (f'{error}{unit}'.strip(), one.note) if part)
    return f'  # {comment}' if comment else ''


def _rounded(value: float, sigma: float | None) -> tuple[float, float | None]:
    if sigma is None:
        return round(value, _places(value)), None
    if not (sigma > 0.0 and math.isfinite(sigma)):
        return value, sigma
    # rounding the error may carry: 0.0996 has the places of 0.10
    error = round(sigma, _places(sigma))
    places = _places(error)
    return round(value, places), round(error, places)


def _places(number: float) -> int:
    """Return the decimal places that keep the significant digits of ``number``."""
    return ERROR_DIGITS - 1 - math.floor(math.log10(abs(number))) if number else 0


def number_text(value: Value, digits: int = VALUE_DIGITS) -> str:
    """Return a value as YAML reads it back as a number or a list of numbers."""
    if isinstance(value, tuple):
        return '[' + ', '.join(number_text(one, digits) for one in value) + ']'
    # YAML 1.1 reads 5e-05 as a text
    return np.format_float_positional(float(f'{value:.{digits}g}'), trim='0')
