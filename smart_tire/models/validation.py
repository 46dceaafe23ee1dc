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

"""
Arguments of the models as arrays; invalid ones raise ParameterError.

The message names the argument, the first invalid element and the expected range.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError


def numbers(name: str, value: ArrayLike) -> Array:
    """
    Return ``value`` as an array without NaN.

    >>> numbers('stroke', ['a'])
    Traceback (most recent call last):
    ...
    smart_tire.errors.ParameterError: stroke is not numeric: could not convert string to float: 'a'
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ParameterError(f'{name} is not numeric: {error}') from error
    _reject(name, array, np.isnan(array), 'expected numbers')
    return array


def finite(name: str, value: ArrayLike) -> Array:
    """
    Return ``value`` as an array of finite numbers.

    >>> finite('slip', [0.1, float('inf')])
    Traceback (most recent call last):
    ...
    smart_tire.errors.ParameterError: slip[1] is inf, expected finite numbers
    """
    array = numbers(name, value)
    _reject(name, array, np.isinf(array), 'expected finite numbers')
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


def not_negative(name: str, value: ArrayLike, *, infinite: bool = False) -> Array:
    """
    Return ``value`` as an array of numbers of at least zero, finite unless ``infinite``.

    >>> print(not_negative('critical_slip', [0.7, float('inf')], infinite=True))
    [0.7 inf]
    """
    array = numbers(name, value) if infinite else finite(name, value)
    _reject(name, array, array < 0.0, 'expected zero or more')
    return array


def within(name: str, value: ArrayLike, low: float, high: ArrayLike, reason: str) -> Array:
    """
    Return ``value`` as an array of numbers in ``[low, high]``; ``reason`` ends the message.

    >>> within('x', 0.03, 0.0, 0.02, 'expected within the film')
    Traceback (most recent call last):
    ...
    smart_tire.errors.ParameterError: x is 0.03, expected within the film
    """
    array, limit = finite(name, value), np.asarray(high, dtype=float)
    fitting(**{name: array, 'limit': limit})
    _reject(name, array + 0.0 * limit, (array < low) | (array > limit), reason)
    return array


def fitting(**arrays: ArrayLike) -> None:
    """
    Raise ParameterError with all shapes unless the arrays broadcast against each other.

    >>> fitting(slip=[0.1, 0.2], load=[26.7, 26.7, 26.7])
    Traceback (most recent call last):
    ...
    smart_tire.errors.ParameterError: shapes do not broadcast: slip (2,), load (3,)
    """
    shapes = {name: np.shape(array) for name, array in arrays.items()}
    try:
        np.broadcast_shapes(*shapes.values())
    except ValueError as error:
        listed = ', '.join(f'{name} {shape}' for name, shape in shapes.items() if shape)
        raise ParameterError(f'shapes do not broadcast: {listed}') from error


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
