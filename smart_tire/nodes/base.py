# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Base class of all nodes: parameters, topics, diagnostics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import inspect
import sys
import traceback
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.time import Time

from smart_tire.control.command_check import NO_CLOCK
from smart_tire.control.publishers import MessageInfo
from smart_tire.drivers.clock import SYSTEM
from smart_tire.errors import MessageError, ParameterError, SmartTireError
from smart_tire.host_load import HostLoad, TimerLateness
from smart_tire.messages import (
    FIELDS, LayoutDecoder, LayoutEncoder, OtherJointsError, TOPICS, TYPED)
from smart_tire.nodes.compat import (
    full_name, installed_class, message_class, message_info, plain_message, RCLError, RMWError,
    wrong_type_message)
from smart_tire.nodes.diagnostics import (
    CHECK_PERIOD, diagnostic_array, InputCounter, InputLog, SILENCE_NS, Status)
from smart_tire.nodes.hand_over import Exchange, Inbox, Mailbox
from smart_tire.nodes.kept_messages import CHECK_PERIOD as KEPT_PERIOD, KeptMessages
from smart_tire.nodes.parameters import declare, is_unchanged, read, with_number
from smart_tire.nodes.qos import latched, publisher_qos, subscriber_qos, volatile_qos
from smart_tire.nodes.timers import LoopTimer, paced, Timers
from smart_tire.parameters import build, NODE_PARAMS
from smart_tire.parameters.files import files_of, misspelled
from smart_tire.samples import NS_PER_S
from std_msgs.msg import Bool

Params = TypeVar('Params')
DIAGNOSTICS_PERIOD = 1.0  # s, docs/topics.md
MAX_INPUT_AGE = SILENCE_NS / NS_PER_S  # s without a message on a required input
STATE_DEPTH = 10  # queued states of the motor driver, so that a short stop is not missed


@dataclass(frozen=True, kw_only=True)
class NoParams:
    """Of a node without ROS parameters."""


class SmartTireNode(Node, Generic[Params]):
    """
    A node with described parameters, counted inputs and diagnostics.

    A subclass opens its ports and threads in ``start`` and closes them in ``stop``, reports its
    state in ``fill_status``, and applies changed parameters in ``on_parameters_changed``.

    Publishes ``/diagnostics`` once a second. Parameters: the fields of ``params_class``.
    """

    hardware_id = ''
    # A simulated time passes ``pace_lag_ns`` beyond the time when this node should handle the next
    # message of its periodic input ``paced_by``, and with ``paced_timers`` a little beyond that of
    # its next timer.
    paced_by, pace_lag_ns = '', 0
    paced_timers = False
    exchange: Exchange | None = None  # of the nodes in this process, if there are several

    def __init__(self, name: str, params_class: type[Params]) -> None:
        try:
            super().__init__(name)
        except InvalidParameterTypeException as error:  # use_sim_time, declared by rclpy
            raise ParameterError(wrong_type_message(error)) from error
        self.params: Params = declare(self, params_class)
        for file in files_of(sys.argv):
            for near, text in misspelled(file, NODE_PARAMS):
                if near == name:  # one node warns, not each that gets the file
                    self.get_logger().warning(text)
        self.inputs: dict[str, InputCounter] = {}
        self.outputs: dict[str, InputCounter] = {}
        self._types: dict[str, str] = {}        # of the inputs
        self._defects: set[str] = set()         # inputs and errors that were logged
        self._unreceived_from: dict[str, str] = {}  # input -> warning of publishers
        self.mailbox = Mailbox(self)
        self._counts: dict[str, int] = {}  # in the latest diagnostics
        self._params_class = params_class
        self.loop_timers = Timers(self.steady_ns)
        self._publish_diagnostics = self.make_guarded_publisher(
            DiagnosticArray, '/diagnostics', publisher_qos('/diagnostics'))
        self.call_every(DIAGNOSTICS_PERIOD, self._on_diagnostics_timer)
        self.input_log = InputLog(self.get_logger(), self.steady_ns)
        self._timer_lateness = TimerLateness(CHECK_PERIOD)
        self.call_every(CHECK_PERIOD, self._check, wakes=False)
        self.add_on_set_parameters_callback(self._on_set_parameters)

    def _check(self) -> None:
        self._timer_lateness.check(self.steady_ns() / NS_PER_S)
        self.input_log.check()

    def start(self) -> None:
        """Open ports and start threads; called once after construction."""

    def stop(self) -> None:
        """Undo ``start``; called before the node is destroyed."""

    def fill_status(self, status: Status) -> None:
        """Add the counts, warnings and errors of this node to ``status``."""

    def on_parameters_changed(self) -> None:
        """Apply ``self.params`` after a parameter was changed at run time."""

    def set_parameters_atomically(
            self, parameter_list: list[Parameter[Any]]) -> SetParametersResult:
        """
        Set parameters, all or none; those that cannot be changed may be set to their value.

        So ``ros2 param load`` accepts what ``ros2 param dump`` has written.
        """
        changes = [item for given in parameter_list
                   if not is_unchanged(self, item := with_number(self, given))]
        if parameter_list and not changes:
            return SetParametersResult(successful=True)
        return super().set_parameters_atomically(changes)

    def call_every(self, period: float, callback: Callable[[], None], *, wakes: bool = True,
                   elastic: bool = False) -> LoopTimer:
        """
        Call ``callback`` every ``period`` [s] of the steady clock; return the timer.

        To wake up costs more than most callbacks. One that is not to wake the node (``wakes``) is
        called at most so often, after a message or another timer; one that is ``elastic`` at least
        so often, earlier if the node is awake in the second half of the period.
        """
        timers = self.loop_timers
        if SYSTEM.simulated is not None and self.paced_timers and timers.participant is None:
            timers.participant = SYSTEM.simulated.join(self.get_name())
        return timers.add(period, callback, wakes=wakes, elastic=elastic)

    def now_ns(self) -> int:
        """Return the time for message stamps [ns]: ROS time, simulated with ``use_sim_time``."""
        clock = self.get_clock()
        if SYSTEM.simulated is None and clock.ros_time_is_active:
            return int(clock.now().nanoseconds)
        return SYSTEM.time_ns()  # messages on /clock have a period

    def steady_ns(self) -> int:
        """Return the steady time [ns], for time-outs and ages."""
        return SYSTEM.now_ns()

    def subscribe(self, topic_name: str, on_sample: Callable[..., None], *,
                  name: str | None = None, wheels: int = 1, reliability: str = 'reliable',
                  required: bool = False, announced: bool = False, info: bool = False,
                  from_msg: Callable[[Any], Any] | None = None,
                  type_name: str | None = None, profile: QoSProfile | None = None,
                  kept: bool = False, raw: bool = False,
                  urgent: bool = True) -> Subscription[Any] | Inbox:
        """
        Subscribe to a topic of ``TOPICS``; call ``on_sample`` with each valid sample.

        Invalid messages are counted and logged, those of other joints ignored. ``name`` replaces
        the topic's name, ``from_msg`` its conversion, ``type_name`` its type. With ``info``,
        ``on_sample`` also gets its MessageInfo. No message for ``MAX_INPUT_AGE`` on a
        ``required`` topic is a warning. The first message on a required or ``announced`` topic
        is logged. ``profile`` replaces that of ``subscriber_qos``. With ``kept``, messages of all
        publishers are received, with info, also those from before the subscription that a
        publisher keeps. With ``raw``, ``from_msg`` gets the serialized message.
        Messages of a publisher in this process are handed over without DDS, except with ``info``
        or ``kept``; those that are not ``urgent`` do not wake the node. Returns the subscription.
        """
        topic, name = TOPICS[topic_name], name or topic_name
        counter = InputCounter(required=required)
        self.inputs[name], self._types[name] = counter, type_name or topic.type
        cls, convert = message_class(self._types[name]), from_msg or topic.from_msg
        if not raw:
            raw, convert = _from_bytes(self._types[name], cls, convert)
        if required or announced:
            self.input_log.watch(name, lambda: counter.ok, required=required)

        if name == self.paced_by and SYSTEM.simulated is not None:
            on_sample = paced(
                on_sample, SYSTEM.simulated.join(self.get_name()), self.pace_lag_ns)

        def on_message(msg: Any) -> None:
            self.guarded(name, counter, lambda: on_sample(convert(msg)))

        def on_message_with_info(msg: Any, info: MessageInfo) -> None:  # rclpy counts arguments
            self.guarded(name, counter, lambda: on_sample(convert(msg), info))

        profile = profile or subscriber_qos(topic_name, wheels=wheels, reliability=reliability)
        if kept:
            return self._subscribe_kept(cls, name, on_message_with_info, raw)
        if info:
            return self.create_subscription(
                cls, name, with_info(on_message_with_info), profile, raw=raw)
        callback = self.wrap_callback(name, on_message)
        if raw and self.exchange is not None and (
                route := self.exchange.published(self.resolve_topic_name(name))):
            return self.mailbox.add(name, route, callback, profile.depth, urgent=urgent)
        return self.create_subscription(cls, name, callback, profile, raw=raw)

    def unsubscribe(self, name: str, subscription: Subscription[Any] | Inbox) -> None:
        """End the ``subscription`` to ``name`` and forget the input."""
        if isinstance(subscription, Inbox):
            self.mailbox.remove(name)
        else:
            self.destroy_subscription(subscription)
        del self.inputs[name]

    def guarded(self, name: str, counter: InputCounter, action: Callable[[], object]) -> None:
        """Handle a message of the input ``name`` by ``action``; no error of it ends the node."""
        try:
            action()
        except OtherJointsError as error:
            if not counter.ok:  # the wheels may be in other messages of this topic
                self.reject_input(name, counter, error)
        except SmartTireError as error:
            self.reject_input(name, counter, error)
        except Exception as error:  # noqa: BLE001 - a defect here, found by what others send
            self._report_defect(name, error)
            self.reject_input(name, counter, MessageError(
                f'{name}: {type(error).__name__}: {(str(error).splitlines() or [""])[0]}'))
            self.recover()
        else:
            counter.accept(self.steady_ns())

    def _report_defect(self, name: str, error: Exception) -> None:
        """Log where an error of this package has occurred, once per kind and input."""
        kind = f'{name}: {type(error).__name__}'
        if kind not in self._defects:
            self._defects.add(kind)
            self.get_logger().error(f'{kind} in this node; please report it:\n'
                                    + ''.join(traceback.format_exception(error)))

    def recover(self) -> None:
        """Return to a defined state after an unforeseen error; a subclass may need to."""

    def subscribe_state(self, name: str, on_state: Callable[[bool], None]) -> None:
        """Subscribe to a state of the motor driver; call ``on_state`` with each, also the last."""
        profile = latched()
        profile.depth = STATE_DEPTH
        self.create_subscription(Bool, name, lambda state: on_state(bool(state.data)), profile)

    def _subscribe_kept(self, cls: type[Any], name: str, callback: Callable[[Any, Any], None],
                        raw: bool) -> Subscription[Any]:
        """Subscribe to the messages of all publishers, and to those that some of them keep."""
        silent = SubscriptionEventCallbacks(use_default_callbacks=False)  # for volatile publishers
        kept = KeptMessages(self, name, callback, lambda on_kept: self.create_subscription(
            cls, name, with_info(on_kept), latched(), event_callbacks=silent, raw=raw))

        def check(*_: object) -> None:
            kept.check(self.steady_ns())

        self.call_every(KEPT_PERIOD, check, wakes=False)
        return self.create_subscription(
            cls, name, with_info(kept.on_message), volatile_qos(name), raw=raw,
            event_callbacks=SubscriptionEventCallbacks(matched=check))  # of a publisher

    def wrap_callback(self, name: str,
                      on_message: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return the callback of the subscription to ``name``; a subclass may defer it."""
        return on_message

    def reject_input(self, name: str, counter: InputCounter, error: Exception) -> None:
        """Count and log an invalid message; a subclass may also react."""
        if counter.reject(str(error)):
            reason = counter.latest.removeprefix(f'{name}: ')
            self.get_logger().warning(f'{name}: {counter.bad} messages rejected, latest: {reason}')

    def make_publisher(self, name: str, *, rate: float = 0.0, wheels: int = 1,
                       to_msg: Callable[[Any, Any], Any] | None = None) -> Callable[[Any], None]:
        """
        Return a function that publishes a sample on the topic ``name`` of ``TOPICS``.

        It also publishes on the typed topic with the same samples. The function reuses one
        message, so call it from one thread only. ``rate`` [Hz] and ``wheels`` set the depth of
        the queue, see ``publisher_qos``; ``to_msg`` may differ from that of ``TOPICS``.
        """
        publish = self._make_publisher(name, rate, wheels, to_msg)
        typed = TYPED.get(name)
        if typed is None or typed.sample is not TOPICS[name].sample:
            return publish
        publish_typed = self.make_typed_publisher(name)

        def publish_both(sample: Any) -> None:
            publish(sample)
            publish_typed(sample)

        return publish_both

    def make_typed_publisher(self, name: str, *, wheels: int = 1) -> Callable[[Any], None]:
        """
        Return a function that publishes a sample on the typed topic of ``name``.

        It does nothing without subscribers, and if smart_tire_msgs is not installed.
        """
        topic = TYPED[name]
        cls = installed_class(topic.type)
        if cls is None:
            return lambda sample: None
        profile = publisher_qos(topic.name, wheels=wheels)
        publisher = self.create_publisher(cls, topic.name, profile)
        publish = self._guarded(publisher.publish, topic.name)
        msg, to_msg = cls(), self.in_frames(topic.to_msg)

        def publish_if_subscribed(sample: Any) -> None:
            if publisher.get_subscription_count():
                publish(to_msg(msg, sample))

        return publish_if_subscribed

    def _make_publisher(self, name: str, rate: float, wheels: int,
                        to_msg: Callable[[Any, Any], Any] | None) -> Callable[[Any], None]:
        topic = TOPICS[name]
        cls = message_class(topic.type)
        publish = self.make_guarded_publisher(
            cls, name, publisher_qos(name, rate=rate, wheels=wheels))
        to_msg = self.in_frames(to_msg or topic.to_msg)
        if topic.type not in FIELDS:
            msg = cls()
            return lambda sample: publish(to_msg(msg, sample))
        encode = LayoutEncoder(topic.type)
        if self.exchange is None:
            return lambda sample: publish(encode(to_msg(encode.msg, sample)))
        route = self.exchange.publish(
            self.resolve_topic_name(name), self.get_fully_qualified_name())

        def publish_directly(sample: Any) -> None:
            data = encode(to_msg(encode.msg, sample))
            route.hand_over(data)
            publish(data)

        return publish_directly

    def in_frames(self, to_msg: Callable[..., Any]) -> Callable[..., Any]:
        """Return ``to_msg``, with the frames of this robot if they have other names."""
        params: Any = self.params
        frames: dict[str, str] = params.robot.frames
        if all(name == frame for name, frame in frames.items()):
            return to_msg

        def renamed(*args: Any) -> Any:
            msg = to_msg(*args)
            msg.header.frame_id = frames.get(msg.header.frame_id, msg.header.frame_id)
            if child := getattr(msg, 'child_frame_id', ''):
                msg.child_frame_id = frames.get(child, child)
            return msg

        return renamed

    def make_guarded_publisher(self, cls: type[Any], name: str,
                               profile: QoSProfile) -> Callable[[Any], None]:
        """
        Return a function that publishes a message on the topic ``name``.

        A message that ROS fails to publish is counted and logged; the caller continues.
        """
        return self._guarded(self.create_publisher(cls, name, profile).publish, name)

    def _guarded(self, publish: Callable[[Any], None], name: str) -> Callable[[Any], None]:
        self.outputs[name] = InputCounter()

        def guarded(msg: Any) -> None:
            try:
                publish(msg)
            except RCLError as error:
                self._on_publish_error(name, error)

        return guarded

    def _on_publish_error(self, name: str, error: RuntimeError) -> None:
        counter = self.outputs[name]
        if counter.reject():
            self.get_logger().error(f'{counter.bad} messages on {name} not published, latest: '
                                    f'{plain_message(error)}')

    @property
    def host_load(self) -> HostLoad:
        """Return the load of the host and the lateness of the timers of this node until now."""
        self._timer_lateness.check(self.steady_ns() / NS_PER_S)
        return self._timer_lateness.load

    def status(self) -> Status:
        """Return the diagnostic status: counts and ages of inputs, then those of the subclass."""
        status = Status(counts=self._counts)
        self._fill_inputs(status)
        if not self.now_ns():  # rclpy declares use_sim_time
            status.warn(NO_CLOCK)
        status.host = self.host_load
        status.values.update(status.host.values)
        status.values['publish_errors'] = sum(counter.bad for counter in self.outputs.values())
        for name, counter in self.outputs.items():
            if new := status.new(f'publish {name}', counter.bad):
                status.error(f'{new} messages on {name} not published')
        self.fill_status(status)
        return status

    def _fill_inputs(self, status: Status) -> None:
        now_ns = self.steady_ns()
        status.values['frames_ok'] = sum(counter.ok for counter in self.inputs.values())
        status.values['frames_bad'] = sum(counter.bad for counter in self.inputs.values())
        ages = {name: counter.age(now_ns) for name, counter in self.inputs.items()}
        if ages:
            status.values['last_message_age'] = min(ages.values())
        for name, counter in self.inputs.items():
            status.values[f'{name}.last_message_age'] = ages[name]
            if new := status.new(name, counter.bad):
                status.warn(f'{new} messages on {name} rejected, latest: {counter.latest}')
            if ages[name] > MAX_INPUT_AGE and counter.required:
                status.warn(f'no {name}')
            if name in self._types and (text := self._unreceived(name, ages[name])):
                status.warn(text)
        inboxes = self.mailbox.inboxes.values()
        if inboxes:
            status.values['messages_lost'] = lost = sum(inbox.lost for inbox in inboxes)
            if new := status.new('messages lost', lost):
                status.warn(f'{new} messages lost: this node is too slow', by_host=True)

    def _unreceived(self, name: str, age: float) -> str:
        """
        Return a warning if nodes publish on an input what this node does not receive.

        That is another type, which DDS does not match, or what a node of this process publishes.
        """
        inbox, other, expected = self.mailbox.inboxes.get(name), set(), self._types[name]
        if inbox is not None:
            own = inbox.route.publishers
            expected = f'{", ".join(sorted(own))} only, in the same process'
            if self.count_publishers(name) > len(own):
                other = {*map(full_name, self.get_publishers_info_by_topic(name))} - own
        elif age > MAX_INPUT_AGE:
            other = {f'{info.topic_type} of {full_name(info)}'
                     for info in self.get_publishers_info_by_topic(name)
                     if info.topic_type != expected}
        text = f'{name}: {", ".join(sorted(other))} not received, expected {expected}' \
            if other else ''
        if text and text != self._unreceived_from.get(name):
            self.get_logger().warning(text)
        self._unreceived_from[name] = text
        return text

    def _on_diagnostics_timer(self) -> None:
        name = self.get_fully_qualified_name().lstrip('/')  # distinguishes robots in namespaces
        status = self.status().message(name, self.hardware_id)
        self._publish_diagnostics(diagnostic_array(
            Time(nanoseconds=self.now_ns()).to_msg(), status))

    def _on_set_parameters(self, changes: list[Parameter[Any]]) -> SetParametersResult:
        try:
            self.params = build(self._params_class, read(self, self._params_class, changes))
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.on_parameters_changed()
        return SetParametersResult(successful=True)


def _from_bytes(type_name: str, cls: type[Any], from_msg: Callable[[Any], Any]
                ) -> tuple[bool, Callable[[Any], Any]]:
    """
    Return whether messages are to be received serialized, and the conversion of what is received.

    rclpy needs several times as long to deserialize a message as ``LayoutDecoder``.
    """
    if type_name not in FIELDS:
        return False, from_msg

    def with_rclpy(data: bytes) -> Any:
        try:
            return deserialize_message(data, cls)
        except RMWError as error:
            raise MessageError(f'{type_name}: {plain_message(error)}') from error

    read = LayoutDecoder(type_name, with_rclpy)
    return True, lambda data: from_msg(read(data))


def with_info(callback: Callable[[Any, MessageInfo], None]) -> Callable[..., None]:
    """
    Return a subscription callback that calls ``callback`` with the message and its info.

    The events executor passes both as one tuple, other executors as two arguments. rclpy decides
    by the signature whether a callback takes both.
    """
    def adapter(*given: Any) -> None:
        msg, info = given if len(given) == 2 else given[0]
        callback(msg, message_info(info))

    adapter.__signature__ = inspect.signature(callback)  # type: ignore[attr-defined]
    return adapter
