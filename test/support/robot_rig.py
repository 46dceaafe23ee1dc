# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motor driver and wheel controller as processes, with motor boards that can fail."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
import os
from pathlib import Path
import time
from typing import Any

from geometry_msgs.msg import TwistStamped
from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.qos import latched
from smart_tire.samples import VelocityCommand
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from support.graph import Graph, Process
from support.motor_boards import STILL
from support.motor_rig import MotorRig
from support.verdict import RunQueues
from support.waiting import wait_for

SPEED = 0.7      # m/s, 8 rad/s at the wheels
COMMAND_PERIOD = 0.05  # s
MAX_START = 10.0  # s, until the wheels turn, unless a trip holds the motors
PAUSE = 1.5      # s without commands: their time-outs, and the pause that resets a trip
MIN_DRIVING_DUTY = 0.2  # of every motor while the robot counts as driving
RELEASE_PERIOD = 0.002  # s between requests to release the emergency stop


class RobotRig:
    """Context manager of the output side: emulated boards, motor_driver, wheel_controller."""

    def __init__(self, folder: Path, *, controller: bool = True, **driver: Any) -> None:
        self._folder, self._controller, self._driver = folder, controller, driver
        self._commanded = 0.0
        self.processes: dict[str, Process] = {}

    def __enter__(self) -> RobotRig:
        with ExitStack() as stack:
            self.rig = stack.enter_context(MotorRig(self._folder / 'motors'))
            self.graph = stack.enter_context(Graph(self._folder))
            self._stack = stack.pop_all()
        self.graph.subscribe('wheel_states')
        self.start('motor_driver')
        if self._controller:
            self.start('wheel_controller')
            self.graph.until(lambda: 'wheel_controller' in self.graph.health)
        self.graph.until(lambda: self.graph.received['wheel_states'])
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
        for name, process in self.processes.items():  # shown by pytest if a test fails
            print(f'--- {name}\n{process.output}')

    def start(self, name: str, **parameters: Any) -> Process:
        """Start a node, or restart it; motor_driver with the parameters of the rig and these."""
        if name == 'motor_driver':
            parameters = {**self._driver, **parameters, 'port': self.rig.path}
        self.processes[name] = self._stack.enter_context(self.graph.start(name, **parameters))
        return self.processes[name]

    def command(self, v_x: float = SPEED, stamp_ns: int | None = None) -> None:
        """Publish cmd_vel, at most every ``COMMAND_PERIOD``."""
        now = time.monotonic()
        if now - self._commanded >= COMMAND_PERIOD:
            self._commanded = now
            self.graph.publish('cmd_vel', self.velocity(v_x, stamp_ns))

    @staticmethod
    def velocity(v_x: float, stamp_ns: int | None = None) -> VelocityCommand:
        """Return a command stamped now, or with ``stamp_ns``."""
        return VelocityCommand(time.time_ns() if stamp_ns is None else stamp_ns, v_x, 0.0)

    def drive(self, v_x: float = SPEED) -> float:
        """Command until the wheels turn at the commanded speed; return a time when they do."""
        stalls, asked, paused = self.rig.state().stalls, 0.0, time.monotonic()

        def driving() -> bool:
            nonlocal stalls, asked, paused
            asked, state = time.monotonic(), self.rig.state()
            # boards that did not run look like blocked wheels: a trip, also for a driver that
            # did not run itself meanwhile
            if state.stalls > stalls or asked - paused > MAX_START:
                stalls = state.stalls
                self.pause()
                paused = time.monotonic()
            return min(state.speeds) > 0.8 * v_x / 0.087 and min(state.duty) > MIN_DRIVING_DUTY

        self.hold(2.0 * COMMAND_PERIOD, lambda: self.command(v_x))  # until one is in force
        self.graph.until(driving, lambda: self.command(v_x))
        return asked

    def until_stopped(self, since: float, do: Callable[[], object] | None = None) -> float:
        """
        Call ``do`` (default: command) until the motors have zero duty; return seconds ``since``.

        Fails if the motors were not driven at ``since``: then the stop would prove nothing.
        """
        assert self.rig.record(since).duties[0][1] != STILL
        self.graph.until(lambda: self.rig.state().still, do or self.command)
        return max(self.rig.state().changed - since, 0.0)

    def run_queues(self) -> RunQueues:
        """Return the time that all processes on the path wait on a run queue from now on."""
        return RunQueues(os.getpid(), self.rig.pid, *(
            process.popen.pid for process in self.processes.values()))

    def hold(self, seconds: float, do: Callable[[], object] = lambda: None) -> None:
        """Spin for ``seconds``, calling ``do`` repeatedly."""
        end = time.monotonic() + seconds
        self.graph.until(lambda: time.monotonic() > end, do)

    def stay_stopped(self, seconds: float, do: Callable[[], object] | None = None) -> None:
        """Call ``do`` (default: command) for ``seconds``; fail if a motor gets a duty."""
        since = time.monotonic()
        self.hold(seconds, do or self.command)
        record = self.rig.record(since)
        assert not record.driven(), record.duties

    def pause(self) -> None:
        """Send no commands for ``PAUSE``, which resets a trip."""
        self.hold(PAUSE)

    def emergency_stop(self, engaged: bool) -> Any:
        """Call the service."""
        return self.graph.call('std_srvs/srv/SetBool', 'emergency_stop', data=engaged)

    def arm(self, armed: bool) -> Any:
        """Call the service."""
        return self.graph.call('std_srvs/srv/SetBool', 'arm', data=armed)

    def listen_state(self) -> list[bool]:
        """Return a list to which published states of the emergency stop are appended."""
        states: list[bool] = []
        self.graph.node.create_subscription(
            Bool, 'emergency_stop_active', lambda message: states.append(message.data), latched())
        return states

    def status_message(self, node: str = 'motor_driver') -> str:
        """Return the message of the diagnostics of ``node``."""
        return self.graph.status_message(node)

    def publish_twist(self, v_x: float) -> None:
        """Publish a cmd_vel with any ``v_x``, including NaN and infinity."""
        message = TwistStamped()
        message.header.stamp = self.graph.node.get_clock().now().to_msg()
        message.twist.linear.x = v_x
        self.graph.publish_message('cmd_vel', message)


class Releases:
    """Context manager of a client that releases the emergency stop as fast as it is answered."""

    def __init__(self, robot: RobotRig) -> None:
        self._client = robot.graph.node.create_client(SetBool, 'emergency_stop')
        self._timer = robot.graph.node.create_timer(RELEASE_PERIOD, self._ask)
        self._waiting = False
        self.answered = self.granted = 0

    def __enter__(self) -> Releases:
        wait_for(self._client.service_is_ready)
        return self

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()

    def _ask(self) -> None:
        if not self._waiting:  # the answers to a flood would displace those to others
            self._waiting = True
            self._client.call_async(SetBool.Request(data=False)).add_done_callback(self._on_answer)

    def _on_answer(self, future: Any) -> None:
        self._waiting = False
        self.answered += 1
        self.granted += future.result().success


class Stranger:
    """Context manager of another node that publishes on a topic of ``TOPICS``."""

    def __init__(self, folder: Path, topic: str, name: str = 'stranger') -> None:
        import rclpy
        from rclpy.context import Context
        self._context = Context()
        rclpy.init(args=[], context=self._context)
        self._node = rclpy.create_node(name, context=self._context)
        self._topic = TOPICS[topic]
        self._class = message_class(self._topic.type)
        self._publisher = self._node.create_publisher(self._class, topic, 10)

    def __enter__(self) -> Stranger:
        wait_for(self._publisher.get_subscription_count)
        return self

    def __exit__(self, *_: object) -> None:
        self._node.destroy_node()
        self._context.shutdown()

    def publish(self, sample: Any) -> None:
        """Publish a sample."""
        self._publisher.publish(self._topic.to_msg(self._class(), sample))
