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
The output side of the robot in virtual time: motor boards, motor_driver, wheel_controller, ROS.

The product's own cores run on one event queue: the port thread of the boards is the program that
waits, everything else (timers, messages, replies of the boards, stalls) are events. Nothing waits
in real time, so a second takes some milliseconds, and a busy machine changes no result.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
import heapq
import inspect
from itertools import count
import math
import threading
from typing import Any

from smart_tire.bags.cdr import empty
from smart_tire.control.command_check import CommandCheck
from smart_tire.control.constants import TICK_PERIOD
from smart_tire.control.publishers import MessageInfo, PublisherCheck
from smart_tire.control.trajectory_control import TrajectoryControl
from smart_tire.control.wheel_loop import WheelLoop
from smart_tire.drivers.clock import Clock
from smart_tire.drivers.motor_output import MotorOutput
from smart_tire.drivers.serial_port import RETRY_DELAY
from smart_tire.errors import CommandError, SmartTireError
from smart_tire.messages import TOPICS
from smart_tire.parameters import (
    build, MotorDriverParams, TrajectoryControllerParams, WheelControllerParams)
from smart_tire.samples import (
    four, MotorCommand, NS_PER_S, VelocityCommand, WheelSample)
from support.ideal_robot import odometry, straight_path
from support.motor_boards import Faults, FREE_SPEED, MotorBoards, Record, State

START_NS = 1_000 * NS_PER_S      # steady clock at the beginning
EPOCH_NS = 1_700_000_000 * NS_PER_S  # wall clock minus steady clock
BYTE_TIME = 10 / 115_200         # s, of a byte on the line
FLOOD_PERIOD_NS = 1_000_000      # between 64 bytes of a flood
SPEED = 0.7                      # m/s, 8 rad/s at the wheels
DRIVER, CONTROLLER, FOLLOWER = 'motor_driver', 'wheel_controller', 'trajectory_controller'
COMMANDER, STRANGER = 'test', 'stranger'
RADIUS = 0.087                   # m
ODOM_PERIOD = 0.008              # s
DUTY_PERIOD_NS = 60_000_000      # between commands of a test without controller
STEP = 0.001                     # s, between checks of a condition
MAX_WAIT = 30.0                  # s, for a condition
MAX_SCRIPT_NS = 600 * NS_PER_S
VARIANCE = 1e-4                  # of odom


class Ended(Exception):  # noqa: N818
    """The end of the virtual time, or of the process whose port thread runs."""


class VirtualClock(Clock):
    """Time that advances from event to event; waiting handles the events meanwhile."""

    def __init__(self) -> None:
        self._now_ns, self._numbers = START_NS, count()
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self.end_ns = 0  # of the virtual time
        self.held_until_ns = 0  # the port thread gets no core before
        self.waits = 0          # number of times at which the port thread waited

    def now_ns(self) -> int:
        return self._now_ns

    def time_ns(self) -> int:
        return EPOCH_NS + self._now_ns

    def sleep(self, seconds: float) -> None:
        self.advance(seconds, lambda: False)

    def wait(self, event: threading.Event, seconds: float) -> bool:
        self.advance(seconds, event.is_set)
        return event.is_set()

    def at(self, time_ns: int, do: Callable[[], None]) -> None:
        """Call ``do`` at ``time_ns``; what is past is done at once."""
        heapq.heappush(self._events, (max(time_ns, self._now_ns), next(self._numbers), do))

    def advance(self, seconds: float, until: Callable[[], object]) -> None:
        """Handle events for ``seconds``, or until a condition holds; then while held."""
        self.waits += 1
        end_ns = self._now_ns + round(max(seconds, 0.0) * NS_PER_S)
        while not until() and self._step(end_ns):
            pass
        self.hold()

    def hold(self) -> None:
        """Let time pass while the port thread gets no core."""
        while self._now_ns < self.held_until_ns:
            self._step(self.held_until_ns)

    def _step(self, end_ns: int) -> bool:
        """Handle the next event, or advance to ``end_ns``; return whether there was an event."""
        if self.end_ns <= self._now_ns:
            raise Ended
        end_ns = min(end_ns, self.end_ns)
        if not self._events or self._events[0][0] > end_ns:
            self._now_ns = end_ns
            return False
        self._now_ns, _, do = heapq.heappop(self._events)
        do()
        return True


class VirtualPort:
    """The host's end of the line to the boards; ``turnaround`` [s] is the delay of each way."""

    timeout = write_timeout = 0.0

    def __init__(self, clock: VirtualClock, turnaround: float, speed: float) -> None:
        self._clock, self.turnaround = clock, turnaround
        self._received = bytearray()
        self._free_ns = 0  # the line to the host is busy until then
        self.plugged = True
        self.hold_writes_ns = 0  # a stall that begins between a decision and its first byte
        self.boards = MotorBoards(self._reply, clock.now_ns() / NS_PER_S, speed)

    @property
    def in_waiting(self) -> int:
        self._check()
        return len(self._received)

    def _check(self) -> None:
        if not self.plugged:
            raise OSError('unplugged')

    def write(self, data: bytes) -> None:
        if self.hold_writes_ns:
            held_ns, self.hold_writes_ns = self.hold_writes_ns, 0
            self._clock.held_until_ns = max(
                self._clock.held_until_ns, self._clock.now_ns() + held_ns)
            self._clock.hold()
        self._check()
        clock = self._clock
        clock.at(clock.now_ns() + self._transfer_ns(data), lambda: self._receive(data))

    def _receive(self, data: bytes) -> None:
        if self.plugged:
            self.boards.receive(data, self._clock.now_ns() / NS_PER_S)

    def _reply(self, data: bytes, delay: float) -> None:
        now_ns = self._clock.now_ns() + round(delay * NS_PER_S)
        self._free_ns = max(self._free_ns, now_ns) + self._transfer_ns(data)
        self._clock.at(self._free_ns, lambda: self._received.extend(data))

    def _transfer_ns(self, data: bytes) -> int:
        return round((self.turnaround + len(data) * BYTE_TIME) * NS_PER_S)

    def read(self, size: int) -> bytes:
        self._clock.advance(self.timeout, lambda: len(self._received) >= size or not self.plugged)
        self._check()
        data = bytes(self._received[:size])
        del self._received[:size]
        return data

    def flood(self) -> None:
        """Send bytes to the host as long as the boards have this fault."""
        if self.boards.faults.flood:
            self._received.extend(bytes(64))
            self._clock.at(self._clock.now_ns() + FLOOD_PERIOD_NS, self.flood)

    def reset_input_buffer(self) -> None:
        self._check()
        self._received.clear()

    def reset_output_buffer(self) -> None:
        self._check()


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """What differs from run to run; times in seconds."""

    rate: float = 16.0                # Hz, of wheel_states
    control_rate: float = 16.0        # Hz, of motor_commands
    phases: tuple[float, float, float, float] = (0.1, 0.3, 0.5, 0.7)  # of four cycles, 0 to 1
    turnaround: float = 0.0004        # each way between host and boards
    transit: float = 0.001            # of a message
    command_period: float = 0.05      # of cmd_vel
    speed: float = SPEED              # m/s, commanded
    rolling: bool = False             # whether the wheels have this speed at the beginning
    stalls: tuple[tuple[str, float, float], ...] = ()  # actor, begin since the fault, length
    late: tuple[tuple[str, int, float], ...] = ()  # topic, number after the fault, extra transit
    lost: tuple[tuple[str, int], ...] = ()         # topic, number after the fault
    doubled: tuple[tuple[str, int], ...] = ()      # the same
    known: str = 'publisher'  # by the info of a message, or its 'number' (Jazzy), or 'nothing'
    driver: dict[str, Any] = field(default_factory=dict)      # parameters of motor_driver
    controller: dict[str, Any] = field(default_factory=dict)  # and of wheel_controller
    follower: dict[str, Any] = field(default_factory=dict)    # and of trajectory_controller


class Process:
    """A process with an executor: its callbacks wait while it is held."""

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self.held_until_ns = 0.0  # infinity: stopped, or ended
        self.waiting: list[Callable[[], None]] = []

    def call(self, do: Callable[[], None]) -> None:
        """Call ``do`` as soon as the process runs."""
        if self._clock.now_ns() >= self.held_until_ns:
            do()
        elif math.isfinite(self.held_until_ns):
            self._clock.at(int(self.held_until_ns), lambda: self.call(do))
        else:
            self.waiting.append(do)


class VirtualDriver:
    """Boards and output stage; a test is a script that lets time pass."""

    def __init__(self, conditions: Conditions | None = None, **settings: Any) -> None:
        self.conditions = conditions = conditions or Conditions(**settings)
        self.clock = VirtualClock()
        self.port = VirtualPort(
            self.clock, conditions.turnaround, conditions.rolling * conditions.speed / RADIUS)
        self.boards = self.port.boards
        self.reports: list[str] = []
        self.samples: list[WheelSample] = []
        self.params = build(MotorDriverParams, {'rate': conditions.rate, **conditions.driver})
        self.output = MotorOutput(self.params, self.deliver, self.reports.append, clock=self.clock)
        self.stopping, self.ended = threading.Event(), False  # the work of the port
        self.duty: tuple[float, ...] | None = None  # commanded every ``DUTY_PERIOD``
        self.clock.at(START_NS, self._repeat_duty)

    def deliver(self, sample: WheelSample) -> None:
        """Take a sample of the wheels."""
        self.samples.append(sample)

    def _repeat_duty(self) -> None:
        if self.duty is not None:
            self.output.set_command(
                MotorCommand(0, four(self.duty)), self.clock.now_ns())
        self.clock.at(self.clock.now_ns() + DUTY_PERIOD_NS, self._repeat_duty)

    @property
    def now(self) -> float:
        """Return the steady time [s]."""
        return self.clock.now_ns() / NS_PER_S

    @property
    def state(self) -> State:
        """Return the present state of the boards."""
        self.boards.advance(self.now)
        return self.boards.state()

    def fail(self, **faults: Any) -> float:
        """Set the faults of the boards, replacing previous ones; return the time."""
        self.boards.fail(Faults(**faults), self.now)
        self.port.flood()
        return self.now

    def record(self, since: float = -math.inf) -> Record:
        """Return the record of the boards ``since`` a time."""
        self.boards.advance(self.now)
        return self.boards.record.after(since)

    def until(self, condition: Callable[[], object]) -> Iterator[float]:
        """Let time pass until ``condition`` holds; fail after ``MAX_WAIT``."""
        end = self.now + MAX_WAIT
        while not condition():
            assert self.now < end, f'still not true after {MAX_WAIT} s: {condition}'
            yield STEP

    def drive(self, *duty: float) -> Iterator[float]:
        """Command four duties, or one for all, until the wheels follow."""
        self.duty = duty if len(duty) == 4 else duty * 4
        yield from self.until(lambda: all(
            abs(speed - FREE_SPEED * one) < 2.0 and abs(given - one) < 1e-4
            for speed, given, one in zip(self.state.speeds, self.state.duty, self.duty)))

    def stop_time(self, since: float) -> Iterator[float]:
        """Return the time from ``since`` to zero duty at all motors [s], when they have it."""
        yield from self.until(lambda: self.state.still)
        return self.state.changed - since

    def play(self, script: Iterator[float]) -> None:
        """Run until the end of a script, which yields the seconds until it goes on."""
        def go_on() -> None:
            seconds = next(script, None)
            if seconds is None:
                raise Ended
            self.clock.at(self.clock.now_ns() + round(seconds * NS_PER_S), go_on)

        self.clock.at(self.clock.now_ns(), go_on)
        self.clock.end_ns = self.clock.now_ns() + MAX_SCRIPT_NS
        self._serve()
        assert self.clock.now_ns() < self.clock.end_ns, 'the script does not end'

    def _serve(self) -> None:
        """Serve the boards until the end; if the cable is disconnected, as ``SerialPort`` does."""
        with suppress(Ended):
            while True:
                try:
                    self.output.boards.run(self.port, self.stopping)
                except OSError:
                    while not self.port.plugged:
                        self.clock.sleep(RETRY_DELAY)
                if self.stopping.is_set():
                    self.ended = True
                    self.clock.sleep(MAX_SCRIPT_NS / NS_PER_S)


class VirtualRobot(VirtualDriver):
    """Boards, output stage, wheel controller and a commander of ``cmd_vel``."""

    def __init__(self, conditions: Conditions | None = None, **settings: Any) -> None:
        super().__init__(conditions, **settings)
        conditions, clock, driver = self.conditions, self.clock, self.params
        self.rejected: list[str] = []
        self.sent: defaultdict[str, Counter[str]] = defaultdict(Counter)  # topic -> messages of
        self.warnings: list[str] = []
        self.processes = {name: Process(clock) for name in (DRIVER, CONTROLLER, COMMANDER)}
        controller = build(WheelControllerParams, {
            'rate': conditions.control_rate, **conditions.controller})
        self.loop = WheelLoop(
            controller, lambda command: None, lambda command: self.publish(
                'motor_commands', command, CONTROLLER), clock.now_ns, clock.time_ns)
        self._checks = {
            'motor_commands': (DRIVER, CommandCheck(
                'motor_commands', self._existing('motor_commands'), self.output.set_command,
                self.output.set_conflict, START_NS, timeout=driver.command_timeout,
                max_age=driver.command_max_age, same_host=True)),
            'wheel_states': (CONTROLLER, CommandCheck(
                'wheel_states', self._existing('wheel_states'), self.loop.add_wheels,
                self.loop.set_wheel_conflict, START_NS, timeout=controller.wheel_states_timeout)),
            **{name: (CONTROLLER, CommandCheck(
                name, self._existing(name), partial(self.loop.set_velocity, name),
                partial(self.loop.set_velocity_conflict, name), START_NS, timeout=timeout,
                max_age=controller.cmd_vel_max_age, warn=self.warnings.append))
               for name, _, timeout in controller.inputs()}}
        self._numbers: dict[str, int] = {}  # messages since the fault, by topic
        self._fault_ns: int | None = None
        self._enabled = False
        self.command: Callable[[], VelocityCommand | None] = self.velocity
        tick_driver, tick_controller, step, command = conditions.phases
        self.every(DRIVER, TICK_PERIOD, tick_driver, self._tick_driver)
        self.every(CONTROLLER, TICK_PERIOD, tick_controller, self._tick_controller)
        self.every(CONTROLLER, 1.0 / conditions.control_rate, step, self.loop.step)
        self.every(COMMANDER, conditions.command_period, command, self._command)

    def velocity(self) -> VelocityCommand:
        """Return a command stamped now."""
        return VelocityCommand(self.clock.time_ns(), self.conditions.speed, 0.0)

    def every(self, name: str, period: float, phase: float, do: Callable[[], None]) -> None:
        """Call ``do`` in a process periodically, from a ``phase`` (0 to 1) of the period on."""
        clock, period_ns = self.clock, round(period * NS_PER_S)
        begin_ns = START_NS + round(phase * period_ns)

        def run() -> None:
            do()
            passed = (clock.now_ns() - begin_ns) // period_ns  # those missed are left out
            clock.at(begin_ns + (passed + 1) * period_ns, lambda: process.call(run))

        process = self.processes[name]
        clock.at(begin_ns, lambda: process.call(run))

    def deliver(self, sample: WheelSample) -> None:
        """Publish ``wheel_states``."""
        super().deliver(sample)
        self.publish('wheel_states', sample, DRIVER)

    def _command(self) -> None:
        if (command := self.command()) is not None:
            self.publish('cmd_vel', command, COMMANDER)

    def _tick_driver(self) -> None:
        self._checks['motor_commands'][1].tick(self.clock.now_ns())
        self._check_state()

    def engage(self) -> None:
        """Engage the emergency stop, as the service does."""
        self.output.engage()
        self.send(CONTROLLER, partial(self.loop.set_emergency_stop, True))

    def release(self) -> str:
        """Release it; return why that is refused, '' if it is released."""
        if not (refused := self.output.release()):
            self.send(CONTROLLER, partial(self.loop.set_emergency_stop, False))
        return refused

    def _check_state(self) -> None:
        """Publish for the controller whether the motors are enabled, as the node does."""
        enabled = self.output.gate.enabled
        if enabled != self._enabled:
            self._enabled = enabled
            self.send(CONTROLLER, lambda: setattr(self.loop.control, 'motors_enabled', enabled))

    def _tick_controller(self) -> None:
        for process, check in self._checks.values():
            if process == CONTROLLER:
                check.tick(self.clock.now_ns())
        self.loop.check_expiry()

    def send(self, name: str, do: Callable[[], None], extra: float = 0.0) -> None:
        """Call ``do`` in a process when a message sent now has arrived, ``extra`` [s] late."""
        arrival_ns = self.clock.now_ns() + round((self.conditions.transit + extra) * NS_PER_S)
        self.clock.at(arrival_ns, lambda: self.processes[name].call(do))

    def _existing(self, topic: str) -> Callable[[], dict[bytes, str]]:
        return lambda: {sender.encode(): sender for sender in self.sent[topic]}

    def publish(self, topic: str, sample: Any, sender: str) -> None:
        """Publish a message, which may be lost, late or doubled."""
        number, conditions = self._numbers.get(topic, 0), self.conditions
        if self._fault_ns is not None:
            self._numbers[topic] = number + 1
            if (topic, number) in conditions.lost:
                return
        extra = sum(seconds for name, index, seconds in conditions.late
                    if (name, index) == (topic, number) and self._fault_ns is not None)
        sent_ns, (reader, check) = self.clock.time_ns(), self._checks[topic]
        self.sent[topic][sender] += 1
        reported: dict[str, Any] = {
            'publisher': {'publisher': sender.encode()},
            'number': {'number': self.sent[topic][sender]}, 'nothing': {}}[conditions.known]

        def receive() -> None:
            now_ns, wall_ns = self.clock.now_ns(), self.clock.time_ns()
            info = MessageInfo(sent_ns, wall_ns, **reported)
            try:
                check.receive(valid(sample), info, now_ns, wall_ns=wall_ns,
                              stamp_ns=wall_ns)
            except SmartTireError as error:
                self.rejected.append(str(error))

        for _ in range(1 + ((topic, number) in conditions.doubled)):
            self.send(reader, receive, extra)

    def stop(self, *names: str) -> None:
        """Stop processes as SIGSTOP does, or end them as SIGKILL does."""
        for name in names:
            self.processes[name].held_until_ns = math.inf
            if name == DRIVER:
                self.clock.held_until_ns = self.clock.end_ns

    def resume(self, name: str) -> None:
        """Let a stopped process continue: it handles what has arrived meanwhile."""
        process = self.processes[name]
        process.held_until_ns = 0.0
        if name == DRIVER:
            self.clock.held_until_ns = 0
        waiting, process.waiting = process.waiting, []
        for do in waiting:
            process.call(do)

    def stall(self, name: str, seconds: float) -> None:
        """Give an actor no core for ``seconds``: a process, 'port', or 'write' (its next one)."""
        until_ns = self.clock.now_ns() + round(seconds * NS_PER_S)
        if name == 'write':
            self.port.hold_writes_ns = round(seconds * NS_PER_S)
        elif name == 'port':
            self.clock.held_until_ns = max(self.clock.held_until_ns, until_ns)
        else:
            process = self.processes[name]
            process.held_until_ns = max(process.held_until_ns, until_ns)

    def run(self, fault_at: float, fault: Callable[[VirtualRobot], None],
            seconds: float) -> Record:
        """
        Drive, let the ``fault`` happen ``fault_at`` [s] after the start; return what follows.

        The record begins with the fault and lasts ``seconds``.
        """
        clock = self.clock
        fault_ns = START_NS + round(fault_at * NS_PER_S)
        clock.end_ns = fault_ns + round(seconds * NS_PER_S)

        def happen() -> None:
            self._fault_ns = fault_ns
            fault(self)

        clock.at(fault_ns, happen)
        for name, begin, length in self.conditions.stalls:
            clock.at(fault_ns + round(begin * NS_PER_S), partial(self.stall, name, length))
        self._serve()
        return self.record(fault_ns / NS_PER_S)


class FollowingRobot(VirtualRobot):
    """The robot follows a path straight ahead, without slip, by commands of TrajectoryControl."""

    def __init__(self, conditions: Conditions | None = None, **settings: Any) -> None:
        super().__init__(conditions, **settings)
        conditions = self.conditions
        self.processes[FOLLOWER] = Process(self.clock)
        params = build(TrajectoryControllerParams, conditions.follower)
        self.control = TrajectoryControl(params)
        self._senders = PublisherCheck('path', 5.0, dict)
        self.command = lambda: None
        self.x, self.length = 0.0, 10.0  # m, shown by odom, of a path
        self.odom_speed: Callable[[float], float | None] = lambda speed: speed  # None: no odom
        self.every(FOLLOWER, 1.0 / params.rate, conditions.phases[3], self._step)
        self.every(COMMANDER, ODOM_PERIOD, conditions.phases[2], self._publish_odom)
        self.clock.at(START_NS + NS_PER_S // 4, lambda: self.order(COMMANDER))

    def deliver(self, sample: WheelSample) -> None:
        """Publish ``wheel_states``."""
        super().deliver(sample)
        self.send(FOLLOWER, lambda: self.control.add_wheels(sample))

    def _publish_odom(self) -> None:
        speed = self.odom_speed(RADIUS * sum(self.state.speeds) / 4.0)
        if speed is None:
            return
        self.x += speed * ODOM_PERIOD
        sample = odometry(self.clock.time_ns(), self.x, v_x=speed, variance=VARIANCE)
        self.send(FOLLOWER, lambda: self.control.add_odometry(sample, self.clock.time_ns()))

    def order(self, sender: str) -> None:
        """Send a path."""
        path = straight_path(self.clock.time_ns(), self.x, self.length)

        def receive() -> None:
            if conflict := self._senders.record(sender.encode(), self.clock.now_ns()):
                self.control.refuse(CommandError(conflict))
            else:
                self.control.follow(path, self.clock.time_ns())
            self._step()

        self.send(FOLLOWER, receive)

    def _step(self) -> None:
        if (command := self.control.step(self.clock.time_ns())) is not None:
            self.publish('cmd_vel', command, FOLLOWER)


def valid(sample: Any) -> Any:
    """Return what the reader of a message with this sample gets; raise if it is refused."""
    if not isinstance(sample, VelocityCommand):
        return sample
    topic = TOPICS['cmd_vel']
    return topic.from_msg(topic.to_msg(empty(topic.type), sample))


def played(make: Callable[..., VirtualDriver]) -> Callable[..., Any]:
    """
    Return the decorator of a test that is a script: a generator with a ``robot``.

    ``make`` creates the robot from those arguments of the test that it has.
    """
    wanted = inspect.signature(make).parameters

    def decorate(script: Callable[..., Iterator[float]]) -> Callable[..., None]:
        first, *others = inspect.signature(script).parameters.values()
        own = {name for name in wanted if name in {one.name for one in others}}

        def test(**given: Any) -> None:
            robot = make(**{name: given[name] for name in own})
            robot.play(script(robot, **given))

        test.__name__, test.__doc__ = script.__name__, script.__doc__
        test.__module__ = script.__module__
        test.__signature__ = inspect.Signature(others)  # type: ignore[attr-defined]
        return test

    return decorate
