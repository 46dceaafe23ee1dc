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

"""Prediction of the slip EKF by the IMU, and by the wheels during IMU dropouts."""

from __future__ import annotations

from collections.abc import Iterable

from smart_tire.estimation.slip.ekf import SlipFilter
from smart_tire.estimation.slip.film_slip_update import FilmSlipBuffer
from smart_tire.estimation.slip.imu_preprocessing import ImuPreprocessor, TrapezoidalMean
from smart_tire.estimation.slip.kinematics import SlipKinematics
from smart_tire.estimation.slip.odometry_buffer import Motion, OdometryBuffer
from smart_tire.estimation.slip.state import (
    ImuReading, ImuStep, SLIP_VELS, State, TRAVELS)
from smart_tire.estimation.slip.steering_efficiency import SteeringEfficiency
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.samples import Four, ImuSample

IMU_DROPOUT = 0.1            # s without IMU samples (or 3 periods), then predict by the wheels
ODOMETRY_YAW_CORRELATION_TIME = 2.0  # s, of the error of a yaw rate predicted by the wheels
UNKNOWN_ACCEL_DENSITY = 0.1  # (m/s2)^2 s, of an acceleration that is not measured
UNOBSERVED_SLIP_SHARE = 0.6  # of a ground speed change becomes slip velocity, standard deviation
UNOBSERVED_DEAD_BAND = 0.03  # m/s; a smaller change is noise


class BlindPrediction:
    """Substitute for the IMU in a dropout: yaw rate from the wheels, constant speed."""

    def __init__(self, track_width: float) -> None:
        self._track_width = track_width
        self._steering = SteeringEfficiency()
        self.active = False  # during a dropout

    def learn(self, side_speeds: tuple[float, float], yaw_rate: float, duration: float) -> None:
        """Add side speeds [m/s] and yaw rate [rad/s], means over ``duration`` [s]."""
        if not self.active:
            self._steering.update(self._odometry_yaw_rate(side_speeds), yaw_rate, duration)

    def step(self, slip_filter: SlipFilter, side_speeds: tuple[float, float],
             slope_sigma: float) -> ImuStep:
        """Return the expected IMU measurement for the side speeds [m/s]."""
        self.active = True
        W, sigma = self._steering.predict(self._odometry_yaw_rate(side_speeds))
        x = slip_filter.x
        expected = ImuReading(W + x[State.GYRO_BIAS_Z],
                              *slip_filter.motion_model.steady_force(x, W))
        return ImuStep(expected, 2.0 * sigma ** 2 * ODOMETRY_YAW_CORRELATION_TIME,
                       UNKNOWN_ACCEL_DENSITY, slope_sigma)

    def _odometry_yaw_rate(self, side_speeds: tuple[float, float]) -> float:
        """Return the yaw rate [rad/s] for these side speeds [m/s] without slip."""
        return (side_speeds[1] - side_speeds[0]) / self._track_width


class UnobservedSlip:
    """Slip velocity change since the last wheel sample, expected from the ground speeds."""

    def __init__(self, kinematics: SlipKinematics) -> None:
        self._kinematics = kinematics
        self.ground_speeds = (0.0, 0.0)  # m/s, of the sides, at the last wheel sample

    def sigma(self, x: list[float], gyro_z: float) -> tuple[float, float]:
        """Return the standard deviation [m/s] of each side's change up to the state ``x``."""
        now = self._kinematics.side_speeds(x, gyro_z)
        left, right = (UNOBSERVED_SLIP_SHARE * max(0.0, abs(new - old) - UNOBSERVED_DEAD_BAND)
                       for new, old in zip(now, self.ground_speeds))
        return left, right


class RollingSpeeds:
    """
    Predicted ``V_X`` plus slip velocity of both sides [m/s], without the steps of corrections.

    A correction holds for the past, too: going back from the present state, only the predicted
    changes are undone.
    """

    def __init__(self) -> None:
        self.corrections = (0.0, 0.0)         # m/s, sum of all so far
        self.predicted = (0.0, 0.0)           # m/s
        self._last: list[float] | None = None

    def step(self, before: list[float], after: list[float]) -> None:
        """Add a prediction step from the state ``before`` to ``after``."""
        last = self._last if self._last is not None else before
        self.corrections = tuple(  # type: ignore[assignment]
            correction + before[State.V_X] + before[row] - last[State.V_X] - last[row]
            for row, correction in zip(SLIP_VELS, self.corrections))
        self.predicted = tuple(  # type: ignore[assignment]
            after[State.V_X] + after[row] - correction
            for row, correction in zip(SLIP_VELS, self.corrections))
        self._last = after


class SlipPredictor:
    """Advances the filter through IMU samples and keeps the history of its motion."""

    def __init__(self, params: SlipEstimatorParams, slip_filter: SlipFilter,
                 films: FilmSlipBuffer | None) -> None:
        self._filter, self._films = slip_filter, films
        self._kinematics = SlipKinematics(params.robot)
        self.imu = ImuPreprocessor(params)
        self.blind = BlindPrediction(params.robot.track_width)
        self.unobserved_slip = UnobservedSlip(self._kinematics)
        self.odometry = OdometryBuffer()
        self.time = 0.0  # s, of the filter state
        self._rolling = RollingSpeeds()
        self.wheel_residual: Four = (0.0, 0.0, 0.0, 0.0)  # m/s, wheel minus mean of its side

    def predict(self, samples: Iterable[tuple[float, ImuSample]]
                ) -> list[tuple[float, ImuReading]]:
        """Predict through samples with times [s]; return the readings of those that are newer."""
        readings: list[tuple[float, ImuReading]] = []
        mean = TrapezoidalMean(self.time)
        for time, sample in samples:
            last = self.imu.reading
            reading = self.imu.add(time, sample)
            if reading is None:
                continue
            readings.append((time, reading))
            if last is None:
                self.time, mean = time, TrapezoidalMean(time)
                self.odometry.restart(time)
            else:
                mean.add(time, last, reading)
        step = self.imu.step(mean)
        if step is not None:
            self.blind.active = False
            dt = mean.end - self.time
            self._advance(mean.end, step)
            if self._filter.forces.enabled:
                self._filter.forces.correct_balance(
                    dt, readings[-1][1], self.imu.vibration, self.wheel_residual)
        return readings

    def travel_change(self, time: float) -> tuple[float, float]:
        """Return the travel [m] of both sides since ``time`` [s] beyond that at present speed."""
        lag = self.time - time
        mean = self.odometry.mean(min(time, self.time), max(time, self.time))
        if mean is None:
            return 0.0, 0.0
        left, right = self._rolling.predicted
        return lag * (mean.left - left), lag * (mean.right - right)

    def slip_change_sigma(self, gyro_z: float) -> tuple[float, float]:
        """Return the sigma [m/s] of both slip velocities in addition to the covariance."""
        if self._filter.forces.active:  # the force balance follows the slip
            return 0.0, 0.0
        return self.unobserved_slip.sigma(self._filter.x, gyro_z)

    def bridge_dropout(self, now: float, side_speeds: tuple[float, float]) -> None:
        """Predict to ``now`` [s] by the side speeds [m/s] if the IMU samples have stopped."""
        imu = self.imu
        if imu.time is None or now - imu.time <= max(IMU_DROPOUT, 3.0 * imu.period):
            return
        step = self.blind.step(self._filter, side_speeds, imu.slope_sigma)
        imu.reading = step.mean
        self._filter.forces.active = False
        self._advance(now, step)

    def _advance(self, end: float, step: ImuStep) -> None:
        dt, gyro_z = end - self.time, step.mean.yaw_rate
        before = self._filter.x
        self._filter.predict(dt, step)
        after = self._filter.x
        self.imu.slope.record_step(end, dt, step, after)
        rate = gyro_z - after[State.GYRO_BIAS_Z]
        self._rolling.step(before, after)
        self.odometry.append(end, Motion(
            0.5 * (before[State.V_X] + after[State.V_X]), rate, *(
                (after[row] - before[row]) / dt - correction
                for row, correction in zip(TRAVELS, self._rolling.corrections))))
        if self._films is not None:
            self._films.record_step(
                end, after[State.V_X] - before[State.V_X], step.accel_variance * dt, rate * dt,
                gyro_z, self._kinematics.wheel_speeds(after, gyro_z),
                self.slip_change_sigma(gyro_z), after[State.V_Y] - before[State.V_Y])
        self.time = end
