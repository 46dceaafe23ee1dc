# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Differences between ROS distributions, and access to what rclpy does not export."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
import os
import re
import sys
from typing import Any, cast

from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from smart_tire.control.publishers import MessageInfo, UNDISCOVERED
from smart_tire.parameters.files import from_arguments

# not exported by rclpy:
RCLError: type[RuntimeError] = rclpy_implementation.RCLError  # of ``publish``
RMWError: type[RuntimeError] = rclpy_implementation.RMWError  # of ``deserialize_message``
UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'  # rcl, of an endpoint before its node
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
PROFILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')


def new_executor() -> Any:
    """
    Return a single-threaded executor.

    This is rclpy's EventsExecutor where it exists (Kilted and later): it needs a third of the
    time per message, since it builds no wait sets. Its ``spin`` waits in C++ and does not notice
    signals, so call ``spin_once`` with a time-out.
    """
    try:
        experimental = import_module('rclpy.experimental')
    except ModuleNotFoundError:
        return SingleThreadedExecutor()
    return experimental.EventsExecutor()


@contextmanager
def shared_memory(*, images: bool) -> Iterator[None]:
    """
    Let Fast DDS use shared memory for ``images`` only, by the first node created in this context.

    A process that is killed while it has the lock of a shared memory port of Fast DDS (3.2,
    ``regenerate_port``) blocks for ever whoever publishes to this port, and Python with it. The
    choice of a user in the environment remains.
    """
    if images or any(name in os.environ for name in (TRANSPORTS, *PROFILES)):
        yield
        return
    os.environ[TRANSPORTS] = 'UDPv4'
    try:
        yield
    finally:
        del os.environ[TRANSPORTS]  # processes that this one starts may send images


def message_class(type_name: str) -> type[Any]:
    """Return the class of a message, service or action type such as ``sensor_msgs/msg/Imu``."""
    package, kind, name = type_name.split('/')
    return cast('type[Any]', getattr(import_module(f'{package}.{kind}'), name))


def message_info(given: Mapping[str, Any]) -> MessageInfo:
    """
    Return the record of what rclpy gives with a message.

    rclpy of Jazzy does not identify the publisher; Cyclone DDS does not number messages.
    """
    publisher = given.get('publisher_gid')
    return MessageInfo(given['source_timestamp'], given['received_timestamp'],
                       given.get('publication_sequence_number'),
                       None if publisher is None else bytes(publisher['data']))


def has_matched(node: Node, topic: str) -> bool:
    """
    Return whether the subscription of ``node`` to ``topic`` has matched all publishers.

    Uses the matched count of the subscription (Kilted and later), otherwise the ROS graph.
    """
    publishers = node.count_publishers(topic)
    counts = [subscription.get_publisher_count() for subscription in node.subscriptions
              if subscription.topic_name == topic and hasattr(subscription, 'get_publisher_count')]
    return publishers > 0 and all(count >= publishers for count in counts)


def installed_class(type_name: str) -> type[Any] | None:
    """Return the class of a message or action type; None if it is not installed."""
    try:
        return message_class(type_name)
    except (ModuleNotFoundError, AttributeError):  # in a checkout, folders are empty packages
        return None


def given_parameters(node: Node) -> dict[str, Any]:
    """
    Return the parameters set for ``node`` by arguments and files, whether declared or not.

    The only access to a private attribute of rclpy. It is needed to refuse unknown names: rclpy
    ignores parameters that a node does not declare, and its public alternative,
    ``automatically_declare_parameters_from_overrides``, fails on an empty list without naming it.
    Values on the command line are read again, because rcl does not let later ones win
    (``from_arguments``); those of other sources, such as ``rclpy.init(args=...)``, remain.
    """
    given = {name: item.value for name, item in node._parameter_overrides.items()}
    return given | from_arguments(sys.argv, node.get_fully_qualified_name())


def publisher_names(node: Node, topic: str) -> dict[Hashable, str]:
    """Return endpoint identifier -> fully qualified node name of the publishers of ``topic``."""
    return {bytes(info.endpoint_gid): full_name(info)
            for info in node.get_publishers_info_by_topic(topic)}


def action_servers(node: Node, action: str) -> list[str]:
    """Return the fully qualified names of the nodes that serve ``action``."""
    return sorted({full_name(info) for info in
                   node.get_publishers_info_by_topic(f'{action}/_action/feedback')})


def full_name(info: Any) -> str:
    """Return the fully qualified node name of an endpoint in the graph."""
    if info.node_name == UNKNOWN_NODE:
        return UNDISCOVERED
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def node_names(node: Node) -> list[str]:
    """Return the fully qualified names of all other nodes, as often as there are nodes."""
    return sorted(f'{space.rstrip("/")}/{name}'
                  for name, space in node.get_node_names_and_namespaces()
                  if name not in (node.get_name(), UNKNOWN_NODE))


def plain_message(error: Exception) -> str:
    """Return the message of an rcl error without locations in the sources of rcl."""
    text = re.sub(r', at [^ ,]+:\d+', '', str(error)).removeprefix('failed to initialize rcl: ')
    return re.sub(r'^\[(.*)\]$', r'unknown \1', text)  # rcl lists arguments that it cannot parse


def wrong_type_message(error: Exception) -> str:
    """Return the message of rclpy for a wrong parameter type in the style of this package."""
    text = str(error)
    found = re.search(r"parameter '(.+?)' to '(.*)' of type .+, expecting type '(\w+)'", text)
    if found is None:
        return text
    name, value, kind = found.groups()
    return f'parameter {name}: {value!r}, expected a {kind.lower()}'
