# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""ROS parameters: those of a node from its class, and those of all running nodes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import time
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange, IntegerRange, ParameterDescriptor, ParameterEvent)
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import qos_profile_parameter_events

from smart_tire.nodes.compat import given_parameters
from smart_tire.parameters import build, known_names, NODE_PARAMS, Spec, specs
from smart_tire.parameters.files import check_names
from smart_tire.parameters.spec import is_known
from smart_tire.yaml_text import parse_yaml

Params = TypeVar('Params')
QUERY_TIMEOUT_NS = 5_000_000_000  # after which a node is asked again

Values = dict[str, Any]  # flat parameters of a node


def declare(node: Node, cls: type[Params]) -> Params:
    """
    Declare the parameters of ``cls`` on ``node`` and return them, checked.

    Raises ParameterError for an invalid value and for a name that no node of this package has.
    Parameters of other nodes, which a ``/**`` block sets for all nodes, are ignored.
    """
    given, own = given_parameters(node), known_names([cls])
    if foreign := [name for name in given if not is_known(name, own)]:
        check_names(foreign, known_names([cls, *NODE_PARAMS.values()]))
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


def with_number(node: Node, change: Parameter[Any]) -> Parameter[Any]:
    """
    Return ``change`` with the number that its text means; as it is for a parameter that is text.

    ``ros2 param`` sends 5e-05, as Python writes it, as text: in YAML 1.1 it is no number.
    """
    if (not isinstance(change.value, str) or not node.has_parameter(change.name)
            or isinstance(node.get_parameter(change.name).value, str)):
        return change
    try:
        value = parse_yaml(change.value)
    except ValueError:
        return change
    items = value if isinstance(value, list) else [value]
    if not all(isinstance(item, float) for item in items):
        return change
    return Parameter(change.name, value=value)


def is_unchanged(node: Node, change: Parameter[Any]) -> bool:
    """Return whether ``change`` sets a parameter that cannot be changed to the value it has."""
    if not (node.has_parameter(change.name)
            and node.describe_parameter(change.name).read_only):
        return False
    old, new = _plain(node.get_parameter(change.name).value), _plain(change.value)
    return bool(old == new or str(old) == str(new) == 'nan')  # ros2 param load gives a string


def descriptor(spec: Spec) -> ParameterDescriptor:
    """Return the ROS descriptor of ``spec``, for parameter tools."""
    unit = '' if spec.unit == '-' else f' [{spec.unit}]'
    described = ParameterDescriptor(
        name=spec.name, description=spec.meaning + unit, read_only=not spec.live,
        dynamic_typing=True,  # integers are accepted for floats; ``Spec.check`` decides
        additional_constraints=_constraints(spec))
    if spec.kind == 'float' and not spec.nan:  # the range of ROS excludes NaN
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


class ParameterCollector:
    """
    Parameters of the nodes in the namespace of ``node``, by node name.

    If there are none in this namespace, those of the only other namespace that has some. Call
    ``poll`` periodically. A node that has ended keeps its entry, one that starts again replaces
    it; parameters that change later are taken from ``/parameter_events``.
    """

    def __init__(self, node: Node) -> None:
        self.values: dict[str, Values] = {}
        self._node = node
        self._namespace = node.get_namespace()
        self._queries: dict[str, _Query] = {}  # of the nodes that exist
        node.create_subscription(ParameterEvent, '/parameter_events', self._on_event,
                                 qos_profile_parameter_events)

    def poll(self) -> None:
        """Look for nodes and continue the queries of their parameters."""
        present = self._present()
        for name in self._queries.keys() - present:
            self._queries.pop(name).close()
        for name in sorted(present):
            query = self._queries.get(name)
            if query is None or query.expired():
                if query is not None:
                    query.close()
                query = self._queries[name] = _Query(self._node, self._namespace, name)
            if (values := query.step()) is not None:
                self.values[name] = values

    def _present(self) -> set[str]:
        nodes = [(name, space) for name, space in self._node.get_node_names_and_namespaces()
                 if name in NODE_PARAMS]
        spaces, own = {space for _, space in nodes}, self._node.get_namespace()
        chosen = own if own in spaces or len(spaces) != 1 else next(iter(spaces))
        if chosen != self._namespace and nodes:
            for query in self._queries.values():
                query.close()
            self._namespace, self._queries, self.values = chosen, {}, {}
        return {name for name, space in nodes if space == self._namespace}

    def _on_event(self, event: ParameterEvent) -> None:
        space, _, name = event.node.rpartition('/')
        if (space or '/') != self._namespace or name not in self.values:
            return  # the values are still to be read
        changed = (*event.new_parameters, *event.changed_parameters)
        self.values[name] = {**self.values[name], **_own(
            name, {item.name: item.value for item in changed})}


class _Query:
    """Reads all parameters of a node by its standard services, step by step."""

    def __init__(self, node: Node, namespace: str, name: str) -> None:
        self._node, self._name = node, name
        self._since_ns, self._done = time.monotonic_ns(), False
        prefix = f'{namespace.rstrip("/")}/{name}'
        self._list = node.create_client(ListParameters, f'{prefix}/list_parameters')
        self._get = node.create_client(GetParameters, f'{prefix}/get_parameters')
        self._names: Any = None   # future of the names
        self._values: Any = None  # future of the values

    def step(self) -> Values | None:
        """Continue; return the parameters once, when all have been received."""
        if self._done:
            return None
        if self._names is None:
            if self._list.service_is_ready():
                self._names = self._list.call_async(ListParameters.Request())
        elif self._values is None:
            if self._names.done() and self._get.service_is_ready():
                self._values = self._get.call_async(
                    GetParameters.Request(names=self._names.result().result.names))
        elif self._values.done():
            self._done = True
            return _own(self._name, dict(zip(self._names.result().result.names,
                                             self._values.result().values)))
        return None

    def expired(self) -> bool:
        """Return whether the node has not answered in time."""
        return not self._done and time.monotonic_ns() - self._since_ns > QUERY_TIMEOUT_NS

    def close(self) -> None:
        """Destroy the clients."""
        self._node.destroy_client(self._list)
        self._node.destroy_client(self._get)


def _own(node: str, values: Mapping[str, Any]) -> Values:
    """Return the values (ParameterValue) of parameters that are declared in this package."""
    known = known_names([NODE_PARAMS[node]])
    return {name: _plain(parameter_value_to_python(value)) for name, value in values.items()
            if is_known(name, known)}


def _plain(value: Any) -> Any:
    """Return ``value`` as YAML types; an empty list has no type in ROS and arrives as None."""
    if value is None or isinstance(value, (str, bool, int, float)):
        return [] if value is None else value
    return list(value)
