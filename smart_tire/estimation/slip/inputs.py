# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, cdivision=True, infer_types=True, initializedcheck=False
# cython: show_performance_hints=False

"""
IMU and wheel samples to what the slip filter takes: steps, side speeds, standstill.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
import math

from smart_tire.estimation.plausibility import is_imu_spike, is_speed_contradicted
from smart_tire.estimation.slip import state
from smart_tire.estimation.slip.kalman import LearnedVariance
from smart_tire.estimation.slip.state import (
    ImuReading, ImuStep, LEARNING_TIME, MAX_SAMPLE_GAP, MAX_STATIONARY_WHEEL_SPEED,
    OUTLIER_SIGMAS, SPEED_WALK, UNWINDING_SHARE, UNWINDING_TIME)
from smart_tire.parameters import RobotParams
from smart_tire.rotation import matrix
from smart_tire.samples import Four, four, ImuSample, Vector3, WheelSample
from smart_tire.uncertain import Uncertain

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.libc.math import exp, expm1, sqrt
else:
    from math import exp, expm1, sqrt

COMPILED: bool = cython.compiled

# constants that are numbers of C
cython.declare(
    DRIVE_JERK=cython.double, IMU_WINDOW=cython.double, MODEL_TIME=cython.double,
    PERIOD_GAIN=cython.double, QUIET_TIME=cython.double, RESIDUAL_GAIN=cython.double,
    TYPICAL_PERIOD=cython.double)
DRIVE_JERK, IMU_WINDOW, MODEL_TIME = state.DRIVE_JERK, state.IMU_WINDOW, state.MODEL_TIME
PERIOD_GAIN, QUIET_TIME = state.PERIOD_GAIN, state.QUIET_TIME
RESIDUAL_GAIN, TYPICAL_PERIOD = state.RESIDUAL_GAIN, state.TYPICAL_PERIOD


@cython.cclass
class Period:
    """Smoothed period of samples; gaps hardly change it."""

    _measured: cython.bint
    value = cython.declare(cython.double, visibility='readonly')

    def __init__(self) -> None:
        self._measured = False
        self.value = TYPICAL_PERIOD  # s

    @cython.ccall
    def add_gap(self, gap: cython.double) -> None:
        """Add the time [s] between two samples."""
        if self._measured:
            self.value += PERIOD_GAIN * (min(gap, 2.0 * self.value) - self.value)
        else:
            self.value, self._measured = gap, True


class SpikeFilter:
    """Replaces single spikes; two in a row are an impact."""

    def __init__(self) -> None:
        self._last_was_spike = False
        self.count = 0

    def clean(self, reading: ImuReading, last: ImuReading | None, vibration: float) -> ImuReading:
        """Return ``reading``, or the ``last`` one if it is a spike at a vibration [m/s2]."""
        spike = last is not None and not self._last_was_spike and is_imu_spike(
            reading.yaw_rate - last.yaw_rate, reading.force_x - last.force_x,
            reading.force_y - last.force_y, vibration)
        self._last_was_spike = spike
        if last is None or not spike:
            return reading
        self.count += 1
        return last


@cython.cclass
class ImuInput:
    """
    Rotates IMU samples into base axes, replaces spikes and integrates them over steps.

    ``vibration`` is the standard deviation of the vertical force beyond the IMU's noise: planar
    motion does not excite it, while rough ground vibrates all axes alike.
    """

    _rotation: cython.double[9]
    _gyro_scale: cython.double
    _gyro_noise: cython.double
    _accel_noise: cython.double
    _spikes = cython.declare(object)
    _sampled: cython.bint
    _last_time: cython.double
    _mean: cython.double      # m/s2, of the vertical force
    _variance: cython.double
    _begin_rate: cython.double
    period = cython.declare(Period, visibility='readonly')
    reading = cython.declare(object, visibility='readonly')
    force = cython.declare(object, visibility='readonly')
    yaw_accel = cython.declare(cython.double, visibility='readonly')
    turn_rate = cython.declare(cython.double, visibility='readonly')
    vibration = cython.declare(cython.double, visibility='readonly')

    def __init__(self, robot: RobotParams) -> None:
        self._rotation = matrix(*robot.imu.rotation).ravel().tolist()
        self._gyro_scale, self._gyro_noise = robot.imu.gyro_scale, robot.imu.gyro_noise
        self._accel_noise = robot.imu.accel_noise
        self._spikes = SpikeFilter()
        self._sampled = False
        self._last_time = self._mean = self._variance = 0.0
        self.reading = None     # last one, or its substitute in a dropout
        self.period = Period()
        self.yaw_accel = 0.0    # rad/s2
        self.turn_rate = 0.0    # rad/s, yaw rate smoothed over ``MODEL_TIME``
        self._begin_rate = 0.0  # rad/s, that at the begin of the step
        self.force = None       # m/s2, x and y without vibration
        self.vibration = 0.0    # m/s2

    @property
    def time(self) -> float | None:
        """Return the time [s] of the last sample."""
        return self._last_time if self._sampled else None

    def add_sample(self, time: cython.double, sample: ImuSample) -> ImuReading | None:
        """Add a sample of ``time`` [s]; return its reading, None if it is not newer."""
        if self._sampled and time <= self._last_time:
            return None
        last = self.reading
        reading = self._spikes.clean(self.in_base_axes(sample), last, self.vibration)
        dt = min(time - self._last_time, IMU_WINDOW) if self._sampled else self.period.value
        self._measure_vibration(sample.acceleration[2], dt)
        rate: cython.double = reading[0]
        if self._sampled and last is not None:
            before: cython.double = last[0]
            self.period.add_gap(dt)
            self.yaw_accel = (rate - before) / dt
        self.turn_rate += dt / (dt + MODEL_TIME) * (rate - self.turn_rate)
        self._sampled, self._last_time, self.reading = True, time, reading
        return reading

    @property
    def spikes(self) -> int:
        """Return the number of samples that were replaced as spikes."""
        return self._spikes.count

    def bridge(self, reading: ImuReading, dt: float, rate_density: float, accel_density: float
               ) -> ImuStep:
        """
        Return the step over ``dt`` [s] of a dropout, with a substitute for the reading.

        Densities of its errors are in (rad/s)^2 s and (m/s2)^2 s.
        """
        begin_rate, self.reading, self.force = self._begin_rate, reading, None
        self.turn_rate += dt / (dt + MODEL_TIME) * (reading.yaw_rate - self.turn_rate)
        self._begin_rate = self.turn_rate
        return ImuStep(dt, reading, rate_density, accel_density, begin_rate, self.turn_rate)

    def step(self, begin: float, readings: Sequence[tuple[float, ImuReading]]) -> ImuStep:
        """
        Return the mean over linearly interpolated ``readings`` with their times [s].

        The first one is the last of the previous step, which ended at ``begin`` [s].
        """
        begin_rate, self._begin_rate = self._begin_rate, self.turn_rate
        rate = x = y = shape = 0.0
        first, last = readings[0], readings[0][1]
        duration: cython.double = readings[-1][0] - first[0]
        old_rate: cython.double = last[0]
        old_x: cython.double = last[1]
        old_y: cython.double = last[2]
        for time, reading in readings[1:]:
            end: cython.double = time
            new_rate: cython.double = reading[0]
            new_x: cython.double = reading[1]
            new_y: cython.double = reading[2]
            dt = end - begin
            rate += 0.5 * dt * (old_rate + new_rate)
            x += 0.5 * dt * (old_x + new_x)
            y += 0.5 * dt * (old_y + new_y)
            # variance if the force changed stepwise at an unknown time between the samples
            change = max(abs(new_x - old_x), abs(new_y - old_y))
            shape += dt * dt / 12.0 * (change * change)
            begin, old_rate, old_x, old_y = end, new_rate, new_x, new_y
        period = duration / (len(readings) - 1)
        own = self._force_variance() * period
        force_x, force_y = self._without_vibration(x / duration, y / duration, duration, own)
        return ImuStep(
            duration, ImuReading(rate / duration, force_x, force_y),
            self._gyro_noise * self._gyro_noise * period, own + shape / duration, begin_rate,
            self.turn_rate)

    def _without_vibration(self, force_x: cython.double, force_y: cython.double,
                           dt: cython.double, density: cython.double) -> tuple[float, float]:
        """
        Return the force of the motion: the steady Kalman filter of a random walk in white noise.

        Vibration and pitching that are integrated between wheel samples would be taken for motion.
        """
        time = sqrt(density) / DRIVE_JERK
        gain = -expm1(-dt / time) if time > 0.0 else 1.0
        last = self.force
        x: cython.double = force_x if last is None else last[0]
        y: cython.double = force_y if last is None else last[1]
        force = x + gain * (force_x - x), y + gain * (force_y - y)
        self.force = force
        return force

    @property
    def force_variance(self) -> float:
        """Return the variance [(m/s2)^2] of a horizontal force: noise and vibration."""
        return self._force_variance()

    @cython.cfunc
    def _force_variance(self) -> cython.double:
        return self._accel_noise * self._accel_noise + self.vibration * self.vibration

    @property
    def yaw_accel_variance(self) -> float:
        """Return the variance [(rad/s2)^2] of the yaw acceleration: noise of two samples."""
        noise = self._gyro_noise / self.period.value
        return 2.0 * (noise * noise)

    @cython.cfunc
    def _measure_vibration(self, force: cython.double, dt: cython.double) -> cython.void:
        if not self._sampled:
            self._mean, self._variance = force, 0.0
        gain = 1.0 - exp(-dt / IMU_WINDOW)
        deviation = force - self._mean
        self._mean += gain * deviation
        self._variance += gain * (deviation * deviation - self._variance)
        self.vibration = sqrt(max(
            self._variance - 2.0 * (self._accel_noise * self._accel_noise), 0.0))

    def in_base_axes(self, sample: ImuSample) -> ImuReading:
        """Return the reading of a sample."""
        force = sample.acceleration
        return ImuReading(self._along(2, sample.rate) / self._gyro_scale, self._along(0, force),
                          self._along(1, force))

    @cython.cfunc
    def _along(self, axis: cython.int, vector: Vector3) -> cython.double:
        """Return the component of ``vector``, in the axes of the IMU, along one of the base."""
        x: cython.double = vector[0]
        y: cython.double = vector[1]
        z: cython.double = vector[2]
        return (self._rotation[3 * axis] * x + self._rotation[3 * axis + 1] * y
                + self._rotation[3 * axis + 2] * z)


@dataclass(frozen=True, slots=True)
class WheelSpeeds:
    """Mean speeds over the period that ends at a wheel sample."""

    duration: float                   # s
    wheel_speeds: Four                # m/s, r w; that of the side for a wheel not measured
    side_speeds: tuple[float, float]  # m/s, left and right
    variance: float                   # (m/s)^2 of a side speed, due to quantization
    from_positions: bool              # positions were differenced, so timestamp errors matter


class WheelOdometry:
    """
    Differences positions, or takes velocities if there are no positions.

    Velocities are means over the period that ends at the stamp: after a lost message they still
    describe one period, while positions bridge the gap. The speed of a side is the mean of its
    wheels that are measured.
    """

    def __init__(self, robot: RobotParams) -> None:
        self._radius = robot.wheel_radius  # m, effective rolling radius
        self._count = 2.0 * math.pi / robot.encoder.counts_per_revolution * robot.wheel_radius
        self._encoders = robot.joints.encoders_per_side
        self._last: tuple[float, WheelSample] | None = None
        self._period = Period()
        self._speeds: Four = (0.0, 0.0, 0.0, 0.0)         # m/s, latest
        self._speed_walk = LearnedVariance(SPEED_WALK, SPEED_WALK, LEARNING_TIME)  # (m/s)^2 per s
        self.side_speeds = (0.0, 0.0)                     # m/s, latest
        self.wheel_residual: Four = (0.0, 0.0, 0.0, 0.0)  # m/s, wheel minus mean of its side
        self.independent = False  # the sides differed once; otherwise both are only their mean
        self.position_jumps = 0

    @property
    def started(self) -> bool:
        """Return whether there has been a sample."""
        return self._last is not None

    def staleness(self, now: float) -> tuple[float, float]:
        """Return age [s] of the side speeds, and variance [(m/s)^2] if held until ``now`` [s]."""
        age = 0.0 if self._last is None else max(now - self._last[0], 0.0)
        return age, self._speed_walk.variance * age

    def add_sample(self, time: float, sample: WheelSample) -> WheelSpeeds | None:
        """Add a sample of ``time`` [s]; return the mean speeds, None if it is not newer."""
        radius: cython.double = self._radius
        speeds = four([radius * one for one in sample.velocity])
        if self._last is None:
            self._last = (time, sample)
            return self._mean_speeds(self._period.value, speeds)
        before, previous = self._last
        if time <= before:
            return None
        gap, self._last = time - before, (time, sample)
        self._period.add_gap(gap)
        rolled = self._position_differences(previous, sample, gap)
        if rolled is not None and gap < MAX_SAMPLE_GAP:
            return self._mean_speeds(gap, rolled, from_positions=True)
        return self._mean_speeds(gap, speeds, missing=max(gap - self._period.value, 0.0))

    def _position_differences(self, previous: WheelSample, sample: WheelSample,
                              gap: float) -> Four | None:
        if previous.position is None or sample.position is None:
            return None
        rates = [(new - old) / gap for old, new in zip(previous.position, sample.position)]
        if any(map(is_speed_contradicted, rates, sample.velocity)):
            self.position_jumps += 1
            return None
        radius: cython.double = self._radius
        return four([radius * rate for rate in rates])

    def _mean_speeds(self, duration: float, speeds: Four, *, missing: float = 0.0,
                     from_positions: bool = False) -> WheelSpeeds:
        """Return means over ``duration`` [s]; the ``missing`` part [s] of it is interpolated."""
        sides = _side_mean(speeds[0], speeds[2]), _side_mean(speeds[1], speeds[3])
        share: cython.double = 0.5 * missing / duration  # of the sample before in the mean
        used, means, residuals = [], [], []
        for i in range(4):
            side: cython.double = sides[i % 2]
            speed: cython.double = speeds[i]
            residual: cython.double = self.wheel_residual[i]
            before: cython.double = self._speeds[i]
            if speed != speed:  # not measured
                speed = side
            used.append(speed)
            residuals.append(residual + RESIDUAL_GAIN * (speed - side - residual))
            means.append(speed + share * (before - speed))
        self.independent = self.independent or sides[0] != sides[1]
        self.wheel_residual = four(residuals)
        change = max(abs(sides[0] - self.side_speeds[0]), abs(sides[1] - self.side_speeds[1]))
        # both ends are uniform over a count; a side is the mean of its encoders
        variance = ((self._count / duration) ** 2 / (6.0 * self._encoders)
                    + self._speed_walk.variance * missing ** 3 / (12.0 * duration ** 2))
        self._speed_walk.add_square(change ** 2 / duration, duration)
        self.side_speeds, self._speeds = sides, four(used)
        return WheelSpeeds(duration, four(means),
                           (0.5 * (means[0] + means[2]), 0.5 * (means[1] + means[3])),
                           variance, from_positions)


@dataclass(frozen=True, slots=True)
class StationaryInterval:
    """The present standstill, up to now."""

    rate: Uncertain | None  # rad/s, mean of the rates about z since the one before: the gyro bias
    unwinding_sigma: float  # rad/s, of a residual yaw motion, correlated over about a second
    duration: float         # s


class ZeroVelocityDetector:
    """
    Detects standstill: stationary wheels and a quiet IMU for some time.

    A robot pushed at constant speed with locked wheels satisfies both; the caller must also check
    that the estimated speed is small, or that standstill has lasted.
    """

    def __init__(self, gyro_noise: float, accel_noise: float) -> None:
        self._noise = gyro_noise
        self._limits = (OUTLIER_SIGMAS * gyro_noise, *(OUTLIER_SIGMAS * accel_noise,) * 2)
        self._window: deque[tuple[float, ImuReading]] = deque()
        self._rates: deque[float] = deque()  # rad/s, those of the window
        self._quiet_since: float | None = None
        self._counted = -math.inf  # s, up to which rates were part of a mean
        self._last_turn: tuple[float, float] | None = None  # time [s] and yaw rate [rad/s]

    def add_reading(self, time: float, reading: ImuReading) -> None:
        """Add an IMU reading at ``time`` [s]."""
        window = self._window
        window.append((time, reading))
        self._rates.append(reading.yaw_rate)
        while window[0][0] < time - IMU_WINDOW:
            window.popleft()
            self._rates.popleft()

    def detect(self, time: float, wheel_speed: float) -> StationaryInterval | None:
        """
        Return the standstill that lasts at ``time`` [s], None if the robot moves.

        To be called at each wheel sample; ``wheel_speed`` [m/s] is that of the fastest wheel.
        """
        rolling = wheel_speed >= MAX_STATIONARY_WHEEL_SPEED
        if rolling or not self._is_quiet():
            self._quiet_since = None
            if rolling and self._window:
                self._last_turn = time, self._peak_yaw_rate(time)
            return None
        newest = self._window[-1][0]
        if self._quiet_since is None:
            self._quiet_since, self._counted = time, newest - QUIET_TIME
            if self._last_turn is not None:
                self._counted = max(self._counted, self._last_turn[0] + IMU_WINDOW)
        return StationaryInterval(self._mean_rate(newest - QUIET_TIME),
                                  self._unwinding_sigma(time), time - self._quiet_since)

    def _mean_rate(self, end: float) -> Uncertain | None:
        """Return that of the rates up to ``end`` [s]; newer ones may be those of a start."""
        rates = [reading.yaw_rate for time, reading in self._window
                 if self._counted < time <= end]
        self._counted = max(self._counted, end)
        return Uncertain(_mean(rates), self._noise / math.sqrt(len(rates))) if rates else None

    def _peak_yaw_rate(self, now: float) -> float:
        """Return the decaying maximum of the yaw rate [rad/s]: the twist of the tires."""
        latest = abs(_mean(self._rates))
        if self._last_turn is None:
            return latest
        time, rate = self._last_turn
        return max(latest, rate * math.exp((time - now) / IMU_WINDOW))

    def _unwinding_sigma(self, time: float) -> float:
        """
        Return the standard deviation [rad/s] of the yaw rate that remains after a stop.

        Tires that were twisted in a turn unwind after the wheels have stopped: the IMU is quiet
        and the yaw rate small, but not zero.
        """
        if self._last_turn is None:
            return 0.0
        since, rate = self._last_turn
        return UNWINDING_SHARE * rate * math.exp((since - time) / UNWINDING_TIME)

    def _is_quiet(self) -> bool:
        newest = self._window[-1][0] if self._window else 0.0
        recent = [reading for time, reading in self._window if time >= newest - QUIET_TIME]
        if not recent or newest - self._window[0][0] < 0.75 * QUIET_TIME:
            return False
        return all(_standard_deviation(column) < limit
                   for column, limit in zip(zip(*recent), self._limits))


def merged(samples: Sequence[WheelSample]) -> WheelSample:
    """Return the last of some samples, with the mean of their velocities and torques."""
    last = samples[-1]
    if len(samples) == 1:
        return last
    effort = None if any(one.effort is None for one in samples) else four(
        map(_mean, zip(*(one.effort for one in samples if one.effort is not None))))
    return replace(last, velocity=four(map(_mean, zip(*(one.velocity for one in samples)))),
                   effort=effort)


def _side_mean(front: float, rear: float) -> float:
    """Return the mean speed of a side; NaN is a wheel that is not measured."""
    if math.isnan(front) or math.isnan(rear):
        return rear if math.isnan(front) else front
    return 0.5 * (front + rear)


def _mean(values: Collection[float]) -> float:
    return sum(values) / len(values)


def _standard_deviation(values: Sequence[float]) -> float:
    mean = _mean(values)
    return math.sqrt(sum((value - mean) ** 2 for value in values) / len(values))
