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

"""Parameter file of a calibration: values rounded to their standard errors, with their sources."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from smart_tire.errors import ParameterError
from smart_tire.parameters import NODE_PARAMS
from smart_tire.parameters.calibration_file import Identified, Value
from smart_tire.parameters.spec import Spec, specs

ERROR_DIGITS = 2  # significant digits of a standard error


@dataclass(frozen=True)
class Calibrated:
    """An identified parameter, and the recordings it comes from."""

    identified: Identified
    recordings: tuple[str, ...]


def calibrated_text(date: str, items: Iterable[Calibrated],
                    kept: Mapping[str, tuple[Any, str]]) -> str:
    """
    Return a ROS parameter file for all nodes, with one comment per value.

    A comment has unit, standard error, ``date`` and recordings. ``kept`` has the value and the
    reason of parameters that are not written. Raises ParameterError for an unknown name or a value
    that is not allowed.
    """
    known = {name: spec for cls in NODE_PARAMS.values() for name, spec in specs(cls).items()}
    lines = [f'# Calibrated on {date} by smart_tire calibrate.']
    lines += [f'# kept: {name}: {_plain(value)}  ({reason})'
              for name, (value, reason) in kept.items()]
    ordered = sorted(items, key=lambda item: item.identified.name.rpartition('.')[0])
    if not ordered:
        return '\n'.join(lines) + '\n'
    return '\n'.join([*lines, '/**:', '  ros__parameters:', *_body(ordered, known, date)]) + '\n'


def _body(items: Sequence[Calibrated], known: Mapping[str, Spec], date: str) -> Iterator[str]:
    open_group = ''
    for item in items:
        one = item.identified
        if one.name not in known:
            raise ParameterError(f'unknown parameter {one.name}')
        value, sigma = rounded(one.value, one.sigma)
        known[one.name].check(value)
        group, _, name = one.name.rpartition('.')
        if group != open_group:
            yield f'    {group}:'
            open_group = group
        unit = '' if known[one.name].unit == '-' else f' {known[one.name].unit}'
        error = '' if sigma is None else f'standard error {_plain(sigma)}{unit}'
        comment = ', '.join(part for part in (
            error, date, 'from ' + ' and '.join(item.recordings), one.note) if part)
        yield f'    {"  " if group else ""}{name}: {_plain(value)}  # {comment}'


def rounded(value: Value, sigma: Value | None) -> tuple[Value, Value | None]:
    """
    Return value and standard error, rounded to two significant digits of the error.

    A value without a standard error is rounded to two significant digits itself.

    >>> rounded(0.571975, 0.001705)
    (0.572, 0.0017)
    >>> rounded(0.0563, None)
    (0.056, None)
    """
    if isinstance(value, tuple):
        sigmas = sigma if isinstance(sigma, tuple) else (sigma,) * len(value)
        pairs = [_rounded(one, error) for one, error in zip(value, sigmas)]
        return (tuple(one for one, _ in pairs),
                None if sigma is None else tuple(error or 0.0 for _, error in pairs))
    assert not isinstance(sigma, tuple)
    return _rounded(value, sigma)


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
    if number == 0.0:
        return 0
    return ERROR_DIGITS - 1 - math.floor(math.log10(abs(number)))


def _plain(value: Any) -> str:
    """Return a value as YAML reads it back as a number or a list of numbers."""
    if isinstance(value, (tuple, list)):
        return '[' + ', '.join(_plain(one) for one in value) + ']'
    if isinstance(value, float):  # YAML 1.1 reads 5e-05 as a text
        return np.format_float_positional(value, trim='0')
    return repr(value)
