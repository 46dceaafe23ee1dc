"""Poll the encoders of two RoboClaws, publish ``wheel_states``, apply ``motor_commands``."""

from __future__ import annotations

import sys

from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from smart_tire.control.duty_gate import DutyGate
from smart_tire.drivers.roboclaw_pair import RoboclawPair
from smart_tire.nodes.base import run, SILENCE
from smart_tire.nodes.command_input import CommandInput
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.driver import DriverNode
from smart_tire.nodes.qos import latched
from smart_tire.parameters import MotorDriverParams
from smart_tire.samples import MotorCommand

STOP_TIMEOUT = 0.4   # s, longest wait for the boards to acknowledge an emergency stop
STATE_PERIOD = 1.0   # s, INTERFACES: the state of the emergency stop on change and at 1 Hz
WATCH = 0.05         # s between looks whether the boards' thread has stopped the motors
PUBLISHERS = 'publishers'  # name of the hold while several nodes command


class MotorDriver(DriverNode[MotorDriverParams]):
    """
    The output stage: encoder counts in, wheel states out; duties go to the boards at once.

    Whatever stops the motors does so here, where no other node can bypass it: see
    ``docs/safety.md``.
    """

    def __init__(self) -> None:
        super().__init__('motor_driver', MotorDriverParams)
        params = self.params
        self._gate = DutyGate(params.command_timeout, self._on_trouble,
                              stopped=params.start_stopped, require_arming=params.require_arming)
        self._boards = RoboclawPair(
            params, self._gate, self.advertise('wheel_states', rate=params.rate))
        self._commands = CommandInput(
            self, 'motor_commands', self._on_command, self._on_conflict,
            timeout=params.command_timeout, max_age=params.command_max_age)
        self._send_stopped = self.guarded_publisher(Bool, 'emergency_stop_active', latched())
        self._send_enabled = self.guarded_publisher(Bool, 'motors_enabled', latched())
        self._was_enabled = False
        self.create_service(SetBool, 'emergency_stop', self._on_emergency_stop)
        if params.require_arming:
            self.create_service(SetBool, 'arm', self._on_arm)
        self.every(STATE_PERIOD, self._publish_state)
        self.every(WATCH, self._watch)
        self._publish_state()
        self.connect(self._boards.line, self._boards.run)

    def start(self) -> None:
        """Begin to open the port."""
        super().start()
        if self.params.start_stopped:
            self.get_logger().warning('emergency stop: engaged from the start, until released')

    def _on_command(self, command: MotorCommand, received_ns: int) -> None:
        self._gate.command(command.duty, received_ns)
        self._boards.wake()

    def _on_conflict(self, reason: str) -> None:
        if reason:
            self._gate.hold(PUBLISHERS, reason)
            self._boards.wake()
        else:
            self._gate.clear(PUBLISHERS)

    def _on_emergency_stop(self, request: SetBool.Request,
                           response: SetBool.Response) -> SetBool.Response:
        if request.data:
            self._gate.engage()
            self._publish_state()
            silent = self._boards.await_zero(STOP_TIMEOUT)
            response.success = not silent
            response.message = 'stopped until released' + (
                f'; zero duty not acknowledged by {" and ".join(silent)}' if silent else '')
        else:
            self._gate.release()
            self._publish_state()
            response.success, response.message = True, 'released'
        self.get_logger().warning(f'emergency stop: {response.message}')
        return response

    def _on_arm(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        against = self._gate.arm(request.data)
        self._boards.wake()
        response.success = not against
        response.message = '; '.join(against) or ('armed' if request.data else 'disarmed')
        self.get_logger().info(f'arm: {response.message}')
        return response

    def _publish_state(self) -> None:
        self._was_enabled = self._gate.enabled
        self._send_stopped(Bool(data=self._gate.emergency))
        self._send_enabled(Bool(data=self._was_enabled))

    def _watch(self) -> None:
        if self._gate.enabled != self._was_enabled:
            self._publish_state()

    def _on_trouble(self, text: str) -> None:
        self.get_logger().warning(text)

    def fill_status(self, status: Status) -> None:
        """Add what stops the motors, and which board keeps the wheel states away."""
        super().fill_status(status)
        boards, gate = self._boards, self._gate
        status.values.update({
            'command_timeouts': gate.timeouts, 'board_faults': boards.faults,
            'motor_commands.rejected': self.inputs['motor_commands'].bad,
            'emergency_stop': gate.emergency, 'armed': gate.armed,
            'supply': boards.supply_voltage()})
        self._commands.fill_status(status)
        for reason in gate.reasons():
            status.warn(f'motors stopped: {reason}')
        if not self._link.problem:
            for board, age in boards.reading_ages().items():
                if age > SILENCE:
                    status.error(f'no wheel_states: the {board} does not answer')


def main() -> int:
    """Run the node."""
    return run(MotorDriver)


if __name__ == '__main__':
    sys.exit(main())
