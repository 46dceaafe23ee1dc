# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of the controllers, with the defaults of ``config/tuning.yaml``."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.path_following import (
    ArrivalParams, FollowerParams, FrictionLimitParams, GroundParams, MotionLimitParams,
    PathCheckParams)
from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import inlined, nested, param, realtime_priority, reliability
from smart_tire.samples import GRAVITY, WHEELS

UNSTAMPED = 'Twist'  # of geometry_msgs, without a timestamp
MAX_LOSS_SHARE = 0.5  # friction of a wheel at free speed over its stall torque; assumed
VELOCITY_TYPES = ('TwistStamped', UNSTAMPED)


@dataclass(frozen=True, kw_only=True)
class PidParams:
    """
    Speed control of one wheel.

    The defaults of the feed-forward are those of the simulated motors; ``smart_tire identify
    motor`` measures them. Friction and inertia in the feed-forward are those of ``motor.*``.
    With an ``acceleration`` of 1 the wheels follow the reference on the ground without a lag;
    with 0 lifted wheels, which need less duty, do not overshoot either.
    """

    feed_forward: float = param(
        0.045, 's/rad', 'duty per wheel speed set point: 1 / free speed', (1e-3, 1.0))
    stall_torque: float = param(
        5.0, 'N m', 'torque at full duty, for the duty of friction and inertia', (1e-3, 1e4))
    acceleration: float = param(
        0.6, '-', 'share of the duty for accelerations that is fed forward', (0.0, 1.0))
    proportional: float = param(0.03, 's/rad', 'duty per speed error', (0.0, 10.0))
    integral: float = param(0.3, '1/rad', 'duty per integrated speed error', (0.0, 100.0))
    derivative: float = param(0.0, 's2/rad', 'duty per wheel acceleration', (0.0, 10.0))
    limit: float = param(1.0, '-', 'maximum duty', (0.0, 1.0))
    rate_limit: float = param(60.0, '1/s', 'maximum rate of change of the duty', (2.0, 1e3))


@dataclass(frozen=True, kw_only=True)
class TractionParams(GroundParams):
    """
    Traction control: limits the slip of each wheel to its critical slip.

    That is the one for the lower bound of the friction in ``ground_state``. Defaults are tuned on
    simulated starts and stops (``benchmarks/control/traction.py``).
    """

    enabled: bool = param(False, '-', 'limit the slip of each wheel')
    unknown: float = param(
        0.3, '-', 'friction coefficient of unknown ground, +- 0.15', (0.01, 2.0))
    sigmas: float = param(
        1.1, '-', 'standard deviations from the friction coefficient to its lower bound',
        (0.0, 5.0))
    max_slip: float = param(0.6, '-', 'maximum slip limit on any ground', (0.02, 0.9))
    floor: float = param(
        0.05, 'm/s', 'sliding speed that is always allowed, for starts', (0.01, 1.0))
    min_deceleration: float = param(
        0.5, 'm/s2', 'least deceleration of the wheels after a command to stop', (0.1, 20.0))
    lead: float = param(
        0.006, 's', 'delay of the wheels in addition to one control period', (0.0, 0.5))
    acceleration_filter: float = param(
        0.05, 's', 'time constant of the acceleration from odom', (0.0, 1.0))
    max_age: float = param(0.3, 's', 'no limit while odom is older', (0.05, 5.0))


@dataclass(frozen=True, kw_only=True)
class WheelControllerParams:
    """Wheel controller: one PID speed controller per wheel."""

    rate: float = param(16.0, 'Hz', 'control rate', (1.0, 200.0))
    realtime_priority: int = realtime_priority()
    cmd_vel_inputs: tuple[str, ...] = param(
        ('cmd_vel',), '-', 'topics of velocity commands, one publisher each')
    cmd_vel_priorities: tuple[int, ...] = param(
        (0,), '-', 'priority of each of cmd_vel_inputs; the highest wins', (0, 255))
    cmd_vel_timeouts: tuple[float, ...] = param(
        (), 's', 'time-out of each of cmd_vel_inputs; []: cmd_vel_timeout', (0.02, 60.0))
    cmd_vel_types: tuple[str, ...] = param(
        (), '-', 'message type of each of cmd_vel_inputs; []: TwistStamped',
        choices=VELOCITY_TYPES)
    cmd_vel_timeout: float = param(
        0.25, 's', 'stop if no cmd_vel arrives for this long', (0.02, 60.0))
    cmd_vel_max_age: float = param(
        0.5, 's', 'cmd_vel older or further in the future is refused', (0.02, 60.0))
    effective_track: float = param(
        0.38, 'm', 'track of the differential drive with the same yaw rate', (1e-2, 20.0))
    wheel_states_timeout: float = param(
        0.5, 's', 'zero duty if no wheel_states arrive for this long', (0.02, 60.0))
    max_wheel_speed: float = param(
        20.0, 'rad/s', 'maximum set point; all wheels are scaled by the same factor', (0.1, 100.0))
    max_wheel_acceleration: float = param(
        40.0, 'rad/s2', 'maximum acceleration of the wheel speed reference', (1.0, 1e4), live=True)
    max_wheel_deceleration: float = param(
        60.0, 'rad/s2', 'maximum deceleration of the wheel speed reference', (1.0, 1e4), live=True)
    feedback_window: float = param(
        0.06, 's', 'measured wheel speeds are averaged over at least this time', (0.0, 1.0))
    pid: PidParams = nested(PidParams, live=True)
    traction: TractionParams = nested(TractionParams, live=True)
    reliability: str = reliability()
    robot: RobotParams = inlined(RobotParams)

    def __post_init__(self) -> None:
        if not self.cmd_vel_inputs or len(set(self.cmd_vel_inputs)) < len(self.cmd_vel_inputs):
            raise ValueError(f'cmd_vel_inputs: {list(self.cmd_vel_inputs)}, '
                             'expected one topic or more, each once')
        if not all(self.robot.joints.measured):
            raise ValueError('joints: a wheel that is not measured cannot be controlled')
        for name in ('cmd_vel_priorities', 'cmd_vel_timeouts', 'cmd_vel_types'):
            values, count = getattr(self, name), len(self.cmd_vel_inputs)
            if len(values) != count and (values or name == 'cmd_vel_priorities'):
                raise ValueError(f'{name}: {list(values)}, expected one for each of '
                                 f'{list(self.cmd_vel_inputs)}')
        self._check_losses()

    def _check_losses(self) -> None:
        """Refuse friction that the motor cannot overcome: its feed-forward would be full duty."""
        motor, robot, stall_torque = self.robot.motor, self.robot, self.pid.stall_torque
        losses = (motor.coulomb_friction + motor.viscous_friction / self.pid.feed_forward
                  + motor.axle_friction * robot.wheel_radius * robot.mass / len(WHEELS) * GRAVITY)
        if losses > MAX_LOSS_SHARE * stall_torque:
            raise ValueError(
                f'motor: coulomb_friction, axle_friction and viscous_friction take {losses:.3g} '
                f'N m at free speed, expected at most {MAX_LOSS_SHARE:g} of pid.stall_torque, '
                f'{stall_torque:g} N m')

    def inputs(self) -> list[tuple[str, int, float]]:
        """Return (topic, priority, time-out [s]) of each source of velocity commands."""
        timeouts = self.cmd_vel_timeouts or (self.cmd_vel_timeout,) * len(self.cmd_vel_inputs)
        return list(zip(self.cmd_vel_inputs, self.cmd_vel_priorities, timeouts))

    def unstamped_inputs(self) -> set[str]:
        """Return the sources of velocity commands whose messages are plain Twist."""
        return {name for name, kind in zip(self.cmd_vel_inputs, self.cmd_vel_types)
                if kind == UNSTAMPED}


@dataclass(frozen=True, kw_only=True)
class TrajectoryControllerParams:
    """Trajectory controller: follows a path although the wheels slip."""

    rate: float = param(20.0, 'Hz', 'control rate', (1.0, 200.0))
    realtime_priority: int = realtime_priority()
    max_speed: float = param(0.6, 'm/s', 'maximum speed', (0.01, 10.0), live=True)
    slip_compensation: bool = param(
        True, '-', 'compensate the estimated slip; false: kinematics without slip', live=True)
    effective_track: float = param(0.38, 'm', 'effective_track of wheel_controller', (1e-2, 20.0))
    path_max_age: float = param(
        2.0, 's', 'path or goal_pose older or further in the future is refused', (0.1, 3600.0),
        live=True)
    transform_max_age: float = param(
        2.0, 's', 'path in another frame refused if a transform to odom_frame is older', (
            0.05, 3600.0), live=True)
    follow_path: bool = param(
        True, '-', 'serve the action follow_path of nav2; false: its controller_server does')
    hold_on_arrival: bool = param(
        False, '-', 'keep commanding zero after arrival, so that the wheels hold', live=True)
    limits: MotionLimitParams = nested(MotionLimitParams, live=True)
    follower: FollowerParams = nested(FollowerParams, live=True)
    arrival: ArrivalParams = nested(ArrivalParams, live=True)
    friction: FrictionLimitParams = nested(FrictionLimitParams, live=True)
    friction_map: str = param(
        '', '-', 'YAML file of a map of "smart_tire map", whose friction ahead limits the speed')
    friction_map_margin: float = param(
        1.0, 'm', 'to which cells that the map does not know are as slippery as the known ones',
        (0.0, 10.0))
    checks: PathCheckParams = nested(PathCheckParams, live=True)
    reliability: str = reliability()
    robot: RobotParams = inlined(RobotParams)
