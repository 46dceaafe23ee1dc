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
Arguments of the models as arrays; invalid ones raise ParameterError.

The message names the argument, the first invalid element and the expected range.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError


def finite(name: str, value: ArrayLike) -> Array:
    """
    Return ``value`` as an array of finite numbers.

    >>> finite('slip', [0.1, float('inf')])
    Traceback (most recent call last):
    ...
    smart_tire.errors.ParameterError: slip[1] is inf, expected finite numbers
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ParameterError(f'{name} is not numeric: {error}') from error
    _reject(name, array, ~np.isfinite(array), 'expected finite numbers')
    return array


def positive(name: str, value: ArrayLike) -> Array:
    """
    Return ``value`` as an array of finite numbers above zero.

    >>> positive('width', [[0.003, -0.003]])
    Traceback (most recent call last):
    ...
    smart_tire.errors.ParameterError: width[0, 1] is -0.003, expected above zero
    """
    array = finite(name, value)
    _reject(name, array, array <= 0.0, 'expected above zero')
    return array


def one_of(name: str, value: str, choices: tuple[str, ...]) -> str:
    """
    Return ``value`` if it is one of the choices.

    >>> one_of('release', 'fig9', ('fig8', 'state'))
    Traceback (most recent call last):
    ...
    smart_tire.errors.ParameterError: release is 'fig9', expected one of fig8, state
    """
    if value not in choices:
        raise ParameterError(f'{name} is {value!r}, expected one of {", ".join(choices)}')
    return value


def _reject(name: str, array: Array, wrong: npt.NDArray[np.bool_], reason: str) -> None:
    if wrong.any():
        index = np.argwhere(wrong)[0].tolist() if array.ndim else ''
        raise ParameterError(f'{name}{index} is {array[wrong].flat[0]}, {reason}')
