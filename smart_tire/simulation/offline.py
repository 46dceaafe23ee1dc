# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Offline simulation, faster than real time: samples as published by the drivers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.samples import Four, four, ImuSample, NS_PER_S, Sample, TireSample, WheelSample
from smart_tire.simulation.films import FilmBatch
from smart_tire.simulation.plant import Plant, TIME_STEP
from smart_tire.simulation.robot import (
    encoder_counts, Observation, PeriodicTimer, Robot, wheel_angles)
from smart_tire.simulation.truth import truth_topic

Event = tuple[int, str, Sample]  # receive time [ns], topic, sample
Schedule = Callable[[float], tuple[float, float]] | Sequence[tuple[float, float, float]]

EPOCH_NS = 1_700_000_000 * NS_PER_S  # default start time of a simulation
IMU_DELAY_NS = 2_000_000      # from timestamp to reception: one frame at 115200 baud
WHEEL_DELAY_NS = 3_000_000    # from timestamp to reception: two boards are polled
TIMESTAMP_SIGMA_NS = 100_000  # error of a batch's timestamps after clock synchronization
HOST_RNG_STREAM = 1           # index of the random stream of the host
RAD_PER_S_PER_RPM = math.tau / 60.0
CONTROL_PERIOD_STEPS = 20     # plant steps between two steps of the speed control: 50 Hz
MAX_SET_POINT_RATE = 20.0     # rad/s2, of the wheel speeds
SPEED_KP = 0.1                # s/rad, duty per speed error
SPEED_KI = 0.5                # 1/rad, duty per integrated speed error
# Gains relative to those that bring a wheel without load to its set point within a control period:
# above 2 a slipping wheel oscillates. Robots with wheels of smaller inertia have smaller gains.
MAX_RELATIVE_GAIN = 1.25      # -, that of the nominal robot


def simulate(params: SimulatorParams, schedule: Schedule, duration: float, *,
             wheel_rate: float = 16.0, start_ns: int = EPOCH_NS, torque: bool = True,
             plant: type[Plant] = Plant) -> list[Event]:
    """
    Return the messages of ``duration`` [s], sorted by time of reception.

    ``schedule`` gives the wheel speeds (left, right) [rpm]: a function of time [s], or a list of
    (start time, left, right). The events are ``imu/data``, ``wheel_states`` at
    ``wheel_rate`` [Hz], with motor torques if ``torque``, ``tire_samples`` in batches over the
    lossy radio, and ``ground_truth/*``. The same seed gives the same events. ``plant`` may differ.
    """
    robot, host = Robot(params, plant), SimulatedHost(params, wheel_rate, start_ns)
    control = _SpeedControl(_as_function(schedule), params)
    duty: Four = (0.0, 0.0, 0.0, 0.0)
    for step in range(round(duration / TIME_STEP)):
        if step % CONTROL_PERIOD_STEPS == 0:
            duty = control.duties(robot.plant)
        for observation in robot.step(duty):
            host.receive(observation)
        host.poll_wheels(robot, duty if torque else None)
    return sorted(host.events, key=lambda event: event[0])


def _as_function(schedule: Schedule) -> Callable[[float], tuple[float, float]]:
    if callable(schedule):
        return schedule
    phases = sorted(schedule)

    def lookup(time: float) -> tuple[float, float]:
        started = [phase for phase in phases if phase[0] <= time]
        return started[-1][1:] if started else (0.0, 0.0)
    return lookup


class _SpeedControl:
    """PI speed control of a schedule, in place of the node wheel_controller."""

    def __init__(self, schedule: Callable[[float], tuple[float, float]],
                 params: SimulatorParams) -> None:
        drive, period = params.drive, CONTROL_PERIOD_STEPS * TIME_STEP
        within_period = params.robot.motor.inertia / (drive.stall_torque * period)  # s/rad
        self._schedule, self._free_speed = schedule, drive.free_speed
        self._gain = min(1.0, MAX_RELATIVE_GAIN * within_period / SPEED_KP)
        self._set_point = [0.0] * 4  # rad/s
        self._integral = [0.0] * 4   # duty

    def duties(self, plant: Plant) -> Four:
        dt = CONTROL_PERIOD_STEPS * TIME_STEP
        scheduled = self._schedule(plant.time_ns / NS_PER_S) * 2  # left, right, left, right
        return four(self._duty(i, scheduled[i] * RAD_PER_S_PER_RPM, plant.wheel_speed[i], dt)
                    for i in range(4))

    def _duty(self, i: int, scheduled: float, speed: float, dt: float) -> float:
        limit = MAX_SET_POINT_RATE * dt
        self._set_point[i] += min(max(scheduled - self._set_point[i], -limit), limit)
        error = self._set_point[i] - speed
        integral = self._integral[i] + self._gain * SPEED_KI * error * dt
        duty = (self._set_point[i] / self._free_speed + self._gain * SPEED_KP * error
                + integral)
        if abs(duty) < 1.0 or error * duty < 0.0:
            self._integral[i] = integral
        return min(max(duty, -1.0), 1.0)


class SimulatedHost:
    """Host of the drivers: collects the messages that they would publish."""

    def __init__(self, params: SimulatorParams, wheel_rate: float, start_ns: int) -> None:
        self._params, self._start_ns = params, start_ns
        self._rng = np.random.default_rng([params.seed, HOST_RNG_STREAM])
        self._wheels_due = PeriodicTimer(NS_PER_S / wheel_rate)
        self._reading: tuple[int, Four] | None = None  # time and angles of the last reading
        self._radio_ns: dict[str, int] = {}  # arrival of the latest packet, by wheel
        self.events: list[Event] = []  # in the order of observation

    def receive(self, item: Observation) -> None:
        """Add the messages of an observation of the robot."""
        if isinstance(item, FilmBatch):
            self._receive_batch(item)
            return
        sample = replace(item, stamp_ns=self._start_ns + item.stamp_ns)
        if isinstance(item, ImuSample):
            self.events.append((sample.stamp_ns + IMU_DELAY_NS, 'imu/data', sample))
        else:
            self.events.append((sample.stamp_ns, truth_topic(item), sample))

    def poll_wheels(self, robot: Robot, duty: Four | None) -> None:
        """Read the encoders when due, and the currents if the applied ``duty`` is given."""
        plant = robot.plant
        if not self._wheels_due.expired(plant.time_ns):
            return
        encoder, now_ns = self._params.robot.encoder, self._start_ns + plant.time_ns
        error = encoder.latency + self._rng.normal(0.0, encoder.stamp_jitter)
        stamp_ns = now_ns + round(error * NS_PER_S)
        counts = encoder_counts(plant, encoder.counts_per_revolution)
        angles = wheel_angles(counts, encoder.counts_per_revolution)
        last = self._reading
        if last is not None and stamp_ns <= last[0]:
            return
        self._reading = stamp_ns, angles
        if last is None:
            return
        dt = (stamp_ns - last[0]) / NS_PER_S
        velocity = four((new - old) / dt for new, old in zip(angles, last[1]))
        effort = robot.motors.torques(plant, duty, velocity) if duty else None
        self.events.append((now_ns + WHEEL_DELAY_NS, 'wheel_states',
                            WheelSample(stamp_ns, velocity, angles, effort)))

    def _receive_batch(self, batch: FilmBatch) -> None:
        """Add the samples of a radio batch, with delay and in order, unless it is lost."""
        radio, film = self._params.radio, self._params.robot.film
        delay = min(radio.delay + self._rng.exponential(radio.jitter), radio.max_delay)
        lost = self._rng.random() < radio.loss
        stamp_error_ns = round(self._rng.normal(0.0, TIMESTAMP_SIGMA_NS))
        if lost:
            return
        sent_ns = self._start_ns + batch.trace.stamps_ns[-1]
        receive_ns = max(sent_ns + round(delay * NS_PER_S), self._radio_ns.get(batch.wheel, 0))
        self._radio_ns[batch.wheel] = receive_ns
        scale = film.voltage_range / ((1 << film.bits) - 1)
        for stamp_ns, codes in zip(batch.trace.stamps_ns, batch.codes):
            volts = tuple(code * scale for code in codes)
            stamp_ns += self._start_ns + stamp_error_ns
            self.events.append((receive_ns, 'tire_samples',
                                TireSample(stamp_ns, batch.wheel, volts)))
