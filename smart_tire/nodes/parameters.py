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

"""Parameter classes as ROS parameters: declaration, description and reading."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from smart_tire.nodes.compat import given_parameters
from smart_tire.parameters import build, known_names, NODE_PARAMS, Spec, specs
from smart_tire.parameters.files import check_names
from smart_tire.parameters.spec import is_known

Params = TypeVar('Params')


def declare(node: Node, cls: type[Params]) -> Params:
    """
    Declare the parameters of ``cls`` on ``node`` and return them, checked.

    Raises ParameterError for an invalid value and for a name that no node of this package has.
    Parameters of other nodes, which a ``/**`` block sets for all nodes, are ignored.
    """
    given = given_parameters(node)
    check_names(given, known_names([cls, *NODE_PARAMS.values()]))
    values = _values_of(cls, given)
    params = build(cls, values)
    for name, spec in specs(cls, values).items():
        value = spec.check(values.get(name, spec.default))
        node.declare_parameter(name, list(value) if isinstance(value, tuple) else value,
                               descriptor(spec), ignore_override=True)
    return params


def read(node: Node, cls: type, changes: Iterable[Parameter[Any]]) -> dict[str, Any]:
    """Return the values of the parameters of ``cls`` on ``node`` after ``changes``."""
    declared = node.get_parameters_by_prefix('').values()
    return _values_of(cls, {item.name: item.value for item in (*declared, *changes)})


def _values_of(cls: type, values: dict[str, Any]) -> dict[str, Any]:
    known = known_names([cls])
    return {name: value for name, value in values.items() if is_known(name, known)}


def descriptor(spec: Spec) -> ParameterDescriptor:
    """Return the ROS descriptor of ``spec``, for parameter tools."""
    unit = '' if spec.unit == '-' else f' [{spec.unit}]'
    described = ParameterDescriptor(
        name=spec.name, description=spec.meaning + unit, read_only=not spec.live,
        dynamic_typing=True,  # integers are accepted for floats; ``Spec.check`` decides
        additional_constraints=_constraints(spec))
    if spec.kind == 'float':
        described.floating_point_range = [FloatingPointRange(
            from_value=float(spec.low), to_value=float(spec.high))]
    elif spec.kind == 'int':
        described.integer_range = [IntegerRange(
            from_value=int(spec.low), to_value=int(spec.high))]
    return described


def _constraints(spec: Spec) -> str:
    texts = []
    if spec.length is not None:
        texts.append(f'{spec.length} values')
    if spec.choices:
        texts.append('one of ' + ', '.join(spec.choices))
    if spec.is_number:
        texts.append(spec.range_text())
    return ', '.join(texts)
