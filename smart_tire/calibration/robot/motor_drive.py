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
Motor torque between its measurements, from the duty.

Between two commands the torque of a motor falls while the wheel accelerates. Readings at the rate
of the commands see it always at the same phase: in acceleration their mean is wrong by up to 20 %
for the paper's robot at 16 Hz. The duty is known at all times, and the torque of a brushed motor
is ``tau = k (duty - w / w_0)``, with the stall torque k and the free speed w_0. First w_0 follows
from means over windows, in which acceleration, force and friction stand for the torque. Then k, in
the unit of the measured torque, follows from torque, duty and speed at the same instants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.robot.motor_rows import COMMAND_DELAY, MotorRows, own_columns
from smart_tire.errors import EstimatorError
from smart_tire.numerics.regression import Prior, robust_regression
from smart_tire.uncertain import Uncertain

MIN_ROWS = 30                # below this number the residuals do not determine their noise
TYPICAL_DUTY_NOISE = 0.01    # first value of the standard deviation of a row
TYPICAL_TORQUE_NOISE = 0.05  # N m, first value, of a reading
TYPICAL_STALL_TORQUE = 5.0   # N m, for the weights of rows
TYPICAL_SPEED_GAIN = 0.05    # s/rad, for the weights of rows
READING_DELAY = 0.002  # s from the encoders to the currents: boards are read in turn; assumed
SLIP_SHARE = 0.2  # relative sigma of the slip's share of a wheel speed: C_x, patch and load
HAC_TIME = 1.0    # s over which the residuals of windows may be correlated
# columns of the regression of the duty; an offset of each recording follows
SPEED, ACCELERATION, FORCE, DIRECTION = range(4)


@dataclass(frozen=True)
class DriveFit:
    """Relation of duty, speed and measured torque of each motor."""

    stall_torque: Array      # (4,) N m at full duty, in the unit of the measured torque
    offset: Array            # (4,) N m, of the measured torque
    speed_gain: Array        # (4,) s/rad, duty per speed: 1 / free speed
    relative_sigma: float    # of the common factor of the stall torques, from noise
    viscous_sigma: float     # N m s/rad, of ``torque`` over speed, from ``speed_gain``

    def torque(self, rows: MotorRows, delay_error: float) -> Array:
        """
        Return the mean torques [N m] (n, 4) of the rows in the unit of the measured one.

        ``delay_error`` [s] is the delay of the commands in addition to ``COMMAND_DELAY``.
        """
        duty = rows.duty - (COMMAND_DELAY + delay_error) * rows.duty_rate
        return np.asarray(self.offset + self.stall_torque * (duty - self.speed_gain * rows.speed))

    def torque_sigma(self, rows: MotorRows) -> Array:
        """Return the standard deviation [N m] (n, 4) of ``torque`` from the speed."""
        return np.asarray(self.stall_torque * self.speed_gain * rows.speed_sigma)


def fit_drive(runs: Sequence[MotorRows], slip_error: float = 0.0,
              delay_error: float = 0.0) -> DriveFit:
    """
    Return the relation of torque and duty from runs on the ground.

    ``slip_error`` is the relative error of the slip in the speed at an instant, ``delay_error``
    [s] the delay of the currents in addition to ``READING_DELAY``. Raises EstimatorError with the
    reason if the relation is not observable.
    """
    gains = fit_speed_gains(runs)
    stall, offset, sigma = (np.array(column) for column in zip(*(
        _fit_torque(runs, wheel, gain.value, slip_error, READING_DELAY + delay_error)
        for wheel, gain in enumerate(gains))))
    if not (stall > 0.0).all():
        raise EstimatorError('the torque does not follow the duty')
    return DriveFit(
        stall, offset, np.array([gain.value for gain in gains]),
        float(np.linalg.norm(sigma / stall)) / 4.0, float(stall.mean()) * mean_gain(gains).sigma)


def fit_speed_gains(runs: Sequence[MotorRows]) -> list[Uncertain]:
    """Return the duty per speed [s/rad] of each motor; EstimatorError if not observable."""
    if sum(len(rows.time) for rows in runs) < MIN_ROWS or any(
            np.isnan(rows.duty).any() for rows in runs):
        raise EstimatorError('requires motor_commands during motion')
    return [_fit_speed_gain(runs, wheel) for wheel in range(4)]


def mean_gain(gains: Sequence[Uncertain]) -> Uncertain:
    """Return the mean of the motors, whose errors from timestamps are the same."""
    values = np.array([gain.value for gain in gains])
    common = float(np.mean([gain.sigma ** 2 for gain in gains]))
    return Uncertain(float(values.mean()), math.sqrt(common + float(values.var(ddof=1)) / 4.0))


def _fit_speed_gain(runs: Sequence[MotorRows], wheel: int) -> Uncertain:
    """Return the duty per speed [s/rad] of one motor."""
    matrix = np.column_stack([
        np.concatenate([rows.speed[:, wheel] for rows in runs]),
        np.concatenate([rows.acceleration[:, wheel] for rows in runs]),
        np.concatenate([rows.force for rows in runs]),
        np.concatenate([rows.direction[:, wheel] for rows in runs]), own_columns(runs)])
    target = np.concatenate([
        rows.duty[:, wheel] - COMMAND_DELAY * rows.duty_rate[:, wheel] for rows in runs])
    sigma = np.concatenate([rows.speed_sigma[:, wheel] for rows in runs])
    return robust_regression(
        matrix, target, _no_prior(matrix), model_sigma=TYPICAL_SPEED_GAIN * sigma,
        initial_sigma=TYPICAL_DUTY_NOISE, hac_lags=hac_lags(runs)).estimate(SPEED)


def _fit_torque(runs: Sequence[MotorRows], wheel: int, speed_gain: float,
                slip_error: float, reading_delay: float) -> tuple[float, float, float]:
    """Return stall torque, offset, and standard error of the former [N m] of one motor."""
    torque, duty, speed, slip, acceleration = (
        np.concatenate([getattr(rows, name)[:, wheel] for rows in runs]) for name in (
            'center_torque', 'center_duty', 'center_speed', 'center_slip', 'acceleration'))
    known = ~(np.isnan(torque) | np.isnan(duty))
    if known.sum() < MIN_ROWS:
        raise EstimatorError('all torques are measured within a few milliseconds of a change of '
                             'the duty')
    speed = speed + slip_error * slip + reading_delay * acceleration
    matrix = np.column_stack([duty - speed_gain * speed, np.ones(len(duty))])[known]
    model_sigma = TYPICAL_STALL_TORQUE * SLIP_SHARE * speed_gain * np.abs(slip[known])
    fit = robust_regression(
        matrix, torque[known], _no_prior(matrix), model_sigma=model_sigma,
        initial_sigma=TYPICAL_TORQUE_NOISE, hac_lags=hac_lags(runs))
    stall, offset = fit.estimate(0), fit.estimate(1)
    return stall.value, offset.value, stall.sigma


def _no_prior(matrix: Array) -> Prior:
    return Prior(np.zeros(matrix.shape[1]), np.full(matrix.shape[1], np.inf))


def hac_lags(runs: Sequence[MotorRows]) -> int:
    """Return the number of neighbors whose residuals may be correlated."""
    step = float(np.median(np.concatenate([np.diff(rows.time) for rows in runs])))
    return max(math.ceil(HAC_TIME / step), max(rows.lags for rows in runs))
