"""From IMU and wheel samples to odometry, slip and ICR on the grid of message time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
import math
from typing import Any, Protocol

from smart_tire.arrays import Array
from smart_tire.estimation.reorder_buffer import ReorderBuffer
from smart_tire.estimation.slip.ekf import SlipFilter, StateRecorder
from smart_tire.estimation.slip.film_slip_update import FilmAid
from smart_tire.estimation.slip.kinematics import SlipKinematics
from smart_tire.estimation.slip.odometry_buffer import OdometryBuffer
from smart_tire.estimation.slip.output import Estimate, OutputContext, SlipReport
from smart_tire.estimation.slip.radius_estimator import RadiusEstimator
from smart_tire.estimation.slip.state import ImuStep, State, WheelMeasurement
from smart_tire.estimation.slip.steering_efficiency import SteeringEfficiency
from smart_tire.estimation.slip.vibration import VibrationMonitor
from smart_tire.estimation.slip.wheel_odometry import WheelReader, WheelReading
from smart_tire.estimation.slip.zero_velocity import Reading, UNWINDING_TIME, ZeroVelocityDetector
from smart_tire.models.vehicle.skid_steer import GRAVITY
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.rotation import matrix
from smart_tire.samples import (
    Friction, ImuSample, MAX_ANGULAR_RATE, MAX_SPECIFIC_FORCE, MAX_WHEEL_SPEED, NS_PER_S,
    WheelSample)

DROPOUT = 0.1              # s without the inertial unit (or 3 periods): go by the wheels
GUESS_TIME = 2.0           # s, for which a yaw rate that the wheels give errs to one side
GUESSED_ACCEL_PSD = 0.1    # (m/s2)^2 s, of an acceleration that nobody measures
SPIKE_RATE = 5.0           # rad/s between two readings; no robot starts to turn so hard
SPIKE_FORCE = 20.0         # m/s2 between two readings, beyond what its shaking explains
SPIKE_SIGMAS = 8.0         # of the shaking
SLOW_SHAKING = 0.25        # share of the shaking that is pitch and roll; assumed
UNSEEN = 0.3               # of a change of speed over ground goes into sliding, one sigma
UNSEEN_CHANGE = 0.03       # m/s; a smaller change is noise
TRUSTED_REST = 3.0         # s; rest that lasts so long overrules a state that has drifted away


class EstimatorRecorder(StateRecorder, Protocol):
    """Takes down, too, where on the way the estimates were made, and where all starts anew."""

    def start(self) -> None:
        """Note that nothing of what was before leads to what comes now."""

    def mark(self, seen: OutputContext, x: Sequence[float], P: Array) -> None:
        """Note that the state after the last move, by now ``x``, ``P``, was reported so."""


class SlipEstimator:
    """
    Gate, filter and output of ``slip_estimator``: ``update`` with samples in any order.

    Estimates begin with the first grid instant at which both inputs have been seen. Where the
    robot's slip is ``film_aided``, the films' slip in passages is used, too. All that a smoother
    needs goes to the ``tape`` if there is one.
    """

    def __init__(self, params: SlipEstimatorParams, tape: EstimatorRecorder | None = None) -> None:
        self._params = params
        self._tape = tape
        self._report = SlipReport(params.robot)
        self._kinematics = SlipKinematics(params.robot)
        self._rotation: list[list[float]] = matrix(*params.robot.imu.rotation).tolist()
        self._gate = ReorderBuffer(round(params.reorder_window * NS_PER_S))
        self.dropped: Counter[str] = Counter()  # topic -> duplicates and samples without use
        self.spikes = 0  # readings of the inertial unit that no robot can have felt
        self.films_used = 0  # passages whose slip was used
        self.reset()

    def reset(self) -> None:
        """Start anew: nothing is known."""
        if self._tape is not None:
            self._tape.start()
        robot = self._params.robot
        self._filter = SlipFilter(self._params, self._tape)
        self._wheels = WheelReader(robot)
        self._standstill = ZeroVelocityDetector(robot.imu.gyro_noise, robot.imu.accel_noise)
        self._log = OdometryBuffer()
        self._at_reading = (0.0, 0.0)     # m/s, of the sides over ground, when wheels were read
        self._steering = SteeringEfficiency()
        self._radius = RadiusEstimator(robot)
        self._films = FilmAid(robot) if robot.slip.film_aided else None
        self._blind = False               # whether the unit is silent
        self._zero_ns: int | None = None  # instant from which seconds are counted ...
        self._closed_ns = 0               # ... and the last one that was closed
        self._time = 0.0                  # s, of the filter's state
        self._wheels_at = 0.0             # s, middle of what the last wheel reading describes
        self._imu_time: float | None = None
        self._imu: Reading | None = None  # last rate z, force x, y
        self._imu_period = 0.01           # s, of the IMU, until it is known better
        self._shaking = VibrationMonitor(robot.imu.accel_noise)
        self._spiked = False              # whether the last reading was held to be a spike
        self._at_rest = False
        self._gate_resets = self._gate.resets

    def reset_odometry(self) -> None:
        """Put the origin of ``odom`` where the robot stands; biases and slips stay."""
        self._filter.reset_pose()

    @property
    def late(self) -> Counter[str]:
        """Return the count of samples per topic that came after their instant had closed."""
        return self._gate.late

    def status(self) -> dict[str, str | int | float]:
        """Return what diagnostics should tell."""
        return {
            'state': ('waiting for imu/data' if self._imu is None else
                      'waiting for wheel_states' if not self._wheels.started else
                      'standing' if self._at_rest else 'moving'),
            'normalised_innovation_squared': round(self._filter.nis, 3),
            'gyro_bias': round(self._filter.x[State.GYRO_BIAS_Z], 6),
            'rolling_radius': round(self._radius.radius, 6),
            'clock_jumps': self._gate.resets,
            'position_jumps': self._wheels.jumps,
            'imu_spikes': self.spikes,
            **({} if self._films is None else {'films_used': self.films_used}),
            **{f'dropped.{topic}': count for topic, count in self.dropped.items()},
        }

    def update(self, sample: ImuSample | WheelSample | Friction) -> list[Estimate]:
        """Take a sample in; return the estimates of the grid instants that it closes."""
        if isinstance(sample, Friction):
            self._on_friction(sample)
            return []
        topic = 'imu/data' if isinstance(sample, ImuSample) else 'wheel_states'
        if not _possible(sample):
            self.dropped[topic] += 1
            return []
        closed = self._gate.push(topic, sample.stamp_ns, sample)
        if self._gate.resets != self._gate_resets:
            self.reset()
        estimates: list[Estimate] = []
        for instant_ns, samples in closed:
            self._step(instant_ns, samples)
            if self._imu is not None and self._wheels.started:
                estimates += self._estimates(instant_ns)
        return estimates

    def _step(self, instant_ns: int, samples: list[Any]) -> None:
        if self._zero_ns is None:
            self._zero_ns = instant_ns
        imu = [s for s in samples if isinstance(s, ImuSample)]
        if imu:
            self._on_imu(imu)
        now = self._seconds(instant_ns)
        if self._imu_time is not None and now - self._imu_time > max(
                DROPOUT, 3.0 * self._imu_period):
            self._predict_blind(now)
        for sample in samples:
            if isinstance(sample, WheelSample):
                self._on_wheels(sample)
        if self._films is not None:
            self._use_films(self._films, instant_ns)
        self._closed_ns = instant_ns

    def _on_friction(self, sample: Friction) -> None:
        if self._films is None or self._zero_ns is None:
            return
        if not self._films.push(sample, self._seconds(sample.stamp_ns), self._closed_ns):
            self._gate.late['tire_friction'] += 1

    def _use_films(self, films: FilmAid, instant_ns: int) -> None:
        for film in films.due(instant_ns):
            past = films.speed(film, self._seconds(film.stamp_ns))
            if past is not None:
                self._filter.update_past_speed(past)
                self.films_used += 1

    def _seconds(self, stamp_ns: int) -> float:
        assert self._zero_ns is not None
        return (stamp_ns - self._zero_ns) / NS_PER_S

    def _on_imu(self, samples: list[ImuSample]) -> None:
        """Advance through the samples of one grid step with the mean of their trapezoids."""
        end, count, jumps = self._time, 0, 0.0
        sums = [0.0, 0.0, 0.0]
        for sample in samples:
            time = self._seconds(sample.stamp_ns)
            if self._imu_time is not None and time <= self._imu_time:
                self.dropped['imu/data'] += 1
                continue
            reading = self._despiked(self._read(sample))
            self._standstill.push(time, reading)
            self._shaking.push(time, sample.acceleration[2])
            if self._imu is None or self._imu_time is None:
                self._time = end = time
                self._log.start(time)
            elif time > end:
                half = 0.5 * (time - end)
                sums = [total + half * (old + new)
                        for total, old, new in zip(sums, self._imu, reading)]
                # where between the two samples it changed is anybody's guess
                jumps += (time - end) ** 2 / 12.0 * max(
                    (reading[1] - self._imu[1]) ** 2, (reading[2] - self._imu[2]) ** 2)
                self._imu_period += 0.02 * (min(time - self._imu_time, 1.0) - self._imu_period)
                end, count = time, count + 1
            self._imu, self._imu_time = reading, time
        if count:
            self._blind = False
            self._predict(end, sums, count, jumps)

    def _despiked(self, reading: Reading) -> Reading:
        """
        Return ``reading``, or the one before where this one is a single spike.

        A knock that is real lasts: a second such reading in a row is believed.
        """
        last = self._imu
        spike = last is not None and not self._spiked and (
            abs(reading[0] - last[0]) > SPIKE_RATE
            or max(abs(reading[1] - last[1]), abs(reading[2] - last[2]))
            > SPIKE_FORCE + SPIKE_SIGMAS * self._shaking.sigma)
        self._spiked = spike
        if last is None or not spike:
            return reading
        self.spikes += 1
        return last

    def _read(self, sample: ImuSample) -> Reading:
        (f_x, f_y, f_z), (w_x, w_y, w_z) = sample.acceleration, sample.rate
        x, y, z = self._rotation
        return (z[0] * w_x + z[1] * w_y + z[2] * w_z,
                x[0] * f_x + x[1] * f_y + x[2] * f_z, y[0] * f_x + y[1] * f_y + y[2] * f_z)

    def _predict(self, end: float, sums: Sequence[float], count: int, jumps: float) -> None:
        """Advance to ``end`` [s]; ``jumps`` [m2/s2] is the variance of speed by jerks."""
        dt, imu = end - self._time, self._params.robot.imu
        rate, force_x, force_y = (total / dt for total in sums)
        period = dt / count  # white noise per sample becomes noise density
        shaking = self._shaking.sigma
        self._advance(end, ImuStep(
            rate, force_x, force_y, imu.gyro_noise ** 2 * period,
            (imu.accel_noise ** 2 + shaking ** 2) * period + jumps / dt,
            self._slope_sigma(shaking)))

    def _slope_sigma(self, shaking: float) -> float:
        return math.hypot(self._params.slope_sigma, SLOW_SHAKING * shaking / GRAVITY)

    def _predict_blind(self, now: float) -> None:
        """Advance without the inertial unit: yaw rate from the wheels, acceleration unknown."""
        x = self._filter.x
        W, sigma = self._steering.predict(self._by_wheels(self._wheels.side_speeds))
        rate = W + x[State.GYRO_BIAS_Z]
        force_x = x[State.ACCEL_BIAS_X] - W * x[State.V_Y] - GRAVITY * x[State.PITCH]
        force_y = x[State.ACCEL_BIAS_Y] + W * x[State.V_X] + GRAVITY * x[State.ROLL]
        self._imu = (rate, force_x, force_y)
        self._blind = True
        self._advance(now, ImuStep(
            rate, force_x, force_y, 2.0 * sigma ** 2 * GUESS_TIME, GUESSED_ACCEL_PSD,
            self._slope_sigma(self._shaking.sigma)))

    def _by_wheels(self, sides: tuple[float, float]) -> float:
        """Return the yaw rate [rad/s] of these sides [m/s] if there were no slip."""
        return (sides[1] - sides[0]) / self._params.robot.track_width

    def _advance(self, end: float, motion: ImuStep) -> None:
        dt = end - self._time
        before = self._filter.x
        self._filter.predict(dt, motion)
        after = self._filter.x
        rate = motion.yaw_rate - after[State.GYRO_BIAS_Z]
        self._log.add(end, 0.5 * (before[State.V_X] + after[State.V_X]), rate)
        if self._films is not None:
            self._films.note(end, after[State.V_X] - before[State.V_X],
                             motion.accel_variance * dt, rate * dt, motion.yaw_rate,
                             self._kinematics.wheel_speeds(after, motion.yaw_rate),
                             self._unseen(motion.yaw_rate))
        self._time = end

    def _on_wheels(self, sample: WheelSample) -> None:
        time = self._seconds(sample.stamp_ns) - self._params.robot.encoder.latency
        reading = self._wheels.read(time, sample)
        if reading is None:
            self.dropped['wheel_states'] += 1
            return
        if self._imu is None:
            return
        self._wheels_at = time - 0.5 * reading.duration
        rest = self._standstill.rest(time, max(map(abs, reading.wheel_speeds)))
        self._at_rest = rest is not None and (
            rest.duration > TRUSTED_REST or self._slow())
        if rest is not None and self._at_rest:
            self._filter.update_standstill()
            if rest.settled:  # overlapping means: one of them is worth its new part only
                sigma = self._params.robot.imu.gyro_noise * math.sqrt(
                    self._imu_period / reading.duration)
                creep = rest.unwinding * math.sqrt(UNWINDING_TIME / reading.duration)
                self._filter.update_gyro_bias(
                    rest.rate, math.hypot(max(sigma, rest.sigma), creep))
        mean = self._log.mean(time - reading.duration, time)
        if mean is not None:
            if not self._blind:
                self._steering.update(self._by_wheels(reading.sides), mean[1], reading.duration)
            half = 0.5 * self._params.robot.track_width * mean[1]
            middle = mean[0] + self._params.robot.imu.position[1] * mean[1]
            self._at_reading = middle - half, middle + half
            self._filter.update_wheels(WheelMeasurement(
                reading.duration, reading.sides, *mean, reading.variance, reading.stamped))
            if not self._at_rest:
                self._roll(reading)
        self._filter.update_lateral(self._imu[0], reading.duration)

    def _roll(self, reading: WheelReading) -> None:
        """Use what is usual of rolling wheels, for their slip and for their radius."""
        assert self._imu is not None
        seen = self._filter.update_rolling(
            reading.duration, self._imu[0], self._radius.variance)
        if seen is not None:
            forward = math.copysign(1.0, sum(reading.sides))
            self._radius.update(forward * seen.slip, seen.variance + seen.usual, seen.firm,
                                reading.duration)
            self._wheels.radius = self._radius.radius

    def _slow(self) -> bool:
        """Return whether the filter, too, can believe that the robot stands."""
        x, P = self._filter.x, self._filter.P
        limit = self._params.robot.slip.standstill_speed
        return all(abs(x[row]) < limit + 3.0 * math.sqrt(P[row, row])
                   for row in (State.V_X, State.V_Y))

    def _estimates(self, instant_ns: int) -> list[Estimate]:
        assert self._imu is not None
        ahead = self._seconds(instant_ns) - self._time
        rate, *force = self._imu
        seen = OutputContext(instant_ns, ahead, rate, (force[0], force[1]), self._shaking.sigma,
                    self._wheels.beyond_side, self._time, self._wheels_at)
        if self._tape is not None:
            self._tape.mark(seen, self._filter.x, self._filter.P)
        return self._report.estimates(seen, self._filter.x, self._filter.P, self._unseen(rate))

    def _unseen(self, gyro_z: float) -> tuple[float, float]:
        """Return by how much the sides' sliding [m/s] may have changed since wheels were read."""
        now = self._kinematics.side_speeds(self._filter.x, gyro_z)
        left, right = (UNSEEN * max(0.0, abs(new - old) - UNSEEN_CHANGE)
                       for new, old in zip(now, self._at_reading))
        return left, right


def _possible(sample: ImuSample | WheelSample) -> bool:
    """Return whether a robot can have felt this; NaN is not possible either."""
    if isinstance(sample, ImuSample):
        return (all(abs(force) <= MAX_SPECIFIC_FORCE for force in sample.acceleration)
                and all(abs(rate) <= MAX_ANGULAR_RATE for rate in sample.rate))
    return all(abs(speed) <= MAX_WHEEL_SPEED for speed in sample.velocity)
