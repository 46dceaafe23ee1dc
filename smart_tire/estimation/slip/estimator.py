# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, infer_types=True, show_performance_hints=False

"""
Slip estimator: IMU and wheel samples in, odometry, slip and ICR on a time grid out.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
import math
from typing import Any, Protocol

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.estimation.plausibility import is_possible
from smart_tire.estimation.reorder_buffer import GRID_NS, MAX_JUMP_NS, ReorderBuffer
from smart_tire.estimation.slip.filter import SlipFilter
from smart_tire.estimation.slip.inputs import (
    ImuInput, merged, SpikeFilter, WheelOdometry, WheelSpeeds,
    ZeroVelocityDetector)
from smart_tire.estimation.slip.kalman import StateRecorder
from smart_tire.estimation.slip.output import (
    ContinuousPose, EstimateRecord, OutputContext, SlipOutputBuilder)
from smart_tire.estimation.slip.state import (
    DROPOUT_ACCEL_SIGMA, ESTIMATED, IMU_DROPOUT, ImuReading, MAX_NIS,
    MIN_WHEEL_PERIOD, SLIP_CORRELATION_TIME, State,
    TRUSTED_STANDSTILL, UNWINDING_TIME)
from smart_tire.estimation.slip.wheel_lag import WheelLag
from smart_tire.estimation.streams import HOLDING
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.samples import (
    GRAVITY, GroundState, ImuSample, NS_PER_S, Odometry, WheelSample)
from smart_tire.uncertain import Uncertain

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

COMPILED: bool = cython.compiled

TOPICS = {ImuSample: 'imu/data', WheelSample: 'wheel_states', GroundState: 'ground_state'}


class EstimatorRecorder(StateRecorder, Protocol):
    """Records state transitions, outputs and restarts for the RTS smoother."""

    def restart(self) -> None:
        """Start a new segment: the next state does not depend on the previous ones."""

    def record_output(self, context: OutputContext, x: Sequence[float], P: Array) -> None:
        """Record an output of the state after the last transition, by now ``x`` and ``P``."""


class SlipEstimator:
    """
    Slip estimator, to be updated with samples in any order within the reorder window.

    Estimates begin with the first grid instant at which IMU and wheels have been received. A
    ``GroundState`` takes effect ``ground_delay`` after its stamp and is awaited while they flow. A
    ``recorder`` receives what the RTS smoother needs.
    """

    new_filter: Callable[
        [SlipEstimatorParams, EstimatorRecorder | None], SlipFilter] = SlipFilter

    def __init__(self, params: SlipEstimatorParams,
                 recorder: EstimatorRecorder | None = None) -> None:
        self._params = params
        self._recorder = recorder
        self._reorder_buffer = ReorderBuffer(
            round(params.reorder_window * NS_PER_S),
            awaited={'ground_state': HOLDING['ground_state']})
        self._ground_delay_ns = round(params.ground_delay * NS_PER_S)
        self.dropped: Counter[str] = Counter()  # topic -> duplicates and rejected samples
        self._past: Counter[str] = Counter()    # counters of the segments before a reset
        self._handled_resets = 0
        self.restarts = 0                       # from the priors, at the same pose
        self._latest: Odometry | None = None
        self._begin()

    def reset(self) -> None:
        """Return to the initial state; counters stay."""
        self._latest = None
        self._renew()

    def _renew(self) -> None:
        """Start again from the priors, at the latest pose and with its variances."""
        self._past.update(self._segment.counters())
        self._handled_resets = self._reorder_buffer.resets
        self._begin()
        if self._latest is not None:
            self._segment.filter.set_pose(self._latest)

    def _begin(self) -> None:
        if self._recorder is not None:
            self._recorder.restart()
        self._segment = SlipSegment(self._params, self.dropped, self._recorder,
                                    self.new_filter(self._params, self._recorder))

    def reset_odometry(self) -> None:
        """Set the pose to the origin of ``odom``; biases and slips stay."""
        self._latest = None
        self._segment.reset_pose()

    @property
    def late(self) -> Counter[str]:
        """Return the count of samples per topic that arrived after their instant was processed."""
        return self._reorder_buffer.late

    @property
    def gyro_bias(self) -> Uncertain:
        """Return the bias of the yaw rate [rad/s]."""
        kalman, row = self._segment.filter.kalman, State.GYRO_BIAS_Z
        return Uncertain(float(kalman.x[row]), math.sqrt(kalman.P[row, row]))

    @property
    def counters(self) -> Counter[str]:
        """Return the number of rejected IMU spikes, position jumps and changes of ground."""
        return self._past + self._segment.counters()

    def status(self) -> dict[str, str | int | float]:
        """Return the values for diagnostics."""
        segment, counters = self._segment, self.counters
        return {
            'state': segment.state,
            'equations': 'compiled' if COMPILED else 'not compiled',
            'normalized_innovation_squared': round(segment.filter.nis.variance, 3),
            'gyro_bias': round(self.gyro_bias.value, 6),
            'wheel_lag': round(segment.wheel_lag, 3),
            **segment.filter.status(),
            'clock_jumps': self._reorder_buffer.resets,
            'position_jumps': counters['position_jumps'],
            'imu_spikes': counters['imu_spikes'],
            'restarts': self.restarts,
            **{f'dropped.{topic}': count for topic, count in self.dropped.items()},
        }

    def update(self, sample: ImuSample | WheelSample | GroundState) -> list[EstimateRecord]:
        """Add a sample; return the estimates of the grid instants that it completes."""
        topic = TOPICS[type(sample)]
        if not is_possible(sample):
            self.dropped[topic] += 1
            return []
        delay = self._ground_delay_ns if isinstance(sample, GroundState) else 0
        closed = self._reorder_buffer.push(topic, sample.stamp_ns + delay, sample)
        if self._reorder_buffer.resets != self._handled_resets:
            self._renew()  # the clock was set; the robot is where it was
        return [record for instant_ns, samples in closed
                for record in self._step(instant_ns, samples)]

    def _step(self, instant_ns: int, samples: list[Any]) -> list[EstimateRecord]:
        """Return the estimates of an instant; none, and a restart, if there is no valid state."""
        try:
            records = self._segment.step(instant_ns, samples)
        except (ArithmeticError, ValueError):  # of numpy's linear algebra, too
            self.restarts += 1
            self._renew()
            return []
        for record in records:
            if isinstance(record, Odometry):
                self._latest = record
        return records


class SlipSegment:
    """The estimator between two resets: ordered samples in, one grid instant at a time."""

    def __init__(self, params: SlipEstimatorParams, dropped: Counter[str],
                 recorder: EstimatorRecorder | None, slip_filter: SlipFilter) -> None:
        self._robot = params.robot
        self._dropped = dropped
        self._recorder = recorder
        self._output = SlipOutputBuilder(params, ContinuousPose())
        self.filter = slip_filter
        self._gyro_variance = params.robot.imu.gyro_noise ** 2  # (rad/s)^2, of a sample
        self._imu = ImuInput(params.robot)
        self._odometry = WheelOdometry(params.robot)
        self._standstill = ZeroVelocityDetector(
            params.robot.imu.gyro_noise, params.robot.imu.accel_noise)
        self._stationary = False
        self._wheel_time = -math.inf          # s, of the last wheel sample that was used
        self._close: list[WheelSample] = []   # the ones since
        self._lag = WheelLag()
        # samples that are newer than the state: time [s], sample, reading without spikes
        self._held: deque[tuple[float, ImuSample, ImuReading]] = deque()
        self._spikes = SpikeFilter()
        self._latest: ImuReading | None = None
        self._time = 0.0                    # s, of the filter state
        self._origin_ns: int | None = None  # instant from which seconds are counted
        self._heard_ns = 0                  # instant of the newest sample of a sensor

    @property
    def state(self) -> str:
        """Return a description of the operating state."""
        if self._imu.reading is None:
            return 'waiting for imu/data'
        if not self._odometry.started:
            return 'waiting for wheel_states'
        return 'stationary' if self._stationary else 'moving'

    @property
    def wheel_lag(self) -> float:
        """Return the delay [s] of the wheels that was found."""
        return self._lag.value

    def counters(self) -> Counter[str]:
        """Return counts of rejected samples and of changes of the ground."""
        return Counter(imu_spikes=self._imu.spikes, position_jumps=self._odometry.position_jumps,
                       ground_changes=self.filter.forces.changes)

    def reset_pose(self) -> None:
        """Set the pose to the origin of ``odom``."""
        self.filter.reset_pose()
        self._output.reset_pose()

    def step(self, instant_ns: int, samples: list[Any]) -> list[EstimateRecord]:
        """
        Process the samples up to a grid instant; return its estimates, if there are any.

        In a gap of all sensors there is one each ``MAX_JUMP_NS``: what is late is not sent at
        once. Raises EstimatorError if the state is not valid any more.
        """
        if self._origin_ns is None:
            self._origin_ns = instant_ns
        for sample in samples:
            if isinstance(sample, GroundState):
                self.filter.set_ground(sample)
            else:
                self._heard_ns = instant_ns
        for sample in samples:
            if isinstance(sample, ImuSample):
                self._hold(self._seconds(sample.stamp_ns), sample)
        # the filter runs at the time of the wheels
        now = self._seconds(instant_ns) - self._lag.value
        self._predict(now)
        self._bridge_dropout(now)
        for sample in samples:
            if isinstance(sample, WheelSample):
                self._correct_wheels(
                    self._seconds(sample.stamp_ns) - self._robot.encoder.latency, sample)
        if not self.filter.is_sound:
            raise EstimatorError('the state is not finite, or a variance is negative')
        gap_ns = instant_ns - self._heard_ns
        if gap_ns > MAX_JUMP_NS and gap_ns % MAX_JUMP_NS >= GRID_NS:
            return []
        return self._estimates(instant_ns)

    def _seconds(self, stamp_ns: int) -> float:
        assert self._origin_ns is not None
        return (stamp_ns - self._origin_ns) / NS_PER_S

    def _hold(self, time: float, sample: ImuSample) -> None:
        reading = self._spikes.clean(
            self._imu.in_base_axes(sample), self._latest, self._imu.vibration)
        self._latest = reading
        self._held.append((time, sample, reading))
        self._lag.add_rate(time, reading.yaw_rate)

    def _predict(self, now: float) -> None:
        """Predict through samples up to ``now`` [s] that are newer than the state, as one step."""
        readings: list[tuple[float, ImuReading]] = []
        if self._imu.reading is not None:
            readings.append((self._time, self._imu.reading))
        while self._held and self._held[0][0] <= now:
            time, sample, _ = self._held.popleft()
            reading = self._imu.add_sample(time, sample)
            if reading is None or time <= self._time and readings:
                self._dropped['imu/data'] += 1
                continue
            readings.append((time, reading))
            self._standstill.add_reading(time, reading)
        if len(readings) > 1:
            step = self._imu.step(readings[0][0], readings)
            self.filter.predict(readings[-1][0], step)
            if not self._stationary:
                self.filter.correct_forces(
                    self._imu, self._odometry.wheel_residual, step.dt)
        if readings:
            self._time = readings[-1][0]

    def _bridge_dropout(self, now: float) -> None:
        """Predict to ``now`` [s] by the wheels if the IMU samples have stopped."""
        imu = self._imu
        if imu.time is None or imu.reading is None or (
                now - imu.time <= max(IMU_DROPOUT, 3.0 * imu.period.value)):
            return
        dt, (age, variance) = now - self._time, self._odometry.staleness(now)
        reading = self.filter.blind_reading(dt, self._odometry.side_speeds, imu.turn_rate)
        step = imu.bridge(
            reading, dt,
            # by the yaw angle of a random walk of both speeds
            2.0 * age * variance / self._robot.track_width ** 2,
            2.0 * SLIP_CORRELATION_TIME * DROPOUT_ACCEL_SIGMA ** 2)
        self._time = now
        self.filter.predict(now, step, blind=True)

    def _correct_wheels(self, time: float, sample: WheelSample) -> None:
        """Use a wheel sample of ``time`` [s], latency removed, with those that were too close."""
        self._close.append(sample)
        if 0.0 < time - self._wheel_time < MIN_WHEEL_PERIOD:
            return
        self._wheel_time, sample = time, merged(self._close)
        self._close.clear()
        wheels = self._odometry.add_sample(time, sample)
        if wheels is None:
            self._dropped['wheel_states'] += 1
            return
        reading = self._imu.reading
        if reading is None:
            return
        left, right = wheels.side_speeds
        if self._odometry.independent:
            self._lag.add_turn(time, right - left, wheels.duration, max(
                abs(left), abs(right)) >= self._robot.slip.standstill_speed)
        time -= self._lag.value
        self._correct_standstill(time, wheels)
        self.filter.correct_wheels(time, wheels, reading.yaw_rate, self._odometry.independent)
        if not self._stationary:
            self.filter.find_change(self._imu, sample.effort, wheels)
            self.filter.correct_lateral(reading.yaw_rate, wheels.duration)

    def _correct_standstill(self, time: float, wheels: WheelSpeeds) -> None:
        standstill = self._standstill.detect(time, max(map(abs, wheels.wheel_speeds)))
        self._stationary = standstill is not None and (
            standstill.duration > TRUSTED_STANDSTILL or self._is_slow() and self._is_at_rest())
        if standstill is not None and self._stationary:
            self.filter.correct_zero_velocity()
            if standstill.rate is not None:
                unwinding = UNWINDING_TIME / wheels.duration * standstill.unwinding_sigma ** 2
                self.filter.correct_gyro_bias(standstill.rate, unwinding,
                                              self._gyro_variance * self._imu.period.value)

    def _is_slow(self) -> bool:
        """Return whether the estimated speed is compatible with standstill."""
        x, P = self.filter.kalman.x, self.filter.kalman.P
        limit = self._robot.slip.standstill_speed
        return all(abs(x[row]) < limit + 3.0 * math.sqrt(P[row, row])
                   for row in (State.V_X, State.V_Y))

    def _is_at_rest(self) -> bool:
        """Return whether the force is that of standstill: robots with locked wheels may slide."""
        imu, x, P = self._imu, self.filter.kalman.x, self.filter.kalman.P
        if imu.force is None:
            return True
        rest = self.filter.motion.steady_force(x, 0.0)
        return all((force - still) ** 2 < MAX_NIS * (
            P[bias, bias] + GRAVITY ** 2 * P[slope, slope] + imu.force_variance)
            for force, still, bias, slope in zip(
                imu.force, rest, (State.ACCEL_BIAS_X, State.ACCEL_BIAS_Y),
                (State.PITCH, State.ROLL)))

    def _estimates(self, instant_ns: int) -> list[EstimateRecord]:
        imu = self._imu
        if imu.reading is None or not self._odometry.started:
            return []
        x, P = self.filter.kalman.x, self.filter.kalman.P
        rate, *force = imu.reading
        if imu.force is not None:
            force = imu.force
        held = [reading for _, _, reading in self._held]  # since the state
        if held:
            rate = held[-1].yaw_rate
        now = self._seconds(instant_ns)
        variance = self.filter.blind_rate_variance(
            self._odometry.staleness(now)[1]) if self.filter.blind else self._gyro_variance
        context = OutputContext(
            instant_ns, now - self._time, ImuReading(rate, *force), variance,
            self._odometry.wheel_residual, _mean(held) if held else None,
            self.filter.hidden_variance)
        if self._recorder is not None:
            self._recorder.record_output(
                context, x[:ESTIMATED], P[:ESTIMATED, :ESTIMATED].copy())
        return self._output.build(context, x, P)


def _mean(readings: list[ImuReading]) -> ImuReading:
    if len(readings) == 1:  # as between most instants
        return readings[0]
    return ImuReading(*(sum(column) / len(readings) for column in zip(*readings)))
