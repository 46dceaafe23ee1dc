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

"""Slip estimator: IMU and wheel samples in, odometry, slip and ICR on a time grid out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
import math
from typing import Any, Protocol

from smart_tire.arrays import Array
from smart_tire.estimation.plausibility import is_possible
from smart_tire.estimation.reorder_buffer import ReorderBuffer
from smart_tire.estimation.slip.ekf import SlipFilter
from smart_tire.estimation.slip.film_slip_update import FilmSlipBuffer
from smart_tire.estimation.slip.output import EstimateRecord, OutputContext, SlipOutputBuilder
from smart_tire.estimation.slip.prediction import SlipPredictor
from smart_tire.estimation.slip.robust_ekf import StateRecorder
from smart_tire.estimation.slip.state import State
from smart_tire.estimation.slip.wheel_correction import WheelCorrector
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.samples import Friction, ImuSample, NS_PER_S, WheelSample
from smart_tire.uncertain import Uncertain


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
        self._reorder_buffer = ReorderBuffer(round(params.reorder_window * NS_PER_S))
        self.dropped: Counter[str] = Counter()  # topic -> duplicates and rejected samples
        self._past: Counter[str] = Counter()    # counters of the segments before a reset
        self._segment = SlipSegment(params, self.dropped, recorder)
        self._handled_resets = 0

    def reset(self) -> None:
        """Return to the initial state; counters stay."""
        self._past.update(self._segment.counters())
        self._segment = SlipSegment(self._params, self.dropped, self._recorder)
        self._handled_resets = self._reorder_buffer.resets

    def reset_odometry(self) -> None:
        """Set the pose to the origin of ``odom``; biases and slips stay."""
        self._segment.filter.reset_pose()

    @property
    def late(self) -> Counter[str]:
        """Return the count of samples per topic that arrived after their instant was processed."""
        return self._reorder_buffer.late

    @property
    def gyro_bias(self) -> Uncertain:
        """Return the bias of the yaw rate [rad/s]."""
        kalman, row = self._segment.filter, State.GYRO_BIAS_Z
        return Uncertain(float(kalman.x[row]), math.sqrt(kalman.P[row, row]))

    @property
    def counters(self) -> Counter[str]:
        """Return the number of rejected IMU spikes, position jumps and used film slips."""
        return self._past + self._segment.counters()

    def status(self) -> dict[str, str | int | float]:
        """Return the values for diagnostics."""
        segment, counters = self._segment, self.counters
        return {
            'state': segment.state,
            'normalized_innovation_squared': round(segment.filter.nis, 3),
            'gyro_bias': round(self.gyro_bias.value, 6),
            'rolling_radius': round(segment.wheels.radius.radius, 6),
            'clock_jumps': self._reorder_buffer.resets,
            'position_jumps': counters['position_jumps'],
            'imu_spikes': counters['imu_spikes'],
            **({'films_used': counters['films_used']} if self._params.robot.slip.film_aided
               else {}),
            **{f'dropped.{topic}': count for topic, count in self.dropped.items()},
        }

    def update(self, sample: ImuSample | WheelSample | Friction) -> list[EstimateRecord]:
        """Add a sample; return the estimates of the grid instants that it completes."""
        if isinstance(sample, Friction):
            if not self._segment.add_film_slip(sample):
                self.late['tire_friction'] += 1
            return []
        topic = 'imu/data' if isinstance(sample, ImuSample) else 'wheel_states'
        if not is_possible(sample):
            self.dropped[topic] += 1
            return []
        closed = self._reorder_buffer.push(topic, sample.stamp_ns, sample)
        if self._reorder_buffer.resets != self._handled_resets:
            self.reset()
        return [record for instant_ns, samples in closed
                for record in self._segment.step(instant_ns, samples)]


class SlipSegment:
    """The estimator between two resets: ordered samples in, one grid instant at a time."""

    def __init__(self, params: SlipEstimatorParams, dropped: Counter[str],
                 recorder: EstimatorRecorder | None) -> None:
        if recorder is not None:
            recorder.restart()
        robot = params.robot
        self._latency = robot.encoder.latency
        self._automatic = params.force_balance == 'auto' and all(robot.joints.measured)
        self._dropped = dropped
        self._recorder = recorder
        self._films = FilmSlipBuffer(robot) if robot.slip.film_aided else None
        self._films_used = 0
        self._output = SlipOutputBuilder(params)
        self.filter = SlipFilter(params, recorder)
        self._predictor = SlipPredictor(params, self.filter, self._films)
        self.wheels = WheelCorrector(robot, self.filter, self._predictor)
        self._origin_ns: int | None = None  # instant from which seconds are counted
        self._closed_ns = 0                 # latest grid instant

    @property
    def state(self) -> str:
        """Return a description of the operating state."""
        if self._predictor.imu.reading is None:
            return 'waiting for imu/data'
        if not self.wheels.odometry.started:
            return 'waiting for wheel_states'
        return 'stationary' if self.wheels.stationary else 'moving'

    def counters(self) -> Counter[str]:
        """Return counts of rejected and of used samples."""
        return Counter(imu_spikes=self._predictor.imu.spikes, films_used=self._films_used,
                       position_jumps=self.wheels.odometry.position_jumps)

    def add_film_slip(self, sample: Friction) -> bool:
        """Add a slip measured by the films; return False if it is too late to be used."""
        if self._films is None or self._origin_ns is None:
            return True
        return self._films.add(sample, self._seconds(sample.stamp_ns), self._closed_ns)

    def step(self, instant_ns: int, samples: list[Any]) -> list[EstimateRecord]:
        """Process the samples up to a grid instant; return its estimates, if there are any."""
        if self._origin_ns is None:
            self._origin_ns = instant_ns
        self._predict([sample for sample in samples if isinstance(sample, ImuSample)])
        self._predictor.bridge_dropout(
            self._seconds(instant_ns), self.wheels.odometry.side_speeds)
        if self._automatic and self._films_used:  # torques alone: sigmas are not consistent
            self.filter.forces.enabled = True
        for sample in samples:
            if isinstance(sample, WheelSample) and not self.wheels.correct(
                    self._seconds(sample.stamp_ns) - self._latency, sample):
                self._dropped['wheel_states'] += 1
        if self._films is not None:
            self._correct_with_films(self._films, instant_ns)
        self._closed_ns = instant_ns
        return self._estimates(instant_ns)

    def _seconds(self, stamp_ns: int) -> float:
        assert self._origin_ns is not None
        return (stamp_ns - self._origin_ns) / NS_PER_S

    def _predict(self, samples: list[ImuSample]) -> None:
        readings = self._predictor.predict(
            (self._seconds(sample.stamp_ns), sample) for sample in samples)
        if len(readings) < len(samples):
            self._dropped['imu/data'] += len(samples) - len(readings)
        for time, reading in readings:
            self.wheels.standstill.update(time, reading)

    def _correct_with_films(self, films: FilmSlipBuffer, instant_ns: int) -> None:
        for film in films.pop_due(instant_ns):
            delayed = films.delayed_speed(film, self._seconds(film.stamp_ns))
            if delayed is not None:
                self.filter.correct_delayed_speed(delayed)
                self.filter.forces.correct_adhesion(
                    film.wheel, film.ratio, Uncertain(film.slip, film.sigma), delayed)
                self._films_used += 1

    def _estimates(self, instant_ns: int) -> list[EstimateRecord]:
        predictor, wheels, x, P = self._predictor, self.wheels, self.filter.x, self.filter.P
        imu = predictor.imu.reading
        if imu is None or not wheels.odometry.started:
            return []
        context = OutputContext(
            instant_ns, self._seconds(instant_ns) - predictor.time, imu, predictor.imu.vibration,
            wheels.odometry.wheel_residual, predictor.time, wheels.period_center,
            self.filter.forces.active, self.filter.forces.enabled)
        if self._recorder is not None:
            self._recorder.record_output(context, x, P)
        return self._output.build(
            context, x, P, predictor.slip_change_sigma(imu.yaw_rate))
