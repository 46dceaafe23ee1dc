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

from smart_tire.analysis.checks.recording import CheckedRecording, finding
from smart_tire.findings import Finding
from smart_tire.rotation import matrix
from smart_tire.samples import GRAVITY, WHEELS

FORCE_UNITS = {'g': 1.0 / GRAVITY, 'cm/s2': 100.0, 'mg': 1e3 / GRAVITY, 'ft/s2': 1.0 / 0.3048}
FORCE_UNIT_TOLERANCE = 0.05  # relative, of |f| that identifies a unit
GRAVITY_TOLERANCE = 0.03  # relative: bias and scale error of a consumer-grade accelerometer
REMOVED_GRAVITY = 0.3     # of gravity; a smaller specific force is that without gravity
MAX_TILT = math.radians(10.0)  # of the mounting and of the ground
MIN_SAMPLES = 50
MIN_BIAS_SIGMAS, MIN_BIAS = 5.0, 0.05  # of imu.gyro_bias; rad/s
SPEED_UNITS = {'rpm': 60.0 / math.tau, 'deg/s': 180.0 / math.pi, 'revolutions/s': 1.0 / math.tau}
SPEED_UNIT_TOLERANCE = 0.1  # relative, of the ratio that identifies a unit
RATIO_TOLERANCE = 0.1     # relative, of velocity over change of position
MIN_MOVING = 10           # samples
CORRELATED_SAMPLES = 16.0  # one second of wheel_states at the nominal rate
MIN_SPEED = 0.5           # rad/s, of the wheel that shows motion
STUCK_SHARE = 0.02        # of the speed of the other wheel of its side
MAX_STUCK_TIME = 0.5      # of the samples in motion
MAX_FORCE_WEIGHTS = 3.0   # of the motors over the weight: friction coefficients are below 2
PARTNERS = ((0, 2), (1, 3))  # front and rear wheel of a side
# C_x / F_z. Below, 3 mu F_z / C_x exceeds 1 for mu = 0.5: the patch never slides fully, so that
# friction is not observable. Above are the 10 to 30 of passenger car tires, twice.
MIN_STIFFNESS_RATIO, MAX_STIFFNESS_RATIO = 1.5, 60.0
ASSUMED_FRICTION = 0.5


def check_gravity(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a wrong unit or a wrong direction of gravity, at standstill if there is any."""
    imu = recording.imu
    if imu is None or len(imu.ordered) < MIN_SAMPLES:
        return
    force = imu.ordered['acceleration'] @ matrix(*recording.robot.imu.rotation).T
    still = recording.stationary
    rests = still.sum() >= MIN_SAMPLES
    mean = np.median(force[still] if rests else force, axis=0)
    when, size = 'at rest' if rests else 'in the median', float(np.linalg.norm(mean))
    unit = unit_of(size / GRAVITY, FORCE_UNITS, FORCE_UNIT_TOLERANCE)
    if unit:
        yield finding('gravity_unit', imu.name, size=size, when=when, unit=unit, gravity=GRAVITY,
                      factor=FORCE_UNITS[unit])
    elif size < REMOVED_GRAVITY * GRAVITY:
        yield finding('gravity_removed', imu.name, size=size, when=when, gravity=GRAVITY)
    else:
        if abs(size / GRAVITY - 1.0) > GRAVITY_TOLERANCE:
            yield finding('gravity_size', imu.name, size=size, when=when, gravity=GRAVITY)
        yield _direction(imu.name, mean / size, size, when)


def _direction(name: str, up: np.ndarray, size: float, when: str) -> Finding:
    axis = int(np.argmax(np.abs(up)))
    tilt = math.degrees(math.acos(min(1.0, max(-1.0, float(up[2])))))
    limit = math.degrees(MAX_TILT)
    kind = ('gravity_axis' if axis != 2 else 'upside_down' if up[2] < 0.0
            else 'tilt' if tilt > limit else 'gravity')
    sign = '-' if up[axis] < 0.0 else '+'
    return finding(kind, name, when=when, axis=sign + 'xyz'[axis], tilt=tilt, limit=limit,
                   size=size)


def check_gyro_bias(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a gyro that turns while the wheels stand still."""
    imu, still, configured = recording.imu, recording.stationary, recording.robot.imu.gyro_bias
    if imu is None or still.sum() < MIN_SAMPLES:
        return
    largest = float(np.abs(np.median(imu.ordered['rate'][still], axis=0)).max())
    if largest > max(MIN_BIAS, MIN_BIAS_SIGMAS * configured):
        yield finding('gyro_bias', imu.name, largest=largest, configured=configured)


def check_encoders(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield wheels that stand still or turn backwards while their partner turns."""
    wheels = recording.wheels
    if wheels is None:
        return
    speed = wheels.ordered['velocity']
    for wheel, other in (*PARTNERS, *(pair[::-1] for pair in PARTNERS)):
        moving = np.abs(speed[:, other]) > MIN_SPEED
        if moving.sum() < MIN_MOVING:
            continue
        own, partner = speed[moving, wheel], speed[moving, other]
        if (np.abs(own) < STUCK_SHARE * np.abs(partner)).mean() > MAX_STUCK_TIME:
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
    moving = np.abs(velocity) > MIN_SPEED
    if moving.sum() < MIN_MOVING or not (np.abs(rate) > 0.0).any():
        return
    ratio = float(np.sum(velocity[moving] * rate[moving]) / np.sum(rate[moving] ** 2))
    if abs(ratio - 1.0) > RATIO_TOLERANCE:
        unit = unit_of(ratio, SPEED_UNITS, SPEED_UNIT_TOLERANCE)
        yield finding('velocity_unit', 'wheel_states', ratio=ratio,
                      unit=f': in {unit}?' if unit else '')


def unit_of(ratio: float, units: Mapping[str, float], tolerance: float) -> str:
    """Return the unit whose factor ``ratio`` is, '' if there is none."""
    return next((unit for unit, factor in units.items()
                 if abs(ratio / factor - 1.0) < tolerance), '')


def check_torques(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield motor torques that brake in the mean, or that exceed what the ground can hold."""
    wheels, robot = recording.wheels, recording.robot
    if wheels is None:
        return
    speed, torque = wheels.ordered['velocity'], wheels.ordered['effort']
    moving = (np.abs(speed) > MIN_SPEED).all(axis=1) & ~np.isnan(torque).any(axis=1)
    if moving.sum() < MIN_MOVING:
        return
    power = np.sum(speed[moving] * torque[moving], axis=1)
    sigma = float(np.std(power)) / math.sqrt(len(power) / CORRELATED_SAMPLES)
    if power.mean() < -3.0 * sigma:
        yield finding('absorbed_power', wheels.name, power=-power.mean())
    force = float(np.quantile(np.abs(torque[moving]).sum(axis=1), 0.9)) / robot.wheel_radius
    limit = MAX_FORCE_WEIGHTS * robot.mass * GRAVITY
    if force > limit:
        yield finding('torque_size', wheels.name, force=force, limit=limit,
                      weights=MAX_FORCE_WEIGHTS)


def check_stiffness(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a longitudinal stiffness that is implausible for the load."""
    robot = recording.robot
    load, stiffness = 0.25 * robot.mass * GRAVITY, robot.tire.longitudinal_stiffness
    ratio, critical = stiffness / load, 3.0 * ASSUMED_FRICTION * load / stiffness
    if critical > 1.0 or ratio > MAX_STIFFNESS_RATIO:
        yield finding('stiffness_small' if critical > 1.0 else 'stiffness_large',
                      'tire.longitudinal_stiffness', stiffness=stiffness, load=load,
                      critical=critical, ratio=ratio, mu=ASSUMED_FRICTION,
                      least=MIN_STIFFNESS_RATIO, most=MAX_STIFFNESS_RATIO)
