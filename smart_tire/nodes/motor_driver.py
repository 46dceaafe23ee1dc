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
Node ``motor_driver``: two RoboClaw boards.

Encoders and currents to ``wheel_states``, duties to the motors.
"""

from __future__ import annotations

import sys
import threading

from rclpy.qos import QoSProfile
from smart_tire.drivers.motor_output import MotorOutput
from smart_tire.nodes.base import MAX_INPUT_AGE
from smart_tire.nodes.command_input import CommandInput, CommandTopic
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.driver import DriverNode
from smart_tire.nodes.qos import latched
from smart_tire.nodes.runner import run
from smart_tire.parameters import MotorDriverParams
from smart_tire.samples import MotorCommand, STOPPED
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

STATE_PERIOD = 1.0    # s between repetitions of the state, docs/topics.md
# requests and answers: those of a client that floods the service do not displace a stop
SERVICE_DEPTH = 1000


class MotorDriver(DriverNode[MotorDriverParams]):
    """
    Output stage of the robot: publishes wheel states, applies duties to the boards.

    All reasons to stop the motors act here, where no other node can bypass them; see
    ``docs/safety.md``.

    Subscribes to ``motor_commands``; publishes ``wheel_states``, ``emergency_stop_active``,
    ``motors_enabled`` and ``/diagnostics``. Services: ``emergency_stop`` and, with
    ``require_arming``, ``arm``.

    Parameters: ``port``, ``baud_rate``, ``addresses``, ``rate``, ``command_timeout``,
    ``command_max_age``, ``board_timeout``, ``start_stopped``, ``require_arming``,
    ``release_hold_off``, ``low_battery``, ``tolerated_status``, ``free_speed``, ``stall_torque``,
    ``motor_tolerance``, ``stall_duty``, ``stall_time``, ``max_current``, ``signs``, and those of
    the robot: of these ``wheel_radius``, ``mass``, ``encoder.counts_per_revolution``,
    ``motor.torque_constant``, ``motor.inertia`` and ``motor.current_sign``.
    """

    device = 'motors'
    polls = True

    paced_timers = True

    def __init__(self) -> None:
        super().__init__('motor_driver', MotorDriverParams)
        params = self.params
        self._output = output = MotorOutput(
            params, self.make_publisher('wheel_states', rate=params.rate),
            self.get_logger().warning, self._check_state)
        self._gate = output.gate
        self._commands = CommandInput(
            self, CommandTopic(
                topic='motor_commands', timeout=params.command_timeout,
                max_age=params.command_max_age, same_host=True),
            output.set_command, output.set_conflict)
        self._publish_stopped = self.make_guarded_publisher(
            Bool, 'emergency_stop_active', latched())
        self._publish_enabled = self.make_guarded_publisher(Bool, 'motors_enabled', latched())
        self._was_enabled, self._state_lock = False, threading.Lock()
        self._line_logged = False
        queue = QoSProfile(depth=SERVICE_DEPTH)
        self.create_service(
            SetBool, 'emergency_stop', self._on_emergency_stop, qos_profile=queue)
        if params.require_arming:
            self.create_service(SetBool, 'arm', self._on_arm, qos_profile=queue)
        self.call_every(STATE_PERIOD, self._publish_state, wakes=False)
        self._publish_state()
        self.connect(output.boards.line, output.boards.run)

    def start(self) -> None:
        """Open the port."""
        super().start()
        if self.params.start_stopped:
            self.get_logger().warning('emergency stop: latched at start, until released')

    def recover(self) -> None:
        """Stop the motors until the next command, after an unforeseen error in one."""
        self._output.set_command(MotorCommand(0, STOPPED), self.steady_ns())

    def _on_emergency_stop(self, request: SetBool.Request,
                           response: SetBool.Response) -> SetBool.Response:
        if request.data:
            self._output.engage()
            self._publish_state()
            unconfirmed = self._output.unconfirmed()
            response.success = not unconfirmed
            response.message = 'stopped until released' + (
                f'; zero duty not acknowledged by {" and ".join(unconfirmed)}'
                if unconfirmed else '')
        else:
            refused = self._output.release()
            response.success, response.message = not refused, refused or 'released'
            if refused and self._gate.refused_releases.bit_count() != 1:  # logged: 1st, 2nd, 4th
                return response
            self._publish_state()
        self.get_logger().warning(f'emergency stop: {response.message}')
        return response

    def _on_arm(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        obstacles = self._output.arm(request.data)
        response.success = not obstacles
        response.message = '; '.join(obstacles) or ('armed' if request.data else 'disarmed')
        self.get_logger().info(f'arm: {response.message}')
        return response

    def _publish_state(self) -> None:
        with self._state_lock:  # the latest message is the latest state
            self._was_enabled = self._gate.enabled
            self._publish_stopped(Bool(data=self._gate.emergency))
            self._publish_enabled(Bool(data=self._was_enabled))

    def _check_state(self) -> None:
        """Publish a state that has changed; called by the thread of the boards, and here."""
        if self._gate.enabled != self._was_enabled:
            self._publish_state()

    def fill_status(self, status: Status) -> None:
        """Add the reasons to stop the motors, and the board without which wheel_states stop."""
        super().fill_status(status)
        boards, gate = self._output.boards, self._gate
        currents = boards.currents
        status.values.update({
            'command_timeouts': gate.timeouts, 'board_faults': boards.faults,
            'motor_commands.rejected': self.inputs['motor_commands'].bad,
            'emergency_stop': gate.emergency, 'armed': gate.armed,
            'releases_refused': gate.refused_releases,
            'supply': boards.supply_voltage(), 'currents_missing': currents.missing,
            'currents_rejected': currents.rejected})
        self._fill_line_limit(status)
        self._commands.fill_status(status)
        for reason in gate.reasons():
            status.warn(f'motors stopped: {reason}')
        if new := status.new('currents', currents.rejected):
            status.warn(f'{new} motor currents beyond {self.params.max_current:g} A rejected')
        for board in currents.silent_boards():
            status.warn(f'no motor torques: {board} does not report currents')
        if not self._port.problem:
            for board, age in boards.reading_ages().items():
                if age > MAX_INPUT_AGE:
                    status.error(f'wheel_states stopped: {board} does not respond')

    def _fill_line_limit(self, status: Status) -> None:
        """Add the rate that the line permits, log it once, and warn if ``rate`` exceeds it."""
        timing = self._output.boards.line.timing
        if not timing.poll_time:
            return
        status.values['line_rate_limit'] = 1.0 / timing.poll_time
        if excess := timing.excess(self.params.rate):
            status.warn(excess)
        if not self._line_logged:
            self._line_logged = True
            self.get_logger().info(str(timing))
            if excess:
                self.get_logger().warning(excess)


def main() -> int:
    """Run the node."""
    return run(MotorDriver)


if __name__ == '__main__':
    sys.exit(main())
