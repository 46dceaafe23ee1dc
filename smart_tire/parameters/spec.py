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
Declaration of parameters: default, unit, meaning and range, next to the field that holds them.

A parameter class is a frozen dataclass whose fields are made by ``param`` (a value), ``nested``
(a class whose names get the field's name as prefix), ``inlined`` (a class whose names get no
prefix) or ``named`` (a list of instances of a class, by name). ``specs`` returns the flat
parameters of a class, ``build`` an instance from flat values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from fnmatch import fnmatchcase
import math
from typing import Any, TypeVar

from smart_tire.errors import did_you_mean, ParameterError

Params = TypeVar('Params')
ANY_NAME = '*'    # in the place of the names of a ``named`` field
NAMES = 'names'   # last part of the list parameter with the names of a ``named`` field
QOS_OVERRIDES = 'qos_overrides.'  # begin of the names of parameters that nodes in C++ declare
# parameters of earlier versions -> where what they chose is now
MOVED = {
    'traction.unknown_friction': 'it is traction.unknown now, as friction.unknown',
    'constraint': 'lambda in B(7) is plain; as printed it is in "smart_tire reproduce" and in '
                  'smart_tire.papers.printed',
    **dict.fromkeys(('method', 'map'), (
        'friction is estimated from the whole waveform; the two peaks of paper B are in '
        '"smart_tire reproduce" and in smart_tire.papers.printed'))}


@dataclass(frozen=True)
class Spec:
    """Description of one parameter."""

    name: str
    kind: str                     # bool, int, float, str, or one of these followed by []
    default: Any
    unit: str                     # '-' if dimensionless
    meaning: str
    low: float = -math.inf        # smallest value allowed; numbers need both, finite
    high: float = math.inf        # largest value allowed
    choices: tuple[str, ...] = ()
    length: int | None = None     # of a list, if fixed
    live: bool = False            # may be changed while the node runs
    instances: bool = False       # lists the names of a ``named`` field
    nan: bool = False             # NaN is allowed: not given
    scalar: bool = False          # of a list: a number is a list of one

    def __post_init__(self) -> None:
        if self.is_number and not (math.isfinite(self.low) and math.isfinite(self.high)):
            raise ValueError(f'parameter {self.name}: a number needs finite low and high')

    @property
    def is_number(self) -> bool:
        """Return whether this is a number or a list of them."""
        return self.kind.removesuffix('[]') in ('int', 'float')

    def check(self, value: Any) -> Any:
        """
        Return ``value`` converted to this parameter's kind; raise ParameterError if invalid.

        None is an empty list: rcl reports an empty list in a parameter file as not set, since it
        has no type, and rclpy gives None.
        """
        if not self.kind.endswith('[]'):
            return self._check_one(value, self.kind)
        value = () if value is None else value
        if self.scalar and isinstance(value, (int, float)):
            value = (value,)
        if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
            raise self._error(value, f'a list of {self.kind[:-2]}')
        items = tuple(self._check_one(item, self.kind[:-2]) for item in value)
        if self.length is not None and len(items) != self.length:
            raise self._error(value, f'{self.length} numbers')
        return items

    def _check_one(self, value: Any, kind: str) -> Any:
        if kind == 'float' and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if kind == 'int' and isinstance(value, float) and value.is_integer():
            value = int(value)
        if self.nan and str(value).lower() == 'nan':  # YAML takes nan without a dot for a string
            return math.nan  # one object: instances with it are equal
        if type(value).__name__ != kind:
            raise self._error(value, f'{"an" if kind == "int" else "a"} {kind}')
        if self.choices and value not in self.choices:
            raise self._error(value, 'one of ' + ', '.join(self.choices))
        if kind in ('int', 'float') and not self._in_range(value):
            raise self._error(value, self.range_text())
        return value

    def _in_range(self, value: float) -> bool:
        return self.low <= value <= self.high  # false for NaN, too

    def range_text(self) -> str:
        """Return the range as text, with the unit."""
        unit = '' if self.unit == '-' else f' {self.unit}'
        return f'{self.low:g} to {self.high:g}{unit}'

    def _error(self, value: Any, expected: str) -> ParameterError:
        return ParameterError(f'parameter {self.name}: {value!r}, expected {expected}')


def param(default: Any, unit: str, meaning: str, limits: tuple[float, float] | None = None,
          **details: Any) -> Any:
    """
    Return a dataclass field that describes a parameter.

    ``limits`` are the smallest and the largest number allowed, ``details`` fields of ``Spec``.
    """
    low, high = limits or (-math.inf, math.inf)
    return field(default=default, metadata={
        'unit': unit, 'meaning': meaning, 'low': low, 'high': high, **details})


def reliability() -> Any:
    """Return the field that all nodes with inputs have."""
    return param('reliable', '-', 'QoS reliability of the input subscriptions',
                 choices=('reliable', 'best_effort'))


def realtime_priority() -> Any:
    """Return the field of nodes that the motors depend on."""
    return param(
        0, '-', '1 to 99: SCHED_FIFO for all threads, where the host permits it; 0: none',
        (0, 99))


def nested(cls: Callable[[], Any], *, live: bool = False) -> Any:
    """
    Return a field for a parameter class whose names get this field's name as prefix.

    ``live`` is the default of that field of ``Spec`` for all its parameters.
    """
    return field(default_factory=cls, metadata={'class': cls, 'prefix': True, 'live': live})


def inlined(cls: Callable[[], Any]) -> Any:
    """Return a field for a parameter class whose names are those of the outer class."""
    return field(default_factory=cls, metadata={'class': cls, 'prefix': False, 'live': False})


def named(cls: type, default: tuple[Any, ...], meaning: str) -> Any:
    """
    Return a field for a tuple of instances of ``cls``, each with a name.

    ``cls`` has a field ``name`` and parameters. The parameter ``<field>.names`` lists the names,
    ``<field>.<name>.<parameter>`` describes the instance of that name. Instances that are not
    listed are ignored, so that a parameter file can replace the list of another one.
    """
    return field(default=default, metadata={'instances of': cls, 'meaning': meaning})


def specs(cls: type, values: Mapping[str, Any] | None = None) -> dict[str, Spec]:
    """
    Return name -> Spec of every parameter of ``cls``, in order of declaration.

    ``values`` (flat names) hold the lists of names of ``named`` fields that differ from the
    defaults.
    """
    return {spec.name: spec for spec in _walk(cls, '', values or {})}


def _walk(cls: type, prefix: str, given: Mapping[str, Any] | None,
          live: bool = False) -> Iterator[Spec]:
    """Yield the parameters; instances are those that ``given`` lists, ``*`` for None."""
    for item in fields(cls):
        metadata = item.metadata
        if 'class' in metadata:
            inner = f'{prefix}{item.name}.' if metadata['prefix'] else prefix
            yield from _walk(metadata['class'], inner, given, metadata['live'])
        elif 'instances of' in metadata:
            yield from _walk_instances(item, f'{prefix}{item.name}.', given)
        elif 'unit' in metadata:
            yield Spec(prefix + item.name, _kind(str(item.type)), item.default,
                       **{'live': live, **metadata})


def _walk_instances(item: Any, prefix: str, given: Mapping[str, Any] | None) -> Iterator[Spec]:
    defaults, parameter = {instance.name: instance for instance in item.default}, prefix + NAMES
    yield Spec(parameter, 'str[]', tuple(defaults), '-', item.metadata['meaning'], instances=True)
    for name in (ANY_NAME,) if given is None else _instance_names(
            parameter, given.get(parameter, tuple(defaults))):
        inner = f'{prefix}{name}.'
        for spec in _walk(item.metadata['instances of'], inner, given):
            leaf = spec.name.removeprefix(inner)
            yield replace(spec, default=getattr(defaults.get(name), leaf, spec.default))


def _kind(annotation: str) -> str:
    """Return the kind of a field: tuple[float, ...] is float[]."""
    return annotation.replace('tuple[', '').replace(', ...]', '[]')


def _instance_names(parameter: str, names: Any) -> tuple[str, ...]:
    """Return the names in a list parameter; raise ParameterError if they cannot be names."""
    listed: tuple[str, ...] = Spec(parameter, 'str[]', (), '-', '').check(names)
    if len(set(listed)) < len(listed) or not all(
            name.isidentifier() and name != NAMES for name in listed):
        raise ParameterError(f'parameter {parameter}: {list(listed)}, expected distinct names of '
                             f'letters, digits and _, other than {NAMES}')
    return listed


def known_names(classes: Iterable[type]) -> dict[str, Spec]:
    """Return the parameters of ``classes`` by name, ``*`` for the names of ``named`` fields."""
    return {spec.name: spec for cls in classes for spec in _walk(cls, '', None)}


def is_known(name: str, known: Iterable[str]) -> bool:
    """Return whether ``name`` is one of ``known``, the result of ``known_names``."""
    return known_name(name, known) is not None


def known_name(name: str, known: Iterable[str]) -> str | None:
    """Return which of ``known``, the result of ``known_names``, is ``name``; None if none is."""
    return name if name in known else next((
        pattern for pattern in known if ANY_NAME in pattern and fnmatchcase(name, pattern)), None)


def unknown_name_error(name: str, known: Iterable[str], where: str = '') -> ParameterError:
    """Return the error for an unknown parameter: where it is now, or the most similar name."""
    if name in MOVED:
        return ParameterError(f'{where}{name} is no parameter any more: {MOVED[name]}')
    if name.startswith(QOS_OVERRIDES):
        return ParameterError(f'{where}{name}: qualities of service are fixed; for publishers '
                              'that offer best effort only set reliability')
    return ParameterError(f'{where}unknown parameter {name}{did_you_mean(name, known)}')


def build(cls: type[Params], values: Mapping[str, Any]) -> Params:
    """
    Return an instance of ``cls`` with ``values`` (flat names) in place of its defaults.

    Raises ParameterError, naming the parameter, for an unknown name, for a value that is not of
    the described kind and range, and for values that contradict each other.
    """
    described, known = specs(cls, values), known_names([cls])
    for name in values:
        if not is_known(name, known):
            raise unknown_name_error(name, known)
    checked = {name: spec.check(values[name]) if name in values else spec.default
               for name, spec in described.items()}
    try:
        return _fill(cls, '', checked)
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(f'parameters: {error}') from error


def values_of(params: Any, prefix: str = '') -> dict[str, Any]:
    """Return the flat values of an instance, from which ``build`` makes an equal one."""
    values: dict[str, Any] = {}
    for item in fields(params):
        metadata, value, name = item.metadata, getattr(params, item.name), prefix + item.name
        if 'class' in metadata:
            values |= values_of(value, f'{name}.' if metadata['prefix'] else prefix)
        elif 'instances of' in metadata:
            values[f'{name}.{NAMES}'] = [instance.name for instance in value]
            for instance in value:
                values |= values_of(instance, f'{name}.{instance.name}.')
        elif 'unit' in metadata:
            values[name] = list(value) if isinstance(value, tuple) else value
    return values


def _fill(cls: type[Params], prefix: str, values: Mapping[str, Any], **chosen: Any) -> Params:
    for item in fields(cls):  # type: ignore[arg-type]
        metadata, name = item.metadata, prefix + item.name
        if 'class' in metadata:
            inner = f'{name}.' if metadata['prefix'] else prefix
            chosen[item.name] = _fill(metadata['class'], inner, values)
        elif 'instances of' in metadata:
            chosen[item.name] = tuple(
                _fill(metadata['instances of'], f'{name}.{instance}.', values, name=instance)
                for instance in values[f'{name}.{NAMES}'])
        elif 'unit' in metadata:
            chosen[item.name] = values[name]
    return cls(**chosen)
