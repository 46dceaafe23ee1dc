"""What all nodes share: parameters, topics, diagnostics, and a clean end."""

from __future__ import annotations

from collections.abc import Callable
import signal
import sys
import threading
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer

from smart_tire.errors import ParameterError, SmartTireError
from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import (
    foreign_arguments, message_class, new_executor, plain, RCLError, with_info, wrong_type)
from smart_tire.nodes.diagnostics import diagnostic_array, InputCounter, Status
from smart_tire.nodes.parameters import declare
from smart_tire.nodes.qos import publisher_qos, subscriber_qos
from smart_tire.parameters import build, specs

Params = TypeVar('Params')
DIAGNOSTICS_PERIOD = 1.0  # s, INTERFACES
SILENCE = 2.0             # s after which an input that should flow is worth a warning
POLL = 0.1                # s, how long a signal may wait to be seen
EXIT_OK, EXIT_DEFECT, EXIT_REFUSED = 0, 1, 2


class SmartTireNode(Node, Generic[Params]):
    """
    A node with described parameters, counted inputs and diagnostics.

    A subclass opens its ports and threads in ``start`` and ends them in ``stop``, says how it
    is in ``fill_status``, and takes new values of live parameters in ``retune``.
    """

    hardware_id = ''

    def __init__(self, name: str, params_class: type[Params]) -> None:
        try:
            super().__init__(name)
        except InvalidParameterTypeException as error:  # use_sim_time, which every node has
            raise ParameterError(wrong_type(error)) from error
        self.params: Params = declare(self, params_class)
        self.inputs: dict[str, InputCounter] = {}
        self.outputs: dict[str, InputCounter] = {}
        self._params_class = params_class
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnostics = self.guarded_publisher(
            DiagnosticArray, '/diagnostics', publisher_qos('/diagnostics'))
        self.every(DIAGNOSTICS_PERIOD, self._report)
        self.add_on_set_parameters_callback(self._on_set_parameters)

    def start(self) -> None:
        """Begin work, when all is set up."""

    def stop(self) -> None:
        """End what ``start`` began, before the node is destroyed."""

    def fill_status(self, status: Status) -> None:
        """Add this node's own counts and complaints."""

    def retune(self) -> None:
        """Use ``self.params``, of which live ones have changed."""

    def every(self, period: float, callback: Callable[[], None]) -> Timer:
        """Call back each ``period`` [s] of the steady clock, which no /clock or NTP can move."""
        return self.create_timer(period, callback, clock=self._steady)

    def now_ns(self) -> int:
        """Return the time for stamps [ns]; simulated time where ``use_sim_time`` says so."""
        return int(self.get_clock().now().nanoseconds)

    def steady_ns(self) -> int:
        """Return the time for time-outs and ages [ns]."""
        return int(self._steady.now().nanoseconds)

    def subscribe(self, topic_name: str, handle: Callable[..., None], *, name: str | None = None,
                  wheels: int = 1, reliability: str = 'reliable', required: bool = False,
                  info: bool = False) -> None:
        """
        Give each sample of a topic of the contract to ``handle``; count and survive bad ones.

        ``name`` is where it is published, if elsewhere. ``info`` adds rclpy's message info to the
        arguments. The silence of a ``required`` topic is worth a warning.
        """
        topic, name = TOPICS[topic_name], name or topic_name
        tally = InputCounter(required=required)
        self.inputs[name] = tally

        def take(msg: Any, *info: Any) -> None:
            try:
                handle(topic.decode(msg), *info)
            except SmartTireError as error:
                self.reject(tally, error)
            else:
                tally.good(self.steady_ns())

        def on_message(msg: Any) -> None:
            take(msg)

        def take_with_info(msg: Any, message_info: Any) -> None:  # rclpy counts the arguments
            take(msg, message_info)

        callback = with_info(take_with_info) if info else self.intake(name, on_message)
        self.create_subscription(
            message_class(topic.type), name, callback,
            subscriber_qos(topic_name, wheels=wheels, reliability=reliability))

    def intake(self, name: str, handle: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return what the subscription to ``name`` calls; it may call ``handle`` later."""
        return handle

    def reject(self, tally: InputCounter, error: Exception) -> None:
        """Count a bad input and log the 1st, 2nd, 4th, 8th ... of its stream."""
        if tally.fail(str(error)):
            self.get_logger().warning(f'{tally.bad} rejected, latest: {error}')

    def advertise(self, name: str, *, rate: float = 0.0,
                  wheels: int = 1) -> Callable[[Any], None]:
        """
        Return a function that publishes a sample on the topic ``name``.

        It uses one message over and over, so call it from one thread only.
        """
        topic = TOPICS[name]
        cls = message_class(topic.type)
        send = self.guarded_publisher(cls, name, publisher_qos(name, rate=rate, wheels=wheels))
        msg, fill = cls(), topic.fill
        return lambda sample: send(fill(msg, sample))

    def guarded_publisher(self, cls: type[Any], name: str,
                          profile: QoSProfile) -> Callable[[Any], None]:
        """
        Return a function that publishes a message on the topic ``name``.

        A message that ROS refuses to publish is counted and reported; the caller goes on.
        """
        publisher = self.create_publisher(cls, name, profile)
        self.outputs[name] = InputCounter()

        def publish(msg: Any) -> None:
            try:
                publisher.publish(msg)
            except RCLError as error:
                self._not_published(name, error)

        return publish

    def _not_published(self, name: str, error: RuntimeError) -> None:
        tally = self.outputs[name]
        if tally.fail():
            self.get_logger().error(
                f'{tally.bad} messages on {name} not published, latest: {plain(error)}')

    def status(self) -> Status:
        """Return how the node is: its inputs' counts and ages, then what it adds itself."""
        status, now_ns = Status(), self.steady_ns()
        status.values['frames_ok'] = sum(tally.ok for tally in self.inputs.values())
        status.values['frames_bad'] = sum(tally.bad for tally in self.inputs.values())
        ages = {name: tally.age(now_ns) for name, tally in self.inputs.items()}
        if ages:
            status.values['last_message_age'] = min(ages.values())
        for name, tally in self.inputs.items():
            status.values[f'{name}.last_message_age'] = ages[name]
            if new := tally.newly_bad():
                status.warn(f'{new} bad on {name}, latest: {tally.latest}')
            if tally.required and ages[name] > SILENCE:
                status.warn(f'no {name}')
        status.values['publish_errors'] = sum(tally.bad for tally in self.outputs.values())
        for name, tally in self.outputs.items():
            if new := tally.newly_bad():
                status.error(f'{new} messages on {name} not published')
        self.fill_status(status)
        return status

    def _report(self) -> None:
        name = self.get_fully_qualified_name().lstrip('/')  # two robots need two names
        message = self.status().message(name, self.hardware_id)
        self._diagnostics(diagnostic_array(self.get_clock().now().to_msg(), message))

    def _on_set_parameters(self, changes: list[Parameter[Any]]) -> SetParametersResult:
        described = specs(self._params_class)
        values = {name: self.get_parameter(name).value for name in described}
        values.update((change.name, change.value) for change in changes
                      if change.name in described)
        try:
            self.params = build(self._params_class, values)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.retune()
        return SetParametersResult(successful=True)


def run(node_class: Callable[[], SmartTireNode[Any]], *, own_arguments: bool = False) -> int:
    """
    Run a node until SIGINT or SIGTERM and return the exit status for ``sys.exit``.

    The handlers only raise a flag, so that neither a callback nor the clean-up is ever cut in
    two, however often the signal comes. A thread that dies of a defect takes the node with it.
    Arguments that are none of ROS are refused, unless the caller has ``own_arguments``.
    """
    stopped: list[int] = []  # exit statuses, the first one counts
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.append(EXIT_OK))
    if not own_arguments and (words := foreign_arguments(sys.argv)):
        get_logger('smart_tire').fatal(
            f'unknown arguments: {" ".join(words)} (ROS arguments come after --ros-args)')
        return EXIT_REFUSED
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # rcl: arguments or a parameter file that it can not parse
        get_logger('smart_tire').fatal(f'ROS arguments: {plain(error)}')
        return EXIT_REFUSED
    threading.excepthook = _ending(threading.excepthook, stopped)
    try:
        return _spin(node_class, stopped)
    finally:
        rclpy.try_shutdown()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)  # the interpreter's own end is not the place


def _ending(hook: Callable[[Any], Any], stopped: list[int]) -> Callable[[Any], None]:
    def report(arguments: Any) -> None:
        hook(arguments)
        stopped.append(EXIT_DEFECT)

    return report


def _spin(node_class: Callable[[], SmartTireNode[Any]], stopped: list[int]) -> int:
    try:
        node = node_class()
    except ParameterError as error:
        get_logger('smart_tire').fatal(str(error))
        return EXIT_REFUSED
    executor = new_executor()
    executor.add_node(node)
    try:
        node.start()
        while not stopped:
            executor.spin_once(timeout_sec=POLL)
    finally:
        node.stop()
        executor.remove_node(node)
        executor.shutdown()
        node.destroy_node()
    return stopped[0]
