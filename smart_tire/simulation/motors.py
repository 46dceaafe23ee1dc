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

"""Currents of the simulated motors as the motor boards measure them, with their errors."""

from __future__ import annotations

import numpy as np

from smart_tire.models.vehicle.drive import measured_torque
from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.protocol.roboclaw import CURRENT_RESOLUTION
from smart_tire.samples import Four
from smart_tire.simulation.plant import Plant

MOTOR_RNG_STREAM = 4  # index of the random stream of the motors


class Motors:
    """
    Errors of the four motors, drawn once, and their measured currents.

    They have a random stream of their own: all other errors of a seed are independent of it.
    """

    def __init__(self, params: SimulatorParams) -> None:
        errors, self._motor = params.errors, params.robot.motor
        self._rng = np.random.default_rng([params.seed, MOTOR_RNG_STREAM])
        common = self._rng.normal(0.0, errors.torque_constant)
        spread = self._rng.normal(0.0, errors.torque_constant_spread, 4)
        self._torque_constant = self._motor.torque_constant * (1.0 + common + spread)  # N m/A
        self._offset = self._rng.normal(0.0, errors.torque_offset, 4)  # N m
        self._noise = errors.torque_noise  # N m
        self.friction_scale: list[float] = (
            1.0 + self._rng.normal(0.0, errors.motor_friction, 4)).tolist()

    def currents(self, plant: Plant) -> Four:
        """Return one reading of the currents [A], positive driving forward."""
        ripple = self._rng.normal(0.0, self._noise, 4)
        currents = (np.array(plant.motor_torque) + self._offset + ripple) / self._torque_constant
        fl, fr, rl, rr = (np.round(currents / CURRENT_RESOLUTION) * CURRENT_RESOLUTION).tolist()
        return fl, fr, rl, rr

    def reported(self, currents: Four, duty: Four) -> Four:
        """Return ``currents`` with the sign that the boards report, see ``motor.current_sign``."""
        if self._motor.current_sign == 'signed':
            return currents
        fl, fr, rl, rr = (current if value > 0.0 else -current if value < 0.0 else -abs(current)
                          for current, value in zip(currents, duty))
        return fl, fr, rl, rr

    def torques(self, plant: Plant, duty: Four, velocity: Four) -> Four:
        """
        Return one reading of the motor torques [N m], as ``motor_driver`` reports them.

        ``duty`` are the applied duties, ``velocity`` the measured wheel speeds [rad/s].
        """
        reported = self.reported(self.currents(plant), duty)
        fl, fr, rl, rr = (
            measured_torque(*one, torque_constant=self._motor.torque_constant,
                            current_sign=self._motor.current_sign)
            for one in zip(reported, duty, velocity))
        return fl, fr, rl, rr
