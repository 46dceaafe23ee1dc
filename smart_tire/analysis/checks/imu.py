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

"""Checks of the IMU on its own: unit, direction and size of gravity, bias of the gyro."""

from __future__ import annotations

from collections.abc import Iterator
import math

import numpy as np

from smart_tire.analysis.checks.recording import CheckedRecording
from smart_tire.findings import Finding, Level
from smart_tire.rotation import matrix
from smart_tire.samples import GRAVITY

UNITS = {'g': 1.0 / GRAVITY, 'cm/s2': 100.0, 'mg': 1e3 / GRAVITY, 'ft/s2': 1.0 / 0.3048}
UNIT_TOLERANCE = 0.05     # relative, of |f| that identifies a unit
GRAVITY_TOLERANCE = 0.03  # relative: bias and scale error of a consumer-grade accelerometer
MAX_TILT = math.radians(10.0)  # of the mounting and of the ground
MIN_SAMPLES = 50
MIN_BIAS_SIGMAS, MIN_BIAS = 5.0, 0.05  # of imu.gyro_bias; rad/s
AXES = ('x', 'y', 'z')
IMU = 'imu/data'


def check_gravity(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a wrong unit or a wrong direction of gravity, at standstill if there is any."""
    imu = recording.imu
    if imu is None or len(imu.ordered) < MIN_SAMPLES:
        return
    still = recording.stationary
    force = imu.ordered['acceleration'] @ matrix(*recording.robot.imu.rotation).T
    used = force[still] if still.sum() >= MIN_SAMPLES else force
    when = 'at rest' if used is not force else 'in the median'
    mean = np.median(used, axis=0)
    size = float(np.linalg.norm(mean))
    for unit, factor in UNITS.items():
        if abs(size / (GRAVITY * factor) - 1.0) < UNIT_TOLERANCE:
            yield Finding(Level.ERROR, IMU, f'specific force is {size:.4g} {when}: in {unit}',
                          f'{GRAVITY:.2f} m/s2', f'divide linear_acceleration by {factor:.4g}')
            return
    if size < 0.3 * GRAVITY:
        yield Finding(Level.ERROR, IMU, f'specific force is {size:.3g} m/s2 {when}: gravity '
                      'was removed', f'{GRAVITY:.2f} m/s2', 'publish the raw specific force')
        return
    if abs(size / GRAVITY - 1.0) > GRAVITY_TOLERANCE:
        yield Finding(Level.WARNING, IMU, f'specific force is {size:.4g} m/s2 {when}',
                      f'{GRAVITY:.2f} m/s2', 'check unit and calibration of the accelerometer')
    yield from _direction(mean / size, size, when)


def _direction(up: np.ndarray, size: float, when: str) -> Iterator[Finding]:
    axis = int(np.argmax(np.abs(up)))
    tilt = math.acos(min(1.0, max(-1.0, float(up[2]))))
    if axis == 2 and up[2] < 0.0:
        yield Finding(Level.ERROR, IMU, f'gravity is on -z {when}: the IMU is upside down or '
                      'measures with z down', 'specific force +9.81 m/s2 on z',
                      'set imu.rotation to [3.1416, 0, 0] (roll), or convert to REP-103 axes')
    elif axis != 2:
        sign = '-' if up[axis] < 0.0 else '+'
        yield Finding(Level.ERROR, IMU, f'gravity is on {sign}{AXES[axis]} {when}',
                      '+z', 'set imu.rotation to the mounting of the IMU')
    elif tilt > MAX_TILT:
        yield Finding(Level.WARNING, IMU, f'tilted by {math.degrees(tilt):.0f} degrees {when}',
                      f'at most {math.degrees(MAX_TILT):.0f}',
                      'set imu.rotation (smart_tire identify geometry), or level the ground')
    else:
        yield Finding(Level.OK, IMU, f'gravity {size:.2f} m/s2 on +z, tilt '
                      f'{math.degrees(tilt):.1f} degrees')


def check_gyro_bias(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a gyro that turns while the wheels stand still."""
    imu, still = recording.imu, recording.stationary
    if imu is None or still.sum() < MIN_SAMPLES:
        return
    bias = np.median(imu.ordered['rate'][still], axis=0)
    largest = float(np.abs(bias).max())
    if largest > max(MIN_BIAS, MIN_BIAS_SIGMAS * recording.robot.imu.gyro_bias):
        yield Finding(Level.WARNING, IMU, f'angular rate at rest is {largest:.3g} rad/s',
                      f'imu.gyro_bias {recording.robot.imu.gyro_bias:g} rad/s',
                      'check the unit (rad/s), or whether the robot was moved by hand')
