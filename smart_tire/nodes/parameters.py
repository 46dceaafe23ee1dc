"""Parameter classes as ROS parameters: described, ranged, and refused in one clear line."""

from __future__ import annotations

import math
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from smart_tire.nodes.compat import given_parameters
from smart_tire.parameters import build, known_names, NODE_PARAMS, Spec, specs
from smart_tire.parameters.files import check_names

Params = TypeVar('Params')
INT_LIMITS = (-2**63, 2**63 - 1)  # an IntegerRange has no open ends


def declare(node: Node, cls: type[Params]) -> Params:
    """
    Declare the parameters of ``cls`` on ``node`` and return them, checked.

    Raises ParameterError for a bad value, and for a name that no node of this package has; a
    parameter of another node (the wildcard ``/**`` gives them to all) is left alone.
    """
    described = specs(cls)
    given = given_parameters(node)
    check_names(given, known_names([cls, *NODE_PARAMS.values()]))
    values = {name: _not_none(value, described[name]) for name, value in given.items()
              if name in described}
    params = build(cls, values)
    for name, spec in described.items():
        value = spec.check(values.get(name, spec.default))
        node.declare_parameter(name, list(value) if isinstance(value, tuple) else value,
                               descriptor(spec), ignore_override=True)
    return params


def _not_none(value: Any, spec: Spec) -> Any:
    return () if value is None and spec.kind.endswith('[]') else value  # rcl: an empty list


def descriptor(spec: Spec) -> ParameterDescriptor:
    """Return the description of ``spec`` for parameter tools."""
    unit = '' if spec.unit == '-' else f' [{spec.unit}]'
    described = ParameterDescriptor(
        name=spec.name, description=spec.meaning + unit, read_only=not spec.live,
        dynamic_typing=True,  # so that 1 will do where 1.0 is meant; ``Spec.check`` decides
        additional_constraints=_constraints(spec))
    if spec.low is None and spec.high is None:
        return described
    if spec.kind == 'float':
        described.floating_point_range = [FloatingPointRange(
            from_value=-math.inf if spec.low is None else float(spec.low),
            to_value=math.inf if spec.high is None else float(spec.high))]
    elif spec.kind == 'int':
        described.integer_range = [IntegerRange(
            from_value=INT_LIMITS[0] if spec.low is None else int(spec.low),
            to_value=INT_LIMITS[1] if spec.high is None else int(spec.high))]
    return described


def _constraints(spec: Spec) -> str:
    words = []
    if spec.length is not None:
        words.append(f'{spec.length} values')
    if spec.choices:
        words.append('one of ' + ', '.join(spec.choices))
    elif spec.low is not None or spec.high is not None:
        words.append(spec.range_text())
    return ', '.join(words)
