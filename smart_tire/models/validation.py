"""Arguments of the models as arrays: what can not be is refused by name, value and reason."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError


def numbers(name: str, value: ArrayLike) -> Array:
    """Return ``value`` as an array that is not NaN anywhere."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ParameterError(f'{name} holds what is no number: {error}') from error
    _refuse(name, array, np.isnan(array), 'expected numbers')
    return array


def finite(name: str, value: ArrayLike) -> Array:
    """Return ``value`` as an array of finite numbers."""
    array = numbers(name, value)
    _refuse(name, array, np.isinf(array), 'expected finite numbers')
    return array


def positive(name: str, value: ArrayLike) -> Array:
    """Return ``value`` as an array of finite numbers above zero."""
    array = finite(name, value)
    _refuse(name, array, array <= 0.0, 'expected above zero')
    return array


def not_negative(name: str, value: ArrayLike, *, infinite: bool = False) -> Array:
    """Return ``value`` as an array of numbers from zero on, finite ones unless ``infinite``."""
    array = numbers(name, value) if infinite else finite(name, value)
    _refuse(name, array, array < 0.0, 'expected zero or more')
    return array


def within(name: str, value: ArrayLike, low: float, high: ArrayLike, reason: str) -> Array:
    """Return ``value`` as an array of numbers in ``[low, high]``; ``reason`` says why there."""
    array, limit = finite(name, value), np.asarray(high, dtype=float)
    fitting(**{name: array, 'its limit': limit})
    _refuse(name, array + 0.0 * limit, (array < low) | (array > limit), reason)
    return array


def fitting(**arrays: ArrayLike) -> None:
    """Raise ParameterError with all shapes unless the arrays broadcast against each other."""
    shapes = {name: np.shape(array) for name, array in arrays.items()}
    try:
        np.broadcast_shapes(*shapes.values())
    except ValueError as error:
        listed = ', '.join(f'{name} {shape}' for name, shape in shapes.items() if shape)
        raise ParameterError(f'shapes do not fit each other: {listed}') from error


def one_of(name: str, value: str, choices: tuple[str, ...]) -> str:
    """Return ``value`` if it is one of the choices."""
    if value not in choices:
        raise ParameterError(f'{name} is {value!r}, expected one of {", ".join(choices)}')
    return value


def _refuse(name: str, array: Array, wrong: npt.NDArray[np.bool_], reason: str) -> None:
    if wrong.any():
        place = np.argwhere(wrong)[0].tolist() if array.ndim else ''
        raise ParameterError(f'{name}{place} is {array[wrong].flat[0]}, {reason}')
