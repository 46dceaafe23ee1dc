# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Live part of ``smart_tire drive``: along a path, or by the keyboard."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
import math
import os
from pathlib import Path
import re
import time
from types import MappingProxyType
from typing import Any

from smart_tire.cli._dashboard import Dashboard
from smart_tire.cli._keyboard import DriveKey, Keyboard, StopRequest, Teleoperation
from smart_tire.cli._outputs import remove
from smart_tire.cli._path_file import length, Poses
from smart_tire.cli._progress import ProgressLine
from smart_tire.cli._stack import (
    CLOCK, isolated_environment, NODES, params_arguments, PORTS, RECORDER, RobotError, Stack,
    START_TIMEOUT)
from smart_tire.control.constants import STANDSTILL_SPEED
from smart_tire.control.trajectory_control import Cause, PathState
from smart_tire.drivers.clock import SYSTEM
from smart_tire.drivers.simulated_time import SimulatedTime, VARIABLE
from smart_tire.errors import ParameterError
from smart_tire.findings import Level
from smart_tire.host_load import worst_of
from smart_tire.rotation import yaw_of
from smart_tire.samples import PathProgress

SPIN_TIME = 0.05         # s between two looks at keys, progress and signals
SHOW_PERIOD = 0.2        # s between two updates of the dashboard
CANCEL_TIME = 2.0        # s for the answer of cancel_path
DISCOVERY_TIME = 3.0     # s until the nodes of a running robot are known
ANSWER_TIME = 3.0    # s until the controller reports that it follows, or why not
OLD_REPORT_TIME = 0.6  # s in which a report may still be that of the path before
SILENCE_TIME = 3.0   # s without a report, nominally four per second
MIN_MEAN_SPEED = 0.05  # m/s, expected at least
EXTRA_TIME = 30.0    # s, beyond the time at this speed
REPORT_TIME = 1.5        # s, in which a controller that follows a path has reported it
RECORDED = (  # of a simulated robot: what an analysis of the bag needs
    'odom', 'imu/data', 'wheel_states', 'tire_samples', 'ground_truth/odom',
    'ground_truth/wheel_slip', 'ground_truth/tire_friction')
RECORDED_REST = 2.0      # s before a drive, in which an analysis of the bag finds the gyro bias
STANDSTILL_TIME = 1.0    # s that are recorded after the end of a path
ZERO_TIME = 0.5          # s in which standstill is commanded after the keys were released
REASON_TIME = 5.0        # s until a reason is in the diagnostics, which come once a second
FOLLOWER = 'trajectory_controller'
STANDING_TIME = 120.0    # s of real time in which a simulated time may stand
KEYS_HELP = ('arrows or WASD: drive and turn, held down; space: stop; + and -: speed; q: quit. '
             'The robot stops when no key is held.')


class Session:
    """One drive: processes, the node of this program, and requests to stop."""

    def __init__(self, stack: Stack, runner: Any, stopped: StopRequest | None = None) -> None:
        self.stack, self.pilot = stack, runner.node
        self._runner, self._stopped = runner, stopped
        self._passed = 0, time.monotonic()  # latest simulated time [ns], and when it has passed

    def spin(self, seconds: float = SPIN_TIME) -> None:
        """Handle messages; raise KeyboardInterrupt or RobotError if the drive has to end."""
        self._runner.spin(seconds)
        if self._stopped:
            raise KeyboardInterrupt
        self.stack.check_alive()
        if self._passed[0] != SYSTEM.now_ns():
            self._passed = SYSTEM.now_ns(), time.monotonic()
        elif time.monotonic() - self._passed[1] > STANDING_TIME:
            raise RobotError(f'the simulated time has stood for {STANDING_TIME:.0f} s')

    def await_nodes(self) -> None:
        """Wait until estimates are published and every node has sent diagnostics."""
        end = time.monotonic() + START_TIMEOUT
        with ProgressLine(timer=False) as progress:
            while missing := sorted(self.stack.processes.keys() - self.pilot.health.keys()) or [
                    topic for topic, field in (('wheel_slip', 'slip'), ('wheel_states', 'wheels'))
                    if getattr(self.pilot, field) is None]:
                progress.show(f'waiting for messages from {", ".join(missing)}')
                if time.monotonic() > end:
                    raise RobotError(f'no messages from {", ".join(missing)} within '
                                     f'{START_TIMEOUT:.0f} s')
                self.spin()

    def refuse_other_robot(self, nodes: Sequence[str]) -> None:
        """Raise RobotError if a node with the name of one of ``nodes`` runs."""
        from smart_tire.nodes.compat import node_names
        space, found = self.pilot.get_namespace().rstrip('/'), list[str]()

        def heard() -> bool:
            others = node_names(self.pilot)
            found[:] = [name for name in nodes if f'{space}/{name}' in others]
            return bool(found)
        self.wait(heard, DISCOVERY_TIME)
        if found:
            raise RobotError(
                f'a robot runs in ROS_DOMAIN_ID {os.environ["ROS_DOMAIN_ID"]} ({found[0]}): end '
                'it, or unset ROS_DOMAIN_ID; nodes that were killed are heard for 20 s')

    def refuse_other_driver(self) -> None:
        """Raise RobotError while a path is followed: two sources of commands stop the motors."""
        self.wait(lambda: self.pilot.progress is not None, REPORT_TIME)
        report = self.pilot.progress
        if report is not None and report.state == PathState.FOLLOWING:
            raise RobotError('trajectory_controller follows a path: cancel it first (cancel_path)')

    def await_robot(self, topic: str, listener: str) -> None:
        """
        Wait until the pose is known and ``listener`` has subscribed to ``topic``.

        Raises ParameterError if nothing listens, RobotError without a pose or while the
        emergency stop is active.
        """
        self.wait(lambda: self.pilot.listeners(topic) > 0, DISCOVERY_TIME, ParameterError(
            f'no node subscribes to {topic}: start {listener}, or give the namespace of the '
            'robot: --ros-args -r __ns:=/NAME'))
        self.wait(lambda: self.pilot.odometry is not None, START_TIMEOUT,
                  RobotError(f'no messages on odom within {START_TIMEOUT:.0f} s'))
        if self.pilot.emergency_stop:
            raise RobotError('the emergency stop is active: release it first')

    def clock_warnings(self) -> list[str]:
        """Return which nodes have clocks that differ from that of this host."""
        from smart_tire.nodes.clock_offset import clock_findings
        from smart_tire.nodes.compat import node_names
        return [one.text for one in clock_findings(self.pilot, node_names(self.pilot))
                if one.level is Level.WARNING]

    def record(self, bag: Path, awaited: Sequence[str] = ('odom',)) -> None:
        """Start to record all topics; wait until the recorder receives those ``awaited``."""
        self.stack.start(RECORDER, 'smart_tire.cli.main', 'record', '--out', str(bag))
        missing = list(awaited)

        def complete() -> bool:
            log = self.stack.log(RECORDER)
            missing[:] = [topic for topic in missing if not re.search(
                rf'recording {re.escape(self.pilot.resolve_topic_name(topic))}$', log, re.M)]
            return not missing
        self.wait(complete, START_TIMEOUT)
        if missing:
            raise RobotError(f'the recorder does not receive {", ".join(missing)}')

    def wait(self, condition: Callable[[], bool], seconds: float,
             error: Exception | None = None) -> None:
        """Handle messages until ``condition`` holds, or for ``seconds``; then raise ``error``."""
        end = SYSTEM.now() + seconds
        while not condition():
            if SYSTEM.now() > end:
                if error is not None:
                    raise error
                return
            self.spin()

    @contextmanager
    def ending(self) -> Iterator[None]:
        """Cancel the path and command standstill at the end, however it comes."""
        try:
            yield
        finally:
            self._end()

    def _end(self) -> None:
        self.pilot.halt()
        report = self.pilot.progress
        if report is not None and report.state != PathState.FOLLOWING or not self.pilot.has_path:
            self._runner.spin(SPIN_TIME)  # sends the last command
            return
        answer, end = self.pilot.cancel(), time.monotonic() + CANCEL_TIME
        while answer is not None and not answer.done() and time.monotonic() < end:
            self._runner.spin(SPIN_TIME)
        if answer is None or not answer.done():
            print('cancel_path does not answer: stop the robot by its emergency stop', flush=True)

    def start_pose(self) -> tuple[float, float, float]:
        """Return x, y and yaw of the robot in ``odom``."""
        odometry = self.pilot.odometry
        return odometry.position[0], odometry.position[1], yaw_of(odometry.orientation)

    def follow(self, name: str, poses: Poses, dashboard: Dashboard) -> PathState:
        """Follow a path in ``odom``, then stand still; return the state in which it ended."""
        self.pilot.follow(poses)
        following, state = Following(length(poses), SYSTEM.now()), None
        while state is None:
            self.spin(SHOW_PERIOD)
            state = following.end_state(self.pilot.progress, SYSTEM.now())
            dashboard.show(name, self.pilot, note(self.pilot.progress))
        end = SYSTEM.now() + STANDSTILL_TIME
        while SYSTEM.now() < end:
            self.spin(SHOW_PERIOD)
            dashboard.show(name, self.pilot, note(self.pilot.progress))
        return state

    def reason(self, state: PathState) -> str:
        """
        Return why the controller has stopped or refused the path.

        A late host is the only reason for late data and for what they cause.
        """
        self.pilot.health.pop(FOLLOWER, None)  # it may be that of a path before
        end, found = SYSTEM.now() + REASON_TIME, dict[str, str]()
        while found.get('state') != state.name.lower() and SYSTEM.now() < end:
            self._runner.spin(SPIN_TIME)  # also after a request to stop
            found = self.pilot.health.get(FOLLOWER, {})
        explained = state == PathState.STOPPED and found.get('cause') != Cause.ORDER.value
        return explained and self.late_host or found.get('reason', '')

    @property
    def late_host(self) -> str:
        """Return how late this host is; '' if it is not, or if simulated time waits for it."""
        host = None if SYSTEM.simulated else worst_of(self.pilot.health.values())
        return str(host) if host is not None and host.late else ''

    def await_standstill(self) -> None:
        """Wait for a pose of the standing robot that is measured from now on."""
        begin_ns = self.pilot.now_ns()
        self.wait(lambda: self.pilot.odometry.stamp_ns >= begin_ns
                  and abs(self.pilot.odometry.linear[0]) < STANDSTILL_SPEED, START_TIMEOUT,
                  RobotError(f'no recent odom of a standing robot within {START_TIMEOUT:.0f} s'))

    def teleoperate(self, keyboard: Keyboard, teleoperation: Teleoperation) -> None:
        """Drive by the keyboard until it asks for the end."""
        shown = active_until = 0.0
        with Dashboard() as dashboard:
            while True:
                now = time.monotonic()
                for key in keyboard.pressed():
                    if key is DriveKey.QUIT:
                        return
                    teleoperation.press(key, now)
                    active_until = max(active_until, now + ZERO_TIME)
                if self.pilot.emergency_stop:
                    teleoperation.stop()
                command = teleoperation.step(now)
                if command != (0.0, 0.0):
                    active_until = now + ZERO_TIME
                if now < active_until:  # silent otherwise, so that other sources may drive
                    self.pilot.command(*command)
                if now - shown > SHOW_PERIOD:
                    shown = now
                    dashboard.show('keyboard', self.pilot, self._keys_note(
                        command, teleoperation.limits))
                self.spin(max(0.0, now + SPIN_TIME - time.monotonic()))

    def _keys_note(self, command: tuple[float, float], limits: tuple[float, float]) -> str:
        stopped = '  EMERGENCY STOP' if self.pilot.emergency_stop else ''
        return (f'command {command[0]:+.2f} m/s, {command[1]:+.2f} rad/s '
                f'(keys: {limits[0]:.2f} m/s, {limits[1]:.2f} rad/s){stopped}\n{KEYS_HELP}')


@contextmanager
def started(out: Path, params: Sequence[Path], pilot: Callable[[], Any],
            stopped: StopRequest | None = None, *, simulated: bool = True,
            nodes: Sequence[str] = NODES,
            arguments: Mapping[str, Sequence[str]] = MappingProxyType({})) -> Iterator[Session]:
    """
    Start the ``nodes``, unless the robot runs, and ``pilot``; stop all at the end.

    ``params`` are parameter files of all nodes, ``arguments`` more of single ones.
    """
    from smart_tire.nodes.runner import NodeRunner
    given, own = os.environ.get('ROS_DOMAIN_ID'), list[str]()
    if simulated:
        own = ['-p', 'use_sim_time:=true']
        os.environ.update(isolated_environment())  # the pilot is in this process
    with (_simulated_time(out / 'ports' / CLOCK) if simulated else nullcontext(),
          Stack(out / 'logs', os.environ) as stack):
        with NodeRunner(pilot, [*params_arguments(params), *own] if simulated else None) as runner:
            session = Session(stack, runner, stopped)
            try:
                if simulated:
                    if given:
                        session.refuse_other_robot(nodes)
                    for node in nodes:
                        stack.node(node, params, *own, *arguments.get(node, ()))
                    session.await_nodes()
                yield session
            except RobotError as error:  # may be due to other programs
                raise RobotError('; '.join(filter(None, [session.late_host, str(error)]))
                                 ) from error
            finally:
                if SYSTEM.simulated is not None and simulated:
                    SYSTEM.simulated.free()  # nodes end in any order
        stack.stop_in_order()
    if simulated:
        remove(out / 'ports', PORTS)


@contextmanager
def _simulated_time(path: Path) -> Iterator[None]:
    """Let processes that are started meanwhile share a simulated time, by the file ``path``."""
    SimulatedTime.create(path)
    os.environ[VARIABLE] = str(path.resolve())
    print('on this machine only; in another terminal:\n  export', *(
        f'{name}={os.environ[name]}' for name in (
            'ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE', VARIABLE)))
    print('  smart_tire status', flush=True)
    try:
        yield
    finally:
        del os.environ[VARIABLE]
        path.unlink()


class Following:
    """
    The progress of one path; times are seconds of one steady clock.

    ``end_state`` raises RobotError if the controller does not answer, falls silent, or does not
    arrive in the time of a mean speed of ``MIN_MEAN_SPEED``.
    """

    def __init__(self, length: float, time: float) -> None:
        """Begin with a path of ``length`` [m] that was published at ``time``."""
        self._begin = self._heard = time
        self._limit = EXTRA_TIME + length / MIN_MEAN_SPEED
        self._latest: PathProgress | None = None
        self._started = False

    def end_state(self, report: PathProgress | None, time: float) -> PathState | None:
        """Return the state in which the path has ended, None while it is followed."""
        if report is not None and report is not self._latest:
            self._latest, self._heard = report, time
        elif time - self._heard > SILENCE_TIME:
            raise RobotError('trajectory_controller does not report its progress (path_progress)')
        if time - self._begin > self._limit:
            raise RobotError(f'the end of the path was not reached within {self._limit:.0f} s')
        if self._latest is None:
            return None
        state = PathState(self._latest.state)
        if state == PathState.FOLLOWING:
            self._started = True
            return None
        answered = time - self._begin > OLD_REPORT_TIME
        if self._started or state != PathState.IDLE and answered:
            return state
        if time - self._begin > ANSWER_TIME:
            raise RobotError('trajectory_controller has not received the path')
        return None


def note(report: PathProgress | None) -> str:
    """Return the progress as text."""
    if report is None:
        return 'waiting for trajectory_controller'
    text = PathState(report.state).name.lower()
    if math.isfinite(report.remaining_distance):
        text += f', {report.remaining_distance:.2f} m left'
    if math.isfinite(report.cross_track_error):
        text += f', {report.cross_track_error:+.3f} m from the path'
    return text
