"""What differs between ROS distributions, or reaches below the public API of rclpy."""

from __future__ import annotations

from importlib import import_module
import re
import sys
from typing import Any, cast

from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from smart_tire.parameters.files import from_arguments

RCLError: type[RuntimeError] = rclpy_implementation.RCLError  # ``publish`` raises it; not exported


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
    return re.sub(r', at [^ ,]+:\d+', '', str(error)).removeprefix('failed to initialize rcl: ')
