# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Checks of IMU and wheels on their own, and of the stiffness of the tire for its load."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import math

import numpy as np

from smart_tire.analysis.checks import limits
from smart_tire.analysis.checks.recording import CheckedRecording, finding
from smart_tire.findings import Finding
from smart_tire.rotation import matrix
from smart_tire.samples import GRAVITY, WHEELS

FORCE_UNITS = {'g': 1.0 / GRAVITY, 'cm/s2': 100.0, 'mg': 1e3 / GRAVITY, 'ft/s2': 1.0 / 0.3048}
SPEED_UNITS = {'rpm': 60.0 / math.tau, 'deg/s': 180.0 / math.pi, 'revolutions/s': 1.0 / math.tau}
PARTNERS = ((0, 2), (1, 3))  # front and rear wheel of a side


def check_gravity(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a wrong unit or a wrong direction of gravity, at standstill if there is any."""
    imu = recording.imu
    if len(imu.ordered) < limits.MIN_READINGS:
        return
    force = imu.ordered['acceleration'] @ matrix(*recording.robot.imu.rotation).T
    still = recording.stationary
    rests = still.sum() >= limits.MIN_READINGS
    mean = np.median(force[still] if rests else force, axis=0)
    when, size = 'at rest' if rests else 'in the median', float(np.linalg.norm(mean))
    unit = unit_of(size / GRAVITY, FORCE_UNITS, limits.TOLERANCE)
    if unit:
        yield finding('gravity_unit', imu.name, size=size, when=when, unit=unit, gravity=GRAVITY,
                      factor=FORCE_UNITS[unit])
    elif size < limits.REMOVED_GRAVITY * GRAVITY:
        yield finding('gravity_removed', imu.name, size=size, when=when, gravity=GRAVITY)
    else:
        if abs(size / GRAVITY - 1.0) > limits.GRAVITY_TOLERANCE:
            yield finding('gravity_size', imu.name, size=size, when=when, gravity=GRAVITY)
        yield _direction(imu.name, mean / size, size, when)


def _direction(name: str, up: np.ndarray, size: float, when: str) -> Finding:
    axis = int(np.argmax(np.abs(up)))
    tilt = math.degrees(math.acos(min(1.0, max(-1.0, float(up[2])))))
    limit = math.degrees(limits.MAX_TILT)
    kind = ('gravity_axis' if axis != 2 else 'upside_down' if up[2] < 0.0
            else 'tilt' if tilt > limit else 'gravity')
    sign = '-' if up[axis] < 0.0 else '+'
    return finding(kind, name, when=when, axis=sign + 'xyz'[axis], tilt=tilt, limit=limit,
                   size=size)


def check_gyro_bias(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a gyro that turns while the wheels stand still."""
    imu, still, configured = recording.imu, recording.stationary, recording.robot.imu.gyro_bias
    if still.sum() < limits.MIN_READINGS:
        return
    largest = float(np.abs(np.median(imu.ordered['rate'][still], axis=0)).max())
    if largest > limits.BIAS_SIGMAS * configured:
        yield finding('gyro_bias', imu.name, largest=largest, configured=configured)


def check_encoders(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield wheels that stand still or turn backwards while their partner turns."""
    speed = recording.wheels.ordered['velocity']
    for wheel, other in (*PARTNERS, *(pair[::-1] for pair in PARTNERS)):
        moving = np.abs(speed[:, other]) > limits.MIN_SPEED
        if moving.sum() < limits.MIN_READINGS:
            continue
        own, partner = speed[moving, wheel], speed[moving, other]
        if (np.abs(own) < limits.STUCK_SHARE * np.abs(partner)).mean() > 0.5:
            yield finding('wheel_stuck', f'wheel_states of {WHEELS[wheel]}', other=WHEELS[other])
        elif wheel > other and np.median(np.sign(own * partner)) < 0.0:
            yield finding('wheel_reversed',
                          f'wheel_states of {WHEELS[other]} and {WHEELS[wheel]}')


def check_velocity_unit(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield velocities that are not the rate of change of the positions."""
    motion = recording.motion
    if motion is None or motion.wheels.position is None:
        return
    wheels, position = motion.wheels, motion.wheels.position
    steps = np.diff(wheels.time)
    usable = steps < 1.5 * float(np.median(steps))
    rate = (np.diff(position, axis=0) / steps[:, None])[usable]
    velocity = wheels.velocity[1:][usable]
    moving = np.abs(velocity) > limits.MIN_SPEED
    if moving.sum() < limits.MIN_READINGS or not (np.abs(rate) > 0.0).any():
        return
    ratio = float(np.sum(velocity[moving] * rate[moving]) / np.sum(rate[moving] ** 2))
    if abs(ratio - 1.0) > limits.TOLERANCE:
        unit = unit_of(ratio, SPEED_UNITS, limits.TOLERANCE)
        yield finding('velocity_unit', 'wheel_states', ratio=ratio,
                      unit=f': in {unit}?' if unit else '')


def unit_of(ratio: float, units: Mapping[str, float], tolerance: float) -> str:
    """Return the unit whose factor ``ratio`` is, '' if there is none."""
    return next((unit for unit, factor in units.items()
                 if abs(ratio / factor - 1.0) < tolerance), '')


def check_torques(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield motor torques that brake in the mean, or that exceed what the ground can hold."""
    wheels, robot = recording.wheels, recording.robot
    speed, torque = wheels.ordered['velocity'], wheels.ordered['effort']
    moving = (np.abs(speed) > limits.MIN_SPEED).all(axis=1) & ~np.isnan(torque).any(axis=1)
    if moving.sum() < limits.MIN_READINGS:
        return
    power = np.sum(speed[moving] * torque[moving], axis=1)
    sigma = float(np.std(power)) / math.sqrt(
        len(power) * wheels.period / limits.CORRELATION_TIME)
    if power.mean() < -limits.SIGMAS * sigma:
        yield finding('absorbed_power', wheels.name, power=-power.mean())
    force = float(np.quantile(np.abs(torque[moving]).sum(axis=1), 0.9)) / robot.wheel_radius
    limit = limits.MAX_FORCE_WEIGHTS * robot.mass * GRAVITY
    if force > limit:
        yield finding('torque_size', wheels.name, force=force, limit=limit,
                      weights=limits.MAX_FORCE_WEIGHTS)


def check_stiffness(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a longitudinal stiffness that is implausible for the load."""
    robot = recording.robot
    load, stiffness = 0.25 * robot.mass * GRAVITY, robot.tire.longitudinal_stiffness
    ratio, critical = stiffness / load, 3.0 * limits.ASSUMED_FRICTION * load / stiffness
    if critical > 1.0 or ratio > limits.MAX_STIFFNESS_RATIO:
        yield finding('stiffness_small' if critical > 1.0 else 'stiffness_large',
                      'tire.longitudinal_stiffness', stiffness=stiffness, load=load,
                      critical=critical, ratio=ratio, mu=limits.ASSUMED_FRICTION,
                      least=3.0 * limits.ASSUMED_FRICTION, most=limits.MAX_STIFFNESS_RATIO)
