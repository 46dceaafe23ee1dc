"""Turn ``cmd_vel`` and ``wheel_states`` into ``motor_commands``, 16 times a second."""

from __future__ import annotations

import sys

from std_srvs.srv import SetBool

from smart_tire.control.wheel_control import WheelControl
from smart_tire.models.skid_steer import wheel_speeds
from smart_tire.nodes.base import run, SmartTireNode
from smart_tire.nodes.diagnostics import Status
from smart_tire.parameters import WheelControllerParams
from smart_tire.samples import MotorCommand, VelocityCommand, WheelCommand, WheelSample


class WheelController(SmartTireNode[WheelControllerParams]):
    """The wheel control with its clock, its topics and its emergency stop."""

    def __init__(self) -> None:
        super().__init__('wheel_controller', WheelControllerParams)
        self._control = WheelControl(self.params)
        self._publish_wheels = self.advertise('wheel_commands')
        self._publish_motors = self.advertise('motor_commands')
        self.subscribe('cmd_vel', self._on_velocity)
        self.subscribe('wheel_states', self._on_wheels, required=True,
                       reliability=self.params.reliability)
        self.create_service(SetBool, 'emergency_stop', self._on_emergency_stop)
        self.every(1.0 / self.params.rate, self._step)

    def retune(self) -> None:
        """Use the new gains."""
        self._control.retune(self.params)

    def _on_velocity(self, command: VelocityCommand) -> None:
        speeds = wheel_speeds(command.v_x, command.yaw_rate, self.params.robot.wheel_radius,
                              self.params.effective_track)
        self._control.command(speeds.tolist(), self.steady_ns())

    def _on_wheels(self, sample: WheelSample) -> None:
        self._control.measure(sample.velocity, self.steady_ns())

    def _on_emergency_stop(self, request: SetBool.Request,
                           response: SetBool.Response) -> SetBool.Response:
        self._control.emergency_stop(request.data)
        self._step()
        response.success = True
        response.message = 'stopped until released' if request.data else 'released'
        self.get_logger().warning(f'emergency stop: {response.message}')
        return response

    def _step(self) -> None:
        velocity, duty = self._control.step(self.steady_ns())
        stamp_ns = self.now_ns()
        self._publish_wheels(WheelCommand(stamp_ns, velocity))
        self._publish_motors(MotorCommand(stamp_ns, duty))

    def fill_status(self, status: Status) -> None:
        """Add whether and why the robot stands."""
        now_ns = self.steady_ns()
        status.values.update(
            emergency_stop=self._control.stopped, commanded=self._control.commanded(now_ns))
        if self._control.stopped:
            status.warn('emergency stop')
        if not self._control.measured(now_ns):
            status.error('wheel speeds are unknown: no duty')


def main() -> int:
    """Run the node."""
    return run(WheelController)


if __name__ == '__main__':
    sys.exit(main())
