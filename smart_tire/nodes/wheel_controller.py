# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Node ``wheel_controller``: ``cmd_vel`` and ``wheel_states`` to ``motor_commands``."""

from __future__ import annotations

from functools import partial
import sys

from smart_tire.control.constants import TICK_PERIOD
from smart_tire.control.wheel_loop import WheelLoop
from smart_tire.messages import velocity_from_twist, wheels_from_msg
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.command_input import CommandInput, CommandTopic
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.runner import run
from smart_tire.parameters import WheelControllerParams
from smart_tire.samples import VelocityCommand

TWIST = 'geometry_msgs/msg/Twist'


class WheelController(SmartTireNode[WheelControllerParams]):
    """
    Controls the wheel speeds for the velocity command in force.

    Subscribes to ``cmd_vel`` (or ``cmd_vel_inputs``), ``wheel_states``, ``emergency_stop_active``
    and ``motors_enabled``; with ``traction.enabled`` also to ``odom`` and
    ``ground_state``. Publishes ``wheel_commands``, ``motor_commands`` and ``/diagnostics``.

    Parameters: ``rate``, ``cmd_vel_inputs``, ``cmd_vel_priorities``, ``cmd_vel_timeouts``,
    ``cmd_vel_types``, ``cmd_vel_timeout``, ``cmd_vel_max_age``, ``effective_track``,
    ``wheel_states_timeout``, ``max_wheel_speed``, ``feedback_window``, ``reliability``, and those
    of the robot; ``max_wheel_acceleration``, ``max_wheel_deceleration``, ``pid.*`` and
    ``traction.*`` can be changed at run time.
    """

    paced_timers = True

    def __init__(self) -> None:
        super().__init__('wheel_controller', WheelControllerParams)
        params = self.params
        self._loop = loop = WheelLoop(
            params, self.make_publisher('wheel_commands'), self.make_publisher('motor_commands'),
            self.steady_ns, self.now_ns)
        self._inputs = [self._velocity_input(name, timeout)
                        for name, _, timeout in params.inputs()]
        self._wheels = CommandInput(
            self, CommandTopic(
                topic='wheel_states', timeout=params.wheel_states_timeout, required=True,
                reliability=params.reliability,
                # a joint that is only recognized by its name must not move the robot
                from_msg=partial(wheels_from_msg, joints=params.robot.joints, recognize=False)),
            loop.add_wheels, loop.set_wheel_conflict)
        self.subscribe_state('emergency_stop_active', loop.set_emergency_stop)
        self.subscribe_state('motors_enabled', self._on_motors_enabled)
        self._estimates_subscribed = False
        self._subscribe_estimates()
        self._control_timers = (
            self.call_every(1.0 / params.rate, self._step),
            self.call_every(TICK_PERIOD, loop.check_expiry, elastic=True))  # at any control rate

    def _velocity_input(self, name: str, timeout: float) -> CommandInput:
        """Return the subscription to a source of velocity commands."""
        unstamped = name in self.params.unstamped_inputs()
        return CommandInput(
            self, CommandTopic(
                topic='cmd_vel', name=name, timeout=timeout, max_age=self.params.cmd_vel_max_age,
                from_msg=velocity_from_twist if unstamped else None,
                unstamped_type=TWIST if unstamped else None),
            partial(self._set_velocity, name),
            partial(self._loop.set_velocity_conflict, name))

    def _set_velocity(self, name: str, command: VelocityCommand, received_ns: int) -> None:
        self._loop.set_velocity(name, command, received_ns)
        self._pace()

    def _step(self) -> None:
        self._loop.step()
        self._pace()

    def _pace(self) -> None:
        """Wake up for the control only while there is a command."""
        driven = self._loop.selected() is not None
        for timer in self._control_timers:
            timer.wakes = driven

    def on_parameters_changed(self) -> None:
        """Use the new controller gains; subscribe to the inputs of traction control."""
        self._loop.set_params(self.params)
        self._subscribe_estimates()

    def _subscribe_estimates(self) -> None:
        """Subscribe to the estimates when traction control is enabled for the first time."""
        if self._estimates_subscribed or not self.params.traction.enabled:
            return
        self._estimates_subscribed = True
        traction = self._loop.control.traction
        for name, on_estimate in (('odom', traction.add_odometry),
                                  ('ground_state', traction.set_ground)):
            self.subscribe(name, on_estimate, reliability=self.params.reliability, announced=True)

    def _on_motors_enabled(self, enabled: bool) -> None:
        self._loop.control.motors_enabled = enabled

    def fill_status(self, status: Status) -> None:
        """Add the command in force, and why the motors are stopped."""
        control, selected = self._loop.control, self._loop.selected()
        status.values.update(
            emergency_stop=control.emergency_stop,
            commanded=selected is not None and not control.emergency_stop,
            command_input=selected[0] if selected else '',
            reading_rate=control.reading_rate, motor_delay=control.motor_delay[0])
        if control.motor_delay[1]:
            status.warn(f'motors follow their duty {control.motor_delay[0]:.2f} s late: the gains '
                        'of the speed control are reduced')
        if control.emergency_stop:
            status.warn('emergency stop')
        if not control.has_measurement(self.steady_ns()):
            status.error('no recent wheel_states: motors disabled', by_host=True)
        self._fill_traction(status, driven=selected is not None)
        for item in (*self._inputs, self._wheels):
            item.fill_status(status)

    def _fill_traction(self, status: Status, *, driven: bool) -> None:
        """Add what traction control does, and why it does nothing."""
        state, enabled = self._loop.control.traction.state, self.params.traction.enabled
        reason = 'disabled' if not enabled else state.reason if driven else 'no command'
        status.values.update({
            'traction.active': enabled and not reason, 'traction.reason': reason,
            'traction.limiting': enabled and driven and state.limiting,
            'traction.limited_steps': state.limited_steps,
            'traction.slip_limit': round(state.slip_limit, 3),
            'traction.friction': round(state.friction, 3)})
        if enabled and driven and reason:
            status.warn(f'no traction control: {reason}')


def main() -> int:
    """Run the node."""
    return run(WheelController)


if __name__ == '__main__':
    sys.exit(main())
