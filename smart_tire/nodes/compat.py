"""What differs between ROS distributions, or reaches below the public API of rclpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
import inspect
import re
import sys
from typing import Any, cast

from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from smart_tire.parameters.files import from_arguments

RCLError: type[RuntimeError] = rclpy_implementation.RCLError  # ``publish`` raises it; not exported
ROS_ARGS, END_OF_ROS_ARGS = '--ros-args', '--'  # on a command line


def new_executor() -> Any:
    """
    Return an executor for one thread.

    Where it exists (Kilted and later), the one that reacts to events instead of building a wait
    set for each: a message costs a third of the time. Its ``spin`` waits in C++ and never sees a
    signal, so call ``spin_once`` with a time-out.
    """
    try:
        experimental = import_module('rclpy.experimental')
    except ModuleNotFoundError:
        return SingleThreadedExecutor()
    return experimental.EventsExecutor()


def message_class(type_name: str) -> type[Any]:
    """Return the class of a message or service type such as ``sensor_msgs/msg/Imu``."""
    package, kind, name = type_name.split('/')
    return cast('type[Any]', getattr(import_module(f'{package}.{kind}'), name))


def with_info(handle: Callable[[Any, Mapping[str, Any]], None]) -> Callable[..., None]:
    """
    Return the callback of a subscription that gives ``handle`` the message and its DDS info.

    The events executor passes both as one tuple, the others as two arguments. rclpy decides by the
    signature whether a callback wants both.
    """
    def callback(*given: Any) -> None:
        handle(*(given if len(given) == 2 else given[0]))

    callback.__signature__ = inspect.signature(handle)  # type: ignore[attr-defined]
    return callback


def has_matched(node: Node, topic: str) -> bool:
    """
    Return whether the subscription of ``node`` to ``topic`` has matched all publishers.

    As the subscriber sees it, where rclpy can say it (Kilted and later), else in the graph.
    """
    publishers = node.count_publishers(topic)
    counts = [subscription.get_publisher_count() for subscription in node.subscriptions
              if subscription.topic_name == topic and hasattr(subscription, 'get_publisher_count')]
    return publishers > 0 and all(count >= publishers for count in counts)


def transforms() -> type[Any] | None:
    """Return the class of the messages on /tf; None where tf2_msgs is not installed."""
    try:
        return message_class('tf2_msgs/msg/TFMessage')
    except ModuleNotFoundError:
        return None


def given_parameters(node: Node) -> dict[str, Any]:
    """
    Return what the command line and parameter files say for ``node``, declared or not.

    The public way, declaring them all automatically, fails on an empty list without naming it.
    """
    given = {name: given.value for name, given in node._parameter_overrides.items()}
    return given | from_arguments(sys.argv, node.get_fully_qualified_name())


def endpoint_names(node: Node, topic: str) -> dict[bytes, str]:
    """Return the identifier and the node's name of each endpoint that publishes ``topic``."""
    return {bytes(info.endpoint_gid): f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in node.get_publishers_info_by_topic(topic)}


def plain(error: Exception) -> str:
    """Return what rcl says of a failure, without the places in its own sources."""
    text = re.sub(r', at [^ ,]+:\d+', '', str(error)).removeprefix('failed to initialize rcl: ')
    return re.sub(r'^\[(.*)\]$', r'unknown \1', text)  # it lists the ones that it does not know


def wrong_type(error: Exception) -> str:
    """Return what rclpy says of a parameter of its own as this package says it of others."""
    text = str(error)
    found = re.search(r"parameter '(.+?)' to '(.*)' of type .+, expecting type '(\w+)'", text)
    if found is None:
        return text
    name, value, kind = found.groups()
    return f'parameter {name}: {value!r}, expected a {kind.lower()}'


def foreign_arguments(words: Sequence[str]) -> list[str]:
    """Return the arguments of a command line that are none of ROS; rclpy ignores most of them."""
    inside, foreign = False, []
    for word in words[1:]:
        if word in (ROS_ARGS, END_OF_ROS_ARGS):
            inside = word == ROS_ARGS
        elif not inside:
            foreign.append(word)  # also ``from:=to``, which rcl takes for an old remapping
    return foreign
