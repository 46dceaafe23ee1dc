"""
One description per parameter: default, unit, meaning and range, beside the field it fills.

A parameter class is a frozen dataclass whose fields are made by ``param`` (a value), ``group``
(a nested class, its names prefixed with the field's name and a dot) or ``part`` (a nested class
whose names stand at the same level). ``specs`` flattens a class, ``build`` fills it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
import difflib
import math
from typing import Any, TypeVar

from smart_tire.errors import ParameterError

Params = TypeVar('Params')
KINDS = {bool: 'bool', int: 'int', float: 'float', str: 'str'}


@dataclass(frozen=True)
class Spec:
    """Description of one parameter."""

    name: str
    kind: str                     # bool, int, float, str, or one of these followed by []
    default: Any
    unit: str                     # '-' where there is none
    meaning: str
    low: float | None = None      # smallest value allowed
    high: float | None = None     # largest value allowed
    choices: tuple[str, ...] = ()
    length: int | None = None     # of a list, if fixed
    live: bool = False            # may be changed while the node runs

    def check(self, value: Any) -> Any:
        """Return ``value`` as this parameter's kind; raise ParameterError saying what is wrong."""
        if not self.kind.endswith('[]'):
            return self._one(value, self.kind)
        if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
            raise self._refusal(value, f'a list of {self.kind[:-2]}')
        items = tuple(self._one(item, self.kind[:-2]) for item in value)
        if self.length is not None and len(items) != self.length:
            raise self._refusal(value, f'{self.length} numbers')
        return items

    def _one(self, value: Any, kind: str) -> Any:
        if kind == 'float' and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if kind == 'int' and isinstance(value, float) and value.is_integer():
            value = int(value)
        if KINDS.get(type(value)) != kind:
            raise self._refusal(value, f'a {kind}')
        if self.choices and value not in self.choices:
            raise self._refusal(value, 'one of ' + ', '.join(self.choices))
        if kind in ('int', 'float') and not self._in_range(value):
            raise self._refusal(value, self.range_text())
        return value

    def _in_range(self, value: float) -> bool:
        return (math.isfinite(value) and (self.low is None or value >= self.low)
                and (self.high is None or value <= self.high))

    def range_text(self) -> str:
        """Return the range in words, with the unit."""
        unit = '' if self.unit == '-' else f' {self.unit}'
        if self.low is not None and self.high is not None:
            return f'{self.low:g} to {self.high:g}{unit}'
        if self.low is not None:
            return f'at least {self.low:g}{unit}'
        return f'at most {self.high:g}{unit}' if self.high is not None else 'a finite number'

    def _refusal(self, value: Any, expected: str) -> ParameterError:
        return ParameterError(f'parameter {self.name}: {value!r}, expected {expected}')


def param(default: Any, unit: str, meaning: str, **limits: Any) -> Any:
    """Return a dataclass field that describes a parameter; ``limits`` are fields of ``Spec``."""
    return field(default=default, metadata={'unit': unit, 'meaning': meaning, **limits})


def group(cls: Callable[[], Any]) -> Any:
    """Return a field for a nested class whose names get this field's name as prefix."""
    return field(default_factory=cls, metadata={'nested': cls, 'prefix': True})


def part(cls: Callable[[], Any]) -> Any:
    """Return a field for a nested class whose names stand at the level of the outer class."""
    return field(default_factory=cls, metadata={'nested': cls, 'prefix': False})


def _kind(default: Any) -> str:
    return KINDS[type(default[0])] + '[]' if isinstance(default, tuple) else KINDS[type(default)]


def specs(cls: type) -> dict[str, Spec]:
    """Return the flat name -> Spec of every parameter of ``cls``, in order of declaration."""
    found: dict[str, Spec] = {}
    for item in fields(cls):
        if (nested := item.metadata.get('nested')) is not None:
            prefix = f'{item.name}.' if item.metadata['prefix'] else ''
            for name, spec in specs(nested).items():
                found[prefix + name] = Spec(**{**vars(spec), 'name': prefix + name})
        else:
            found[item.name] = Spec(item.name, _kind(item.default), item.default, **item.metadata)
    return found


def known_names(classes: Iterable[type]) -> set[str]:
    """Return the names of all parameters of all ``classes``."""
    return {name for cls in classes for name in specs(cls)}


def unknown_name(name: str, known: Iterable[str], where: str = '') -> ParameterError:
    """Return the error for a parameter that nobody knows, with the likeliest meant name."""
    near = difflib.get_close_matches(name, list(known), n=1)
    hint = f', did you mean {near[0]}?' if near else ''
    return ParameterError(f'{where}unknown parameter {name}{hint}')


def build(cls: type[Params], values: Mapping[str, Any]) -> Params:
    """
    Return ``cls`` with ``values`` (flat names) over its defaults.

    Raises ParameterError, naming the parameter, for an unknown name or a value that is not of
    the described kind and range, and where values contradict each other.
    """
    described = specs(cls)
    for name in values:
        if name not in described:
            raise unknown_name(name, described)
    checked = {name: described[name].check(value) for name, value in values.items()}
    try:
        return _fill(cls, '', checked)
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(f'parameters: {error}') from error


def _fill(cls: type[Params], prefix: str, values: Mapping[str, Any]) -> Params:
    chosen: dict[str, Any] = {}
    for item in fields(cls):  # type: ignore[arg-type]
        if (nested := item.metadata.get('nested')) is not None:
            inner = f'{prefix}{item.name}.' if item.metadata['prefix'] else prefix
            chosen[item.name] = _fill(nested, inner, values)
        elif prefix + item.name in values:
            chosen[item.name] = values[prefix + item.name]
    return cls(**chosen)
