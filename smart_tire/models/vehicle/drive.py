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
Wheel drive: brushed motor, gear and axle, and the torque balance of a wheel.

``r F_x = tau - (tau_c + r f_axle F_z) sign(w) - b w - J dw/dt``: the traction force F_x of the
tread on the robot follows from the motor torque tau at the wheel (gear included), the wheel speed
w and the wheel load F_z. The rolling resistance of the ground is no part of F_x; it acts on the
body. Torques, speeds and currents are positive driving forward. Arguments broadcast.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from smart_tire.arrays import Array, ArrayLike

DRY_FRICTION_SPEED = 0.02  # m/s at the circumference, below it dry friction is linear
TORQUE_NOISE = 0.05    # N m, of one measurement of a motor torque: ripple; small robots, assumed
TORQUE_OFFSET = 0.02   # N m, lasting error of a measured torque, assumed ...
FRICTION_ERROR = 0.1   # ... and that of the friction of its gear, relative
SIGNED = 'signed'  # current_sign: positive as a positive duty drives; otherwise as the duty does


class DriveLosses(Protocol):
    """Friction and inertia of a drive, as in ``motor.*`` of the robot's parameters."""

    @property
    def coulomb_friction(self) -> float:
        """Return the dry friction torque tau_c at the wheel [N m]."""

    @property
    def viscous_friction(self) -> float:
        """Return the friction torque over wheel speed b [N m s/rad]."""

    @property
    def axle_friction(self) -> float:
        """Return the friction torque over wheel load and radius, f_axle [-]."""

    @property
    def inertia(self) -> float:
        """Return the inertia J of wheel, gear and rotor about the wheel axis [kg m2]."""


def torque_errors(losses: DriveLosses) -> tuple[float, float]:
    """
    Return the noise and the lasting error [N m] of a measured motor torque, both sigmas.

    >>> from types import SimpleNamespace
    >>> noise, offset = torque_errors(SimpleNamespace(
    ...     coulomb_friction=0.15, viscous_friction=0.0, axle_friction=0.015, inertia=0.008))
    >>> print(f'{noise:.3f} {offset:.3f} N m')
    0.050 0.025 N m
    """
    return TORQUE_NOISE, math.hypot(TORQUE_OFFSET, FRICTION_ERROR * losses.coulomb_friction)


def friction_torque(speed: ArrayLike, load: ArrayLike, losses: DriveLosses,
                    radius: float) -> Array:
    """
    Return the friction torque [N m] of gear and axle, which has the sign of the wheel speed.

    ``speed`` is in rad/s, ``load`` in N, ``radius`` in m. Below ``DRY_FRICTION_SPEED`` at the
    circumference dry friction is proportional to the speed: its direction is not known there.

    >>> from types import SimpleNamespace
    >>> losses = SimpleNamespace(coulomb_friction=0.15, viscous_friction=0.0, axle_friction=0.015,
    ...                          inertia=0.008)
    >>> print(friction_torque([-10.0, 0.0, 0.115, 10.0], 26.7, losses, 0.087).round(3))
    [-0.185  0.     0.092  0.185]
    """
    speed = np.asarray(speed, dtype=float)
    dry = losses.coulomb_friction + radius * losses.axle_friction * np.asarray(load, dtype=float)
    direction = np.minimum(np.maximum(radius / DRY_FRICTION_SPEED * speed, -1.0), 1.0)
    return dry * direction + losses.viscous_friction * speed


def traction_force(torque: ArrayLike, speed: ArrayLike, acceleration: ArrayLike, load: ArrayLike,
                   losses: DriveLosses, radius: float) -> Array:
    """
    Return the traction force F_x [N] of the tread on the robot, positive forward.

    ``torque`` is the motor torque at the wheel [N m], ``speed`` in rad/s, ``acceleration`` of the
    wheel in rad/s2, ``load`` in N, ``radius`` in m.

    >>> from types import SimpleNamespace
    >>> losses = SimpleNamespace(coulomb_friction=0.15, viscous_friction=0.0, axle_friction=0.015,
    ...                          inertia=0.008)
    >>> print(f'{traction_force(0.7, 10.0, 5.0, 26.7, losses, 0.087):.2f} N')
    5.46 N
    """
    used = friction_torque(speed, load, losses, radius) + losses.inertia * np.asarray(acceleration)
    return np.asarray((np.asarray(torque, dtype=float) - used) / radius)


def measured_torque(current: float, duty: float, speed: float, *, torque_constant: float,
                    current_sign: str) -> float:
    """
    Return the motor torque at the wheel [N m] from a current [A] that a motor board measured.

    With the sign convention ``draw`` the torque has the sign of the applied duty, and a negative
    current brakes. At zero duty the sign of the current has no meaning: the short-circuited motor
    brakes, opposite to the wheel speed [rad/s]. ``torque_constant`` is in N m/A.

    >>> [measured_torque(0.5, duty, 8.0, torque_constant=1.2, current_sign='draw')
    ...  for duty in (0.4, -0.4, 0.0)]
    [0.6, -0.6, -0.6]
    >>> measured_torque(0.5, -0.4, 8.0, torque_constant=1.2, current_sign='signed')
    0.6
    """
    torque = torque_constant * current
    if current_sign == SIGNED:
        return torque
    if duty:
        return torque if duty > 0.0 else -torque
    return -abs(torque) if speed > 0.0 else abs(torque) if speed < 0.0 else 0.0
