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

"""
Fits of the motors on the ground and lifted, under the same assumptions, and their accuracy.

What the recordings do not determine is assumed, with a standard deviation: the fits are repeated
with another assumption, and the change is a part of the standard error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.calibration.recording import Recording
from smart_tire.calibration.robot.motor_balance import (
    fit_ground, fit_lifted, GROUND_SLOPE_SIGMA, GroundFit, LiftedFit, Run)
from smart_tire.calibration.robot.motor_drive import (
    DriveFit, fit_drive, hac_lags, SLIP_SHARE)
from smart_tire.calibration.robot.motor_rows import motor_rows, MotorRows
from smart_tire.calibration.robot.static_imu import stationary_intervals
from smart_tire.estimation.slip.zero_velocity import MAX_STATIONARY_WHEEL_SPEED
from smart_tire.models.constants import GRAVITY
from smart_tire.numerics.regression import Prior, robust_regression
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain, UNKNOWN

COMMAND_DELAY_SIGMA = 0.002    # s, of the delay from a command to its effect; assumed
READING_DELAY_SIGMA = 0.002    # s, of the delay from the encoders to the currents; assumed
ACCEL_SCALE_SIGMA = 0.005      # relative, of the accelerometer; data sheets of MEMS sensors
SAMPLED_INERTIA_SIGMA = 0.04  # relative, without motor_commands: readings at 16 Hz, duty at 50 Hz
SAMPLED_TORQUE_SHARE = 0.2     # of the torque that accelerates a wheel, in one window
SAMPLING_FACTOR = 2.0     # error of the torque over the ripple of the force, which tires smooth
MAX_SAMPLING_ERROR = 0.03  # relative; above it, readings are in step with the commands
TYPICAL_RIPPLE = 0.05      # m/s2, first value of the standard deviation of a row
REST_MARGIN = 0.5          # s after the begin and before the end of a rest


@dataclass(frozen=True)
class Inputs:
    """Rows of all recordings, and the specific force [m/s2] at rest on the ground."""

    ground: list[MotorRows]
    rest_force: list[Uncertain]
    lifted: list[MotorRows]
    robot: RobotParams


@dataclass(frozen=True)
class Solution:
    """
    All fits under the same assumptions.

    Without ``drive`` the torque between its readings is not known. ``in_step`` is whether it is
    then wrong, because the readings are in step with the commands.
    """

    drive: DriveFit | None
    lifted: LiftedFit | None
    ground: GroundFit
    in_step: bool


def prepare(grounds: Sequence[Recording], lifted: Sequence[Recording],
            robot: RobotParams) -> Inputs:
    """Return the rows of recordings on the ground and with lifted wheels."""
    return Inputs([motor_rows(recording, robot) for recording in grounds],
                  [_rest_force(recording, robot) for recording in grounds],
                  [motor_rows(recording, robot) for recording in lifted], robot)


def solve(inputs: Inputs, with_duty: bool, *, slip_error: float = 0.0,
          command_delay_error: float = 0.0, reading_delay_error: float = 0.0) -> Solution:
    """
    Return the fits, with the torque from the duty or from its readings alone.

    The errors of the slip (relative) and of the delays [s] are those of what is assumed. Raises
    EstimatorError with the reason if the fits are not possible.
    """
    drive = fit_drive(inputs.ground, slip_error, reading_delay_error) if with_duty else None

    def run(rows: MotorRows, rest_force: Uncertain) -> Run:
        torque = rows.torque
        sigma = SAMPLED_TORQUE_SHARE * inputs.robot.motor.inertia * np.abs(rows.acceleration)
        if drive is not None and not np.isnan(rows.duty).any():
            torque, sigma = drive.torque(rows, command_delay_error), drive.torque_sigma(rows)
        measured = np.isfinite(torque @ np.ones(4))
        return Run(rows.where(measured), torque[measured], sigma[measured], rest_force)

    lifted = None
    if inputs.lifted:
        lifted = fit_lifted([run(rows, UNKNOWN) for rows in inputs.lifted], inputs.robot)
        if drive is None or any(np.isnan(rows.duty).any() for rows in inputs.lifted):
            inertia = lifted.inertia
            lifted = replace(lifted, inertia=Uncertain(inertia.value, math.hypot(
                inertia.sigma, SAMPLED_INERTIA_SIGMA * inertia.value)))
    ground = fit_ground([run(*both) for both in zip(inputs.ground, inputs.rest_force)],
                        inputs.robot, lifted)
    in_step = drive is None and _sampling_error(inputs.ground) > MAX_SAMPLING_ERROR
    return Solution(drive, lifted, ground, in_step)


def alternatives(inputs: Inputs, with_duty: bool) -> list[Solution]:
    """Return the fits with each of the assumptions changed by one standard deviation."""
    if not with_duty:
        return []
    return [solve(inputs, True, slip_error=SLIP_SHARE),
            solve(inputs, True, command_delay_error=COMMAND_DELAY_SIGMA),
            solve(inputs, True, reading_delay_error=READING_DELAY_SIGMA)]


def total_kappa(best: Solution, others: Sequence[Solution], inputs: Inputs) -> Uncertain:
    """Return kappa with all its sources of error."""
    value, sigma = best.ground.kappa
    sampling = (best.drive.relative_sigma if best.drive is not None
                else _sampling_error(inputs.ground))
    shifts = [other.ground.kappa.value - value for other in others]
    relative = [sampling, inputs.robot.wheel_radius_sigma, ACCEL_SCALE_SIGMA]
    return Uncertain(value, math.hypot(sigma, best.ground.inertia_shift, *shifts,
                                       *(value * part for part in relative)))


def _rest_force(recording: Recording, robot: RobotParams) -> Uncertain:
    """Return the forward specific force [m/s2] at rest: accelerometer bias, slope and tilt."""
    imu, means = recording.imu, []
    for begin, end in stationary_intervals(recording.wheels,
                                           MAX_STATIONARY_WHEEL_SPEED / robot.wheel_radius):
        chosen = (imu.time > begin + REST_MARGIN) & (imu.time < end - REST_MARGIN)
        if chosen.any():
            means.append(float(imu.force[chosen, 0].mean()))
    slope = GRAVITY * GROUND_SLOPE_SIGMA
    if not means:
        return Uncertain(0.0, math.hypot(slope, robot.imu.accel_bias))
    return Uncertain(float(np.mean(means)), slope / math.sqrt(len(means)))


def _sampling_error(runs: Sequence[MotorRows]) -> float:
    """
    Return the relative error of the mean torque from readings in step with the commands.

    In step, the force has a ripple with the period of the readings, of an amplitude in proportion
    to the acceleration. Its values at the readings and a quarter of a period away give the
    amplitude, independent of the phase.
    """
    force = np.concatenate([rows.force - rows.force.mean() for rows in runs])
    ripples = np.vstack([
        rows.sampled_force - np.column_stack([rows.force, 0.25 * rows.period * rows.force_rate])
        for rows in runs])
    no_prior = Prior(np.zeros(1), np.full(1, np.inf))
    shares = [robust_regression(
        force[:, None], ripple, no_prior, model_sigma=np.zeros(len(force)),
        initial_sigma=TYPICAL_RIPPLE, hac_lags=hac_lags(runs)).estimate(0) for ripple in ripples.T]
    excess = sum(share.value ** 2 - share.sigma ** 2 for share in shares)  # over that of noise
    return SAMPLING_FACTOR * math.sqrt(max(excess, 0.0))
