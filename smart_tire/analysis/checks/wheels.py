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

"""Checks of the wheel encoders on their own: stuck, reversed, units, and motor torques."""

from __future__ import annotations

from collections.abc import Iterator
import math

import numpy as np

from smart_tire.analysis.checks.recording import CheckedRecording
from smart_tire.findings import Finding, Level
from smart_tire.samples import GRAVITY, WHEELS

UNITS = {'rpm': 60.0 / math.tau, 'deg/s': 180.0 / math.pi, 'revolutions/s': 1.0 / math.tau}
UNIT_TOLERANCE = 0.1      # relative, of the ratio that identifies a unit
RATIO_TOLERANCE = 0.1     # relative, of velocity over change of position
MIN_MOVING = 10           # samples
CORRELATED_SAMPLES = 16.0  # one second of wheel_states at the nominal rate
MIN_SPEED = 0.5           # rad/s, of the wheel that shows motion
STUCK_SHARE = 0.02        # of the speed of the other wheel of its side
MAX_STUCK_TIME = 0.5      # of the samples in motion
MAX_FORCE_WEIGHTS = 3.0   # of the motors over the weight: friction coefficients are below 2
PARTNERS = ((0, 2), (1, 3))  # front and rear wheel of a side


def check_encoders(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield wheels that stand still or turn backwards while their partner turns."""
    wheels = recording.wheels
    if wheels is None:
        return
    speed = wheels.ordered['velocity']
    for front, rear in PARTNERS:
        for wheel, other in ((front, rear), (rear, front)):
            moving = np.abs(speed[:, other]) > MIN_SPEED
            if moving.sum() < MIN_MOVING:
                continue
            own, partner = speed[moving, wheel], speed[moving, other]
            if (np.abs(own) < STUCK_SHARE * np.abs(partner)).mean() > MAX_STUCK_TIME:
                yield Finding(Level.ERROR, f'wheel_states of {WHEELS[wheel]}',
                              f'stands still while {WHEELS[other]} turns', 'equal speeds of a '
                              'side', 'check encoder, cable and coupling')
            elif wheel == rear and np.median(np.sign(own * partner)) < 0.0:
                yield Finding(Level.ERROR, f'wheel_states of {WHEELS[front]} and {WHEELS[rear]}',
                              'turn in opposite directions', 'positive forward on both',
                              'correct signs of motor_driver')


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
    if abs(ratio - 1.0) <= RATIO_TOLERANCE:
        return
    unit = unit_of(ratio, UNITS, UNIT_TOLERANCE)
    yield Finding(Level.ERROR, 'wheel_states', f'velocity is {ratio:.3g} times the change of '
                  'position per second' + (f': in {unit}?' if unit else ''),
                  'rad and rad/s', 'convert both to radians')


def unit_of(ratio: float, units: dict[str, float], tolerance: float) -> str:
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
        yield Finding(Level.WARNING, 'wheel_states', f'motors absorb {-power.mean():.3g} W in the '
                      'mean', 'effort positive while driving forward',
                      'check motor.current_sign and signs (docs/hardware.md)')
    force = float(np.quantile(np.abs(torque[moving]).sum(axis=1), 0.9)) / robot.wheel_radius
    limit = MAX_FORCE_WEIGHTS * robot.mass * GRAVITY
    if force > limit:
        yield Finding(Level.WARNING, 'wheel_states', f'motor torques give {force:.3g} N',
                      f'at most {limit:.3g} N, {MAX_FORCE_WEIGHTS:g} weights', 'check the unit '
                      '(N m at the wheel), motor.torque_constant and mass')
