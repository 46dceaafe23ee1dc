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
Which samples, and which changes between samples, are physically possible.

Every estimator and calibration asks here before it uses a sample; the limits that hold for any
robot with wheels are in ``samples``, where decoders use them, too.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf, isfinite, isnan

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.samples import (
    GroundState, ImuSample, MAX_ANGULAR_RATE, MAX_FILM_VOLTAGE, MAX_SPECIFIC_FORCE,
    MAX_WHEEL_SPEED, Odometry, TireSample, WheelSample, WheelSlip)

MAX_RATE_CHANGE = 5.0          # rad/s between two IMU samples; no robot yaws so abruptly
MAX_FORCE_CHANGE = 20.0        # m/s2 between two IMU samples, in addition to vibration ...
SPIKE_SIGMAS = 8.0             # ... of this many standard deviations; of deviations of a speed
MAX_SPEED_DEVIATION = 3.0      # rad/s of a wheel, from its other measurements
MAX_ANGLE_DEVIATION = 1.0      # rad of a wheel, from its integrated speed
JERK_DENSITY = 3.0             # (rad/s3)^2 s, white jerk of a wheel with speed control, assumed


def is_possible(sample: (ImuSample | WheelSample | TireSample | Odometry | WheelSlip
                         | GroundState)) -> bool:
    """Return whether a robot and its sensors can have produced ``sample``; False for NaN."""
    match sample:
        case TireSample():  # by far the most frequent
            return _within(sample.volts, MAX_FILM_VOLTAGE)
        case ImuSample():
            return (_within(sample.acceleration, MAX_SPECIFIC_FORCE)
                    and _within(sample.rate, MAX_ANGULAR_RATE))
        case WheelSample():  # NaN: not measured, but one wheel of each side must be
            speeds = sample.velocity
            return not any(abs(speed) > MAX_WHEEL_SPEED for speed in speeds) and not any(
                isnan(speeds[i]) and isnan(speeds[i + 2]) for i in range(2))
        case Odometry():
            return all(map(isfinite, (*sample.linear, *sample.angular)))
        case WheelSlip():  # the slip of a stationary wheel is NaN
            return not any(abs(ratio) > 1.0 for ratio in sample.ratio) and all(
                sigma >= 0.0 for sigma in sample.sigma)  # False for NaN
        case GroundState():  # what friction is estimated with
            stiffness, sigma = sample.stiffness
            ratios = sample.friction_coefficient.value, sample.lateral_stiffness_ratio.value
            return (0.0 < stiffness < inf and 0.0 <= sigma < inf
                    and not any(ratio <= 0.0 for ratio in ratios)  # NaN: unknown
                    and abs(sample.stiffness_friction_correlation) <= 1.0)


def _within(values: Iterable[float], limit: float) -> bool:
    """Return whether all magnitudes of ``values`` are at most ``limit``; False for NaN."""
    for value in values:  # noqa: SIM110 - a generator takes three times as long
        if not -limit <= value <= limit:
            return False
    return True


def is_imu_spike(rate: float, force_x: float, force_y: float, vibration: float) -> bool:
    """
    Return whether the change between two IMU samples is too large for a robot.

    The changes are those of yaw rate [rad/s] and specific force [m/s2]; ``vibration`` [m/s2] is
    the standard deviation of the force.
    """
    max_force_change = MAX_FORCE_CHANGE + SPIKE_SIGMAS * vibration
    return abs(rate) > MAX_RATE_CHANGE or max(abs(force_x), abs(force_y)) > max_force_change


def is_speed_contradicted(rate: float, speed: float) -> bool:
    """
    Return whether a wheel's ``rate`` from positions and its ``speed`` [rad/s] exclude each other.

    They do after a reset of the encoder. Both are means, but not always over the same period.
    """
    return abs(rate - speed) > MAX_SPEED_DEVIATION + abs(speed)


def is_position_jump(step: float, integrated: float) -> bool:
    """
    Return whether the ``step`` of a wheel's angle excludes its ``integrated`` speed, both [rad].

    It does after a reset of the encoder. Unlike ``is_speed_contradicted`` it tolerates timestamps
    in bursts, whose mean rates are wrong while the angle is right.
    """
    return abs(step - integrated) >= MAX_ANGLE_DEVIATION + abs(integrated)


def speed_spikes(speed: Array) -> NDArray[np.bool_]:
    """
    Return which wheel speeds [rad/s] (n, wheels) are isolated spikes, same shape.

    A spike deviates from the mean of both neighbors by more than their difference and the noise
    explain. The first and the last speed have one neighbor only and are never spikes.
    """
    before, after = np.roll(speed, 1, axis=0), np.roll(speed, -1, axis=0)
    deviation = np.abs(speed - 0.5 * (before + after))
    moving = deviation[deviation > 0.0]  # at high rates quantization and jitter dominate
    typical = float(np.median(moving)) if moving.size else 0.0
    limit = np.abs(after - before) + MAX_SPEED_DEVIATION + SPIKE_SIGMAS * typical
    spikes: NDArray[np.bool_] = ~(deviation <= limit)  # True for NaN
    spikes[[0, -1]] = False
    return spikes
