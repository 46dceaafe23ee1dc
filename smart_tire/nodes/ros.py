"""What differs between ROS distributions, or reaches below the public API of rclpy."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
import re
import sys
from typing import Any, cast

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from smart_tire.parameters.files import from_arguments

ROS_ARGS, END_OF_ROS_ARGS = '--ros-args', '--'  # on a command line


def new_executor() -> Any:
    """
    Return an executor for one thread.

    Where it exists (Kilted and later), the one that is told of events instead of building a wait
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
