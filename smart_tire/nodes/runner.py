# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs nodes: as a process of their own, or in a program that spins one, such as the demo."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
import os
from pathlib import Path
import signal
import sys
import threading
from typing import Any, Generic, TypeVar

import rclpy
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions

from smart_tire.drivers.clock import SYSTEM
from smart_tire.errors import ParameterError
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import new_executor, plain_message, RCLError, shared_memory
from smart_tire.nodes.hand_over import return_nothing
from smart_tire.parameters.files import files_of, foreign_arguments, read_blocks, ros_arguments

MAX_SPIN_TIME = 0.1  # s, of one call of the executor by ``NodeRunner``: delay of a signal
MIN_SPIN_TIME = 1e-3  # s: a simulated time may stand
EXIT_OK, EXIT_DEFECT, EXIT_REFUSED = 0, 1, 2
TASKS = Path('/proc/self/task')

Running = TypeVar('Running', bound=SmartTireNode[Any])


class NodeRunner(Generic[Running]):
    """Context manager around a node and its executor; the caller spins it."""

    def __init__(self, node_class: Callable[[], Running],
                 arguments: Sequence[str] | None = None, *, images: bool = False) -> None:
        """
        Create the node; raise ParameterError for an invalid parameter.

        ``arguments`` are those of ROS, by default the command line of the process. Shared memory
        is used for ``images`` only.
        """
        SYSTEM.follow_environment()
        rclpy.init(args=ros_arguments(sys.argv) if arguments is None else list(arguments),
                   signal_handler_options=SignalHandlerOptions.NO)
        with shared_memory(images=images):
            self.node = node_class()
        self._executor = new_executor()
        self._executor.add_node(self.node)

    def __enter__(self) -> NodeRunner[Running]:
        self.node.start()
        return self

    def __exit__(self, *_: object) -> None:
        SYSTEM.leave()
        self.node.stop()
        self._executor.remove_node(self.node)
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def spin(self, seconds: float) -> None:
        """Handle callbacks for ``seconds``."""
        end_ns = self.node.steady_ns() + round(seconds * 1e9)
        while (left_ns := end_ns - self.node.steady_ns()) > 0:
            next_timer = self.node.loop_timers.handle()
            self._executor.spin_once(timeout_sec=max(
                MIN_SPIN_TIME, min(MAX_SPIN_TIME, left_ns * 1e-9, next_timer)))


class Ending:
    """The exit statuses of the process, of which the first counts, and the loops that it ends."""

    def __init__(self) -> None:
        self.statuses: list[int] = []
        self.executors: list[Any] = []

    def end(self, status: int) -> None:
        """End the loops with ``status``; may be called from any thread."""
        self.statuses.append(status)
        if len(self.statuses) == 1:  # later the executors may be shut down
            self.wake()

    def wake(self) -> None:
        """End the waits of the executors."""
        for executor in self.executors:
            executor.create_task(return_nothing)


def run(*node_classes: Callable[[], SmartTireNode[Any]], own_arguments: bool = False,
        images: bool = False) -> int:
    """
    Spin nodes until SIGINT or SIGTERM; return the exit status for ``sys.exit``.

    Each node has its own executor and thread, the first one that of the caller. Signals only end
    the loops, so neither callbacks nor clean-up are interrupted, even by repeated signals.
    An uncaught exception in any thread ends all nodes with EXIT_DEFECT. Arguments other than ROS
    arguments are refused unless ``own_arguments`` is true. Shared memory is used for ``images``
    only.
    """
    ending = Ending()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ending.end(EXIT_OK))
    if not own_arguments and (words := foreign_arguments(sys.argv)):
        get_logger('smart_tire').fatal(
            f'unknown arguments: {" ".join(words)} (ROS arguments come after --ros-args)')
        return EXIT_REFUSED
    try:
        SYSTEM.follow_environment()
        for file in files_of(sys.argv):
            read_blocks(file)  # has bounds, which rcl has not: it would wait for a FIFO
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except ParameterError as error:
        get_logger('smart_tire').fatal(str(error))
        return EXIT_REFUSED
    except RuntimeError as error:  # rcl cannot parse the arguments or a parameter file
        get_logger('smart_tire').fatal(f'ROS arguments: {plain_message(error)}')
        return EXIT_REFUSED
    threading.excepthook = _stopping_hook(threading.excepthook, ending)
    try:
        with _waking_at_signals(ending):
            return _spin_all(node_classes, ending, images)
    finally:
        rclpy.try_shutdown()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)  # no traceback while the interpreter exits


@contextmanager
def _waking_at_signals(ending: Ending) -> Iterator[None]:
    """
    Return the context in which a signal ends the waits of the executors.

    They wait outside of the interpreter, which calls the handler of a signal when it goes on.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)

    def await_signals() -> None:
        while os.read(reading, 1):
            if not ending.statuses:
                ending.wake()

    thread = threading.Thread(target=await_signals, name='signals', daemon=True)
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(writing)
        thread.join()
        os.close(reading)


def _stopping_hook(hook: Callable[[Any], Any],
                   ending: Ending) -> Callable[[Any], None]:
    def excepthook(arguments: Any) -> None:
        hook(arguments)
        ending.end(EXIT_DEFECT)

    return excepthook


def _spin_all(node_classes: Sequence[Callable[[], SmartTireNode[Any]]],
              ending: Ending, images: bool = False) -> int:
    try:
        with shared_memory(images=images):
            nodes = [node_class() for node_class in node_classes]
    except ParameterError as error:
        get_logger('smart_tire').fatal(str(error))
        return EXIT_REFUSED
    except RCLError as error:  # such as DDS security that the middleware does not have
        get_logger('smart_tire').fatal(plain_message(error))
        return EXIT_REFUSED
    executors = [new_executor() for _ in nodes]
    ending.executors += executors
    threads = [threading.Thread(target=_spin, args=(node, executor, ending),
                                name=node.get_name())
               for node, executor in zip(nodes[1:], executors[1:])]
    for node, executor in zip(nodes, executors):
        executor.add_node(node)
    try:
        for node in nodes:
            node.start()
        for thread in threads:
            thread.start()
        _request_priority(nodes)
        _spin(nodes[0], executors[0], ending)
    finally:
        ending.end(EXIT_DEFECT)  # the other threads, too, after an exception in this one
        SYSTEM.leave()
        for thread in threads:
            if thread.ident is not None:
                thread.join()
        for node in reversed(nodes):  # subscribers first
            node.stop()
        for node, executor in zip(nodes, executors):
            executor.remove_node(node)
            executor.shutdown()
            node.destroy_node()
    return ending.statuses[0]


def _spin(node: SmartTireNode[Any], executor: Any, ending: Ending) -> None:
    while not ending.statuses:
        next_timer = node.loop_timers.handle()
        executor.spin_once(timeout_sec=max(MIN_SPIN_TIME, next_timer))
        node.mailbox.handle()


def _request_priority(nodes: Sequence[SmartTireNode[Any]]) -> None:
    """Give all threads of the process the highest priority that one of its nodes requests."""
    node = max(nodes, key=lambda node: getattr(node.params, 'realtime_priority', 0))
    priority = getattr(node.params, 'realtime_priority', 0)
    if priority and (problem := request_priority(priority)):
        node.get_logger().warning(problem)


def request_priority(priority: int) -> str:
    """
    Give all threads of this process the real-time ``priority``, 1 to 99; return '' or the reason.

    Threads with the policy SCHED_FIFO run before all programs without it.
    """
    try:
        for task in TASKS.iterdir():
            with suppress(ProcessLookupError):  # it has ended
                os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return (f'realtime_priority {priority} is not permitted: add "USER - rtprio {priority}" '
                'to /etc/security/limits.d/realtime.conf and log in again')
    except OSError as error:
        return f'realtime_priority {priority}: {error.strerror}'
    return ''
