"""Slip estimator: IMU and wheel samples in, odometry, slip and ICR on a time grid out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
import math
from typing import Any, Protocol

from smart_tire.arrays import Array
from smart_tire.estimation.reorder_buffer import ReorderBuffer
from smart_tire.estimation.slip.ekf import SlipFilter
from smart_tire.estimation.slip.film_slip_update import FilmSlipBuffer
from smart_tire.estimation.slip.kinematics import SlipKinematics
from smart_tire.estimation.slip.odometry_buffer import OdometryBuffer
from smart_tire.estimation.slip.output import EstimateRecord, OutputContext, SlipOutputBuilder
from smart_tire.estimation.slip.radius_estimator import RadiusEstimator
from smart_tire.estimation.slip.robust_ekf import StateRecorder
from smart_tire.estimation.slip.state import ImuReading, ImuStep, State, WheelMeasurement
from smart_tire.estimation.slip.steering_efficiency import SteeringEfficiency
from smart_tire.estimation.slip.vibration import VibrationMonitor
from smart_tire.estimation.slip.wheel_odometry import WheelOdometry, WheelSpeeds
from smart_tire.estimation.slip.zero_velocity import UNWINDING_TIME, ZeroVelocityDetector
from smart_tire.models.vehicle.skid_steer import GRAVITY
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.rotation import matrix
from smart_tire.samples import (
    Friction, ImuSample, MAX_ANGULAR_RATE, MAX_SPECIFIC_FORCE, MAX_WHEEL_SPEED, NS_PER_S,
    WheelSample)

IMU_DROPOUT = 0.1  # s without IMU samples (or 3 periods), then predict by the wheels
ODOMETRY_YAW_CORRELATION_TIME = 2.0  # s, of the error of a yaw rate predicted by the wheels
UNKNOWN_ACCEL_DENSITY = 0.1  # (m/s2)^2 s, of an acceleration that is not measured
SPIKE_RATE = 5.0  # rad/s between two IMU samples; no robot yaws so abruptly
SPIKE_FORCE = 20.0  # m/s2 between two IMU samples, in addition to vibration
SPIKE_SIGMAS = 8.0  # standard deviations of the vibration
SLOPE_VIBRATION_SHARE = 0.25  # share of the vibration that is pitch and roll; assumed
UNOBSERVED_SLIP_SHARE = 0.3  # of a ground speed change becomes slip velocity, one sigma
UNOBSERVED_DEAD_BAND = 0.03  # m/s; a smaller change is noise
TRUSTED_STANDSTILL = 3.0  # s; longer standstill overrules a state that has diverged


class EstimatorRecorder(StateRecorder, Protocol):
    """Records state transitions, outputs and restarts for the RTS smoother."""

    def restart(self) -> None:
        """Start a new segment: the next state does not depend on the previous ones."""

    def record_output(self, context: OutputContext, x: Sequence[float], P: Array) -> None:
        """Record an output of the state after the last transition, by now ``x`` and ``P``."""


class SlipEstimator:
    """
    Slip estimator, to be updated with samples in any order within the reorder window.

    Estimates begin with the first grid instant at which both inputs have been received. With
    ``slip.film_aided``, slip measured by the films is used, too. A ``recorder`` receives what the
    RTS smoother needs.
    """

    def __init__(self, params: SlipEstimatorParams,
                 recorder: EstimatorRecorder | None = None) -> None:
        self._params = params
        self._recorder = recorder
        self._output = SlipOutputBuilder(params)
        self._kinematics = SlipKinematics(params.robot)
        self._rotation: list[list[float]] = matrix(*params.robot.imu.rotation).tolist()
        self._reorder_buffer = ReorderBuffer(round(params.reorder_window * NS_PER_S))
        self.dropped: Counter[str] = Counter()  # topic -> duplicates and rejected samples
        self.imu_spikes = 0  # IMU samples rejected as spikes
        self.films_used = 0  # crossings whose slip was used
        self.reset()

    def reset(self) -> None:
        """Return to the initial state; counters stay."""
        if self._recorder is not None:
            self._recorder.restart()
        robot = self._params.robot
        self._filter = SlipFilter(self._params, self._recorder)
        self._wheel_odometry = WheelOdometry(robot)
        self._zero_velocity = ZeroVelocityDetector(robot.imu.gyro_noise, robot.imu.accel_noise)
        self._odometry_buffer = OdometryBuffer()
        self._side_speeds_at_wheels = (0.0, 0.0)  # m/s, over ground, at the last wheel sample
        self._steering = SteeringEfficiency()
        self._radius = RadiusEstimator(robot)
        self._film_slips = FilmSlipBuffer(robot) if robot.slip.film_aided else None
        self._imu_lost = False              # during an IMU dropout
        self._origin_ns: int | None = None  # instant from which seconds are counted
        self._closed_ns = 0                 # latest grid instant
        self._time = 0.0                    # s, of the filter state
        self._wheel_time = 0.0              # s, center of the period of the last wheel sample
        self._imu_time: float | None = None
        self._imu: ImuReading | None = None  # last rate z, force x, y
        self._imu_period = 0.01             # s, smoothed; initial value assumed
        self._vibration = VibrationMonitor(robot.imu.accel_noise)
        self._last_was_spike = False        # whether the last IMU sample was a spike
        self._stationary = False
        self._handled_resets = self._reorder_buffer.resets

    def reset_odometry(self) -> None:
        """Set the pose to the origin of ``odom``; biases and slips stay."""
        self._filter.reset_pose()

    @property
    def late(self) -> Counter[str]:
        """Return the count of samples per topic that arrived after their instant was processed."""
        return self._reorder_buffer.late

    def status(self) -> dict[str, str | int | float]:
        """Return the values for diagnostics."""
        return {
            'state': ('waiting for imu/data' if self._imu is None else
                      'waiting for wheel_states' if not self._wheel_odometry.started else
                      'stationary' if self._stationary else 'moving'),
            'normalised_innovation_squared': round(self._filter.nis, 3),
            'gyro_bias': round(self._filter.x[State.GYRO_BIAS_Z], 6),
            'rolling_radius': round(self._radius.radius, 6),
            'clock_jumps': self._reorder_buffer.resets,
            'position_jumps': self._wheel_odometry.position_jumps,
            'imu_spikes': self.imu_spikes,
            **({} if self._film_slips is None else {'films_used': self.films_used}),
            **{f'dropped.{topic}': count for topic, count in self.dropped.items()},
        }

    def update(self, sample: ImuSample | WheelSample | Friction) -> list[EstimateRecord]:
        """Add a sample; return the estimates of the grid instants that it completes."""
        if isinstance(sample, Friction):
            self._on_friction(sample)
            return []
        topic = 'imu/data' if isinstance(sample, ImuSample) else 'wheel_states'
        if not _is_possible(sample):
            self.dropped[topic] += 1
            return []
        closed = self._reorder_buffer.push(topic, sample.stamp_ns, sample)
        if self._reorder_buffer.resets != self._handled_resets:
            self.reset()
        estimates: list[EstimateRecord] = []
        for instant_ns, samples in closed:
            self._step(instant_ns, samples)
            if self._imu is not None and self._wheel_odometry.started:
                estimates += self._estimates(instant_ns)
        return estimates

    def _step(self, instant_ns: int, samples: list[Any]) -> None:
        if self._origin_ns is None:
            self._origin_ns = instant_ns
        imu = [s for s in samples if isinstance(s, ImuSample)]
        if imu:
            self._on_imu(imu)
        now = self._seconds(instant_ns)
        if self._imu_time is not None and now - self._imu_time > max(
                IMU_DROPOUT, 3.0 * self._imu_period):
            self._predict_blind(now)
        for sample in samples:
            if isinstance(sample, WheelSample):
                self._on_wheels(sample)
        if self._film_slips is not None:
            self._use_films(self._film_slips, instant_ns)
        self._closed_ns = instant_ns

    def _on_friction(self, sample: Friction) -> None:
        if self._film_slips is None or self._origin_ns is None:
            return
        if not self._film_slips.add(sample, self._seconds(sample.stamp_ns), self._closed_ns):
            self._reorder_buffer.late['tire_friction'] += 1

    def _use_films(self, films: FilmSlipBuffer, instant_ns: int) -> None:
        for film in films.pop_due(instant_ns):
            delayed = films.delayed_speed(film, self._seconds(film.stamp_ns))
            if delayed is not None:
                self._filter.correct_delayed_speed(delayed)
                self.films_used += 1

    def _seconds(self, stamp_ns: int) -> float:
        assert self._origin_ns is not None
        return (stamp_ns - self._origin_ns) / NS_PER_S

    def _on_imu(self, samples: list[ImuSample]) -> None:
        """Predict through the samples of one grid step with their trapezoidal mean."""
        end, count, step_variance = self._time, 0, 0.0
        sums = [0.0, 0.0, 0.0]
        for sample in samples:
            time = self._seconds(sample.stamp_ns)
            if self._imu_time is not None and time <= self._imu_time:
                self.dropped['imu/data'] += 1
                continue
            reading = self._without_spike(self._in_base_axes(sample))
            self._zero_velocity.update(time, reading)
            self._vibration.update(time, sample.acceleration[2])
            if self._imu is None or self._imu_time is None:
                self._time = end = time
                self._odometry_buffer.restart(time)
            elif time > end:
                half = 0.5 * (time - end)
                sums = [total + half * (old + new)
                        for total, old, new in zip(sums, self._imu, reading)]
                # variance if it changed stepwise at an unknown time between the samples
                step_variance += (time - end) ** 2 / 12.0 * max(
                    (reading[1] - self._imu[1]) ** 2, (reading[2] - self._imu[2]) ** 2)
                self._imu_period += 0.02 * (min(time - self._imu_time, 1.0) - self._imu_period)
                end, count = time, count + 1
            self._imu, self._imu_time = reading, time
        if count:
            self._imu_lost = False
            self._predict(end, sums, count, step_variance)

    def _without_spike(self, reading: ImuReading) -> ImuReading:
        """
        Return ``reading``, or the previous one if this is a single spike.

        A real impact lasts longer: a second such reading in a row is accepted.
        """
        last = self._imu
        spike = last is not None and not self._last_was_spike and (
            abs(reading[0] - last[0]) > SPIKE_RATE
            or max(abs(reading[1] - last[1]), abs(reading[2] - last[2]))
            > SPIKE_FORCE + SPIKE_SIGMAS * self._vibration.sigma)
        self._last_was_spike = spike
        if last is None or not spike:
            return reading
        self.imu_spikes += 1
        return last

    def _in_base_axes(self, sample: ImuSample) -> ImuReading:
        (f_x, f_y, f_z), (w_x, w_y, w_z) = sample.acceleration, sample.rate
        x, y, z = self._rotation
        return ImuReading(
            z[0] * w_x + z[1] * w_y + z[2] * w_z,
            x[0] * f_x + x[1] * f_y + x[2] * f_z, y[0] * f_x + y[1] * f_y + y[2] * f_z)

    def _predict(self, end: float, sums: Sequence[float], count: int,
                 step_variance: float) -> None:
        """Predict to ``end`` [s]; ``step_variance`` [m2/s2] is that of speed due to jerk."""
        dt, imu = end - self._time, self._params.robot.imu
        rate, force_x, force_y = (total / dt for total in sums)
        period = dt / count  # white noise per sample becomes noise density
        vibration = self._vibration.sigma
        self._advance(end, ImuStep(
            ImuReading(rate, force_x, force_y), imu.gyro_noise ** 2 * period,
            (imu.accel_noise ** 2 + vibration ** 2) * period + step_variance / dt,
            self._slope_sigma(vibration)))

    def _slope_sigma(self, vibration: float) -> float:
        return math.hypot(self._params.slope_sigma, SLOPE_VIBRATION_SHARE * vibration / GRAVITY)

    def _predict_blind(self, now: float) -> None:
        """Predict without the IMU: yaw rate from the wheels, zero acceleration."""
        x = self._filter.x
        odometry_rate = self._odometry_yaw_rate(self._wheel_odometry.side_speeds)
        W, sigma = self._steering.predict(odometry_rate)
        self._imu = ImuReading(W + x[State.GYRO_BIAS_Z],
                               *self._filter.motion_model.steady_force(x, W))
        self._imu_lost = True
        self._advance(now, ImuStep(
            self._imu, 2.0 * sigma ** 2 * ODOMETRY_YAW_CORRELATION_TIME, UNKNOWN_ACCEL_DENSITY,
            self._slope_sigma(self._vibration.sigma)))

    def _odometry_yaw_rate(self, sides: tuple[float, float]) -> float:
        """Return the yaw rate [rad/s] for these side speeds [m/s] without slip."""
        return (sides[1] - sides[0]) / self._params.robot.track_width

    def _advance(self, end: float, step: ImuStep) -> None:
        dt = end - self._time
        before = self._filter.x
        self._filter.predict(dt, step)
        after = self._filter.x
        rate = step.mean.yaw_rate - after[State.GYRO_BIAS_Z]
        self._odometry_buffer.append(end, 0.5 * (before[State.V_X] + after[State.V_X]), rate)
        if self._film_slips is not None:
            self._film_slips.record_step(
                end, after[State.V_X] - before[State.V_X], step.accel_variance * dt, rate * dt,
                step.mean.yaw_rate, self._kinematics.wheel_speeds(after, step.mean.yaw_rate),
                self._slip_change_sigma(step.mean.yaw_rate))
        self._time = end

    def _on_wheels(self, sample: WheelSample) -> None:
        time = self._seconds(sample.stamp_ns) - self._params.robot.encoder.latency
        wheels = self._wheel_odometry.update(time, sample)
        if wheels is None:
            self.dropped['wheel_states'] += 1
            return
        if self._imu is None:
            return
        self._wheel_time = time - 0.5 * wheels.duration
        standstill = self._zero_velocity.detect(time, max(map(abs, wheels.wheel_speeds)))
        self._stationary = standstill is not None and (
            standstill.duration > TRUSTED_STANDSTILL or self._is_slow())
        if standstill is not None and self._stationary:
            self._filter.correct_zero_velocity()
            if standstill.rate_settled:  # means overlap: the weight is that of the new part
                sigma = self._params.robot.imu.gyro_noise * math.sqrt(
                    self._imu_period / wheels.duration)
                unwinding = standstill.unwinding_sigma * math.sqrt(
                    UNWINDING_TIME / wheels.duration)
                self._filter.correct_gyro_bias(
                    standstill.rate, math.hypot(max(sigma, standstill.sigma), unwinding))
        mean = self._odometry_buffer.mean(time - wheels.duration, time)
        if mean is not None:
            if not self._imu_lost:
                self._steering.update(
                    self._odometry_yaw_rate(wheels.side_speeds), mean[1], wheels.duration)
            half = 0.5 * self._params.robot.track_width * mean[1]
            center = mean[0] + self._params.robot.imu.position[1] * mean[1]
            self._side_speeds_at_wheels = center - half, center + half
            self._filter.correct_wheels(WheelMeasurement(
                wheels.duration, wheels.side_speeds, *mean, wheels.variance,
                wheels.from_positions))
            if not self._stationary:
                self._correct_free_rolling(wheels)
        self._filter.correct_lateral(self._imu.yaw_rate, wheels.duration)

    def _correct_free_rolling(self, wheels: WheelSpeeds) -> None:
        """Correct slip and wheel radius with the free-rolling prior."""
        assert self._imu is not None
        prior = self._filter.correct_free_rolling(
            wheels.duration, self._imu.yaw_rate, self._radius.variance)
        if prior is not None:
            forward = math.copysign(1.0, sum(wheels.side_speeds))
            self._radius.update(forward * prior.slip, prior.variance + prior.prior_variance,
                                prior.firm_probability, wheels.duration)
            self._wheel_odometry.radius = self._radius.radius

    def _is_slow(self) -> bool:
        """Return whether the estimated speed is compatible with standstill."""
        x, P = self._filter.x, self._filter.P
        limit = self._params.robot.slip.standstill_speed
        return all(abs(x[row]) < limit + 3.0 * math.sqrt(P[row, row])
                   for row in (State.V_X, State.V_Y))

    def _estimates(self, instant_ns: int) -> list[EstimateRecord]:
        assert self._imu is not None
        extrapolation = self._seconds(instant_ns) - self._time
        context = OutputContext(
            instant_ns, extrapolation, self._imu, self._vibration.sigma,
            self._wheel_odometry.wheel_residual, self._time, self._wheel_time)
        if self._recorder is not None:
            self._recorder.record_output(context, self._filter.x, self._filter.P)
        return self._output.build(
            context, self._filter.x, self._filter.P, self._slip_change_sigma(self._imu.yaw_rate))

    def _slip_change_sigma(self, gyro_z: float) -> tuple[float, float]:
        """Return sigma [m/s] of each side's slip velocity change since the last wheel sample."""
        now = self._kinematics.side_speeds(self._filter.x, gyro_z)
        left, right = (UNOBSERVED_SLIP_SHARE * max(0.0, abs(new - old) - UNOBSERVED_DEAD_BAND)
                       for new, old in zip(now, self._side_speeds_at_wheels))
        return left, right


def _is_possible(sample: ImuSample | WheelSample) -> bool:
    """Return whether a robot can have produced ``sample``; False for NaN."""
    if isinstance(sample, ImuSample):
        return (all(abs(force) <= MAX_SPECIFIC_FORCE for force in sample.acceleration)
                and all(abs(rate) <= MAX_ANGULAR_RATE for rate in sample.rate))
    return all(abs(speed) <= MAX_WHEEL_SPEED for speed in sample.velocity)
