# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Slip of the wheels, velocity of the body and what was commanded."""

from __future__ import annotations

import math

from smart_tire.analysis.figure import MAX_SLIP_SIGMA
from smart_tire.samples import (
    BatterySample, Four, Icr, ImuSample, MotorCommand, Odometry, PathProgress, VelocityCommand,
    WheelCommand, WHEELS, WheelSample, WheelSlip)
from smart_tire.view.recorder import Recorder, Track
from smart_tire.view.style import COMMAND, ESTIMATE, TRUTH, WHEEL_COLORS, XYZ_COLORS

UNKNOWN_TWIST = -1.0  # first covariance of a twist that is not given (ROS)
V_X_VARIANCE, YAW_RATE_VARIANCE = 0, 35  # in the row-major 6x6 covariance


class SlipLayer:
    """Slip ratio of each wheel with its bounds, and the true one."""

    def __init__(self, recorder: Recorder) -> None:
        self._estimates = [recorder.estimate(f'slip/{wheel}/estimate', f'{wheel} [-]', color)
                           for wheel, color in WHEEL_COLORS.items()]
        self._truths = [recorder.line(
            f'slip/{wheel}/truth', f'{wheel}, truth [-]', TRUTH, width=1.0) for wheel in WHEELS]

    def add(self, sample: WheelSlip) -> None:
        """Add estimated slips; where they are not observable, as around a standstill, a gap."""
        for track, ratio, sigma in zip(self._estimates, sample.ratio, sample.sigma):
            track.add_estimate(sample.stamp_ns, ratio if sigma <= MAX_SLIP_SIGMA else math.nan,
                               sigma)

    def add_truth(self, sample: WheelSlip) -> None:
        """Add true slips."""
        _add_four(self._truths, sample.stamp_ns, sample.ratio)


class BodyLayer:
    """Velocity and yaw rate: command, estimate and truth; center of rotation."""

    def __init__(self, recorder: Recorder) -> None:
        self._speed, self._rate = (
            recorder.estimate(f'body/{name}/estimate', f'estimate [{unit}]', ESTIMATE)
            for name, unit in (('velocity', 'm/s'), ('yaw_rate', 'rad/s')))
        self._truths, self._commands = ([recorder.line(
            f'body/{name}/{kind}', f'{kind} [{unit}]', color, steps=kind == 'command')
            for name, unit in (('velocity', 'm/s'), ('yaw_rate', 'rad/s'))]
            for kind, color in (('truth', TRUTH), ('command', COMMAND)))
        self._icr = [recorder.line(f'body/icr/{axis}', f'{axis} [m]', color)
                     for axis, color in zip('xy', XYZ_COLORS)]

    def add(self, sample: Odometry) -> None:
        """Add the estimated twist."""
        covariance = sample.twist_covariance
        if covariance[0] != UNKNOWN_TWIST:
            for track, value, index in (
                    (self._speed, sample.linear[0], V_X_VARIANCE),
                    (self._rate, sample.angular[2], YAW_RATE_VARIANCE)):
                track.add_estimate(sample.stamp_ns, value, math.sqrt(max(covariance[index], 0.0)))

    def add_truth(self, sample: Odometry) -> None:
        """Add the true twist."""
        if sample.twist_covariance[0] != UNKNOWN_TWIST:
            for track, value in zip(self._truths, (sample.linear[0], sample.angular[2])):
                track.add(sample.stamp_ns, value)

    def add_command(self, sample: VelocityCommand) -> None:
        """Add a commanded velocity."""
        for track, value in zip(self._commands, (sample.v_x, sample.yaw_rate)):
            track.add(sample.stamp_ns, value)

    def add_icr(self, sample: Icr) -> None:
        """Add the center of rotation."""
        for track, value in zip(self._icr, (sample.x, sample.y)):
            track.add(sample.stamp_ns, value)


class ProgressLayer:
    """Cross-track error, remaining distance and state of path following."""

    def __init__(self, recorder: Recorder) -> None:
        self._error = recorder.line('progress/cross_track_error', 'cross-track error [m]', COMMAND)
        self._remaining = recorder.line('progress/remaining_distance', 'remaining distance [m]',
                                        TRUTH)
        self._state = recorder.line('progress/state', 'state', COMMAND, steps=True)

    def add(self, sample: PathProgress) -> None:
        """Add the progress; the distances are gaps while no path is followed."""
        self._error.add(sample.stamp_ns, sample.cross_track_error)
        self._remaining.add(sample.stamp_ns, sample.remaining_distance)
        self._state.add(sample.stamp_ns, float(sample.state))


class WheelLayer:
    """Speed, set point, duty and torque of each wheel."""

    def __init__(self, recorder: Recorder) -> None:
        def tracks(kind: str, name: str, *, steps: bool = True) -> list[Track]:
            return [recorder.line(f'wheels/{kind}/{wheel}', f'{wheel}, {name}', color, steps=steps)
                    for wheel, color in WHEEL_COLORS.items()]

        self._speeds = tracks('speed', 'measured [rad/s]', steps=False)
        self._set_points = tracks('set_point', 'set point [rad/s]')
        self._duties = tracks('duty', 'duty [-]')
        self._torques = tracks('torque', 'torque [N m]', steps=False)

    def add(self, sample: WheelSample) -> None:
        """Add measured speeds and torques."""
        _add_four(self._speeds, sample.stamp_ns, sample.velocity)
        if sample.effort is not None:
            _add_four(self._torques, sample.stamp_ns, sample.effort)

    def add_set_points(self, sample: WheelCommand) -> None:
        """Add set points of the speeds."""
        _add_four(self._set_points, sample.stamp_ns, sample.velocity)

    def add_duties(self, sample: MotorCommand) -> None:
        """Add the duties of the motors."""
        _add_four(self._duties, sample.stamp_ns, sample.duty)


class ImuLayer:
    """Specific force and angular rate of the IMU; batteries of the sensor nodes."""

    def __init__(self, recorder: Recorder) -> None:
        self._acceleration, self._rate = (
            [recorder.line(f'imu/{name}/{axis}', f'{axis} [{unit}]', color, width=1.0)
             for axis, color in zip('xyz', XYZ_COLORS)]
            for name, unit in (('acceleration', 'm/s²'), ('rate', 'rad/s')))
        self._batteries = {wheel: recorder.line(f'battery/{wheel}', f'{wheel} [V]', color)
                           for wheel, color in WHEEL_COLORS.items()}

    def add(self, sample: ImuSample) -> None:
        """Add a reading of the IMU."""
        for tracks, values in ((self._acceleration, sample.acceleration),
                               (self._rate, sample.rate)):
            for track, value in zip(tracks, values):
                track.add(sample.stamp_ns, value)

    def add_battery(self, sample: BatterySample) -> None:
        """Add a battery voltage."""
        self._batteries[sample.wheel].add(sample.stamp_ns, sample.volts)


def _add_four(tracks: list[Track], stamp_ns: int, values: Four) -> None:
    for track, value in zip(tracks, values):
        track.add(stamp_ns, value)
