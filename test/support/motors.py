# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulated recordings for the calibration of motors: on the ground, and with lifted wheels."""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate
import math

import numpy as np

from smart_tire.calibration.recording import (
    CalibrationRecording, DutyRecord, ImuRecord, WheelRecord)
from smart_tire.control.wheel_control import WheelControl
from smart_tire.parameters import RobotParams, SimulatorParams
from smart_tire.parameters.control import WheelControllerParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.parameters.simulation import SensorErrorParams, SurfaceParams
from smart_tire.samples import ImuSample, MotorCommand, NS_PER_S, WheelSample
from smart_tire.simulation.offline import EPOCH_NS, simulate
from smart_tire.simulation.plant import TIME_STEP
from smart_tire.simulation.robot import encoder_counts, Motors, PeriodicTimer, Robot, wheel_angles

RATE = 16.0           # Hz, of wheel samples and commands
STANDSTILL = 2.0      # s at the begin
STARTS = tuple((seconds, sign * rpm) for sign in (1.0, -1.0) for seconds, rpm in (
    (1.3, 140.0), (1.1, 40.0)) * 4 + ((1.2, 0.0),))
LIFTED_STARTS = tuple((1.5, sign * rpm) for sign in (1.0, -1.0)
                      for rpm in (60.0, 150.0, 40.0, 150.0, 60.0, 0.0))
CONCRETE = SurfaceParams(base='concrete', patches=())
AIR = SurfaceParams(names=('air',), friction=(0.0,), stiffness=(1e-3,), drag=(0.0,), base='air',
                    patches=())
LIFTED_MASS = 0.01    # kg: nearly no load on wheels off the ground
RAMP = 20.0           # rad/s2, of the set points


def simulator(seed, *, lifted=False, mass=10.9, **errors):
    """Return the simulator without films; ``errors`` are fields of ``SensorErrorParams``."""
    robot = RobotParams(film=TreadFilmParams(wheels=()), mass=LIFTED_MASS if lifted else mass)
    return SimulatorParams(seed=seed, ground=AIR if lifted else CONCRETE, robot=robot,
                           errors=SensorErrorParams(**errors))


def truth(seed, **errors):
    """Return the true torque constants over the nominal one, and factors of friction, (4,)."""
    params = simulator(seed, **errors)
    motors = Motors(params)
    return (motors._torque_constant / params.robot.motor.torque_constant,
            np.array(motors.friction_scale))


def legs(parts, seed):
    """Return (start time, left, right) of ``parts`` (duration, rpm) varied at random, and end."""
    varied = np.random.default_rng([seed, 9]).uniform(-0.15, 0.15, len(parts))
    times = list(accumulate((seconds + more for (seconds, _), more in zip(parts, varied)),
                            initial=STANDSTILL))
    return [(time, rpm, rpm) for time, (_, rpm) in zip(times, parts)], times[-1]


def offline_run(seed, *, lifted=False, parts=None, **options):
    """Return the recording of ``simulate``, whose commands are faster than the readings."""
    schedule, duration = legs(parts or (LIFTED_STARTS if lifted else STARTS), seed)
    return recorded(simulate(simulator(seed, lifted=lifted, **options), schedule, duration))


def in_step_events(seed, *, lifted=False, parts=None, phase=None, **options):
    """
    Return the events of a run whose commands have the rate of the readings.

    Commands act ``phase`` [s] after the readings, by default at random but not close to them, and
    1 to 5 ms after their timestamps. Currents are read 0 to 5 ms after the encoders.
    """
    params = simulator(seed, lifted=lifted, **options)
    schedule, duration = legs(parts or (LIFTED_STARTS if lifted else STARTS), seed)
    random_phase, delay, reading_delay = np.random.default_rng([seed, 10]).uniform(
        (0.01, 0.001, 0.0), (0.052, 0.005, 0.005))
    robot, events = Robot(params), []
    host = _Host(params, round(reading_delay / TIME_STEP))
    control = _Control(schedule, random_phase if phase is None else phase)
    for step in range(round(duration / TIME_STEP)):
        time = step * TIME_STEP
        if control.update(time):
            stamp = EPOCH_NS + round((time - delay) * NS_PER_S)
            events.append((stamp, 'motor_commands', MotorCommand(stamp, control.duty)))
        for item in robot.step(control.duty):
            if isinstance(item, ImuSample):
                stamp = EPOCH_NS + item.stamp_ns
                events.append((stamp, 'imu/data', replace(item, stamp_ns=stamp)))
        if sample := host.poll(robot, control.duty):
            events.append((sample.stamp_ns, 'wheel_states', sample))
            control.measure(time, sample)
    return sorted(events, key=lambda event: event[0])


def in_step_run(seed, **options):
    """Return the recording of ``in_step_events``."""
    return recorded(in_step_events(seed, **options))


class _Control:
    """Wheel controller, with ramps of the set points."""

    def __init__(self, schedule, phase):
        self._schedule, self._next = schedule, phase
        self._control = WheelControl(WheelControllerParams(
            rate=RATE, max_wheel_acceleration=RAMP, max_wheel_deceleration=RAMP))
        self.duty = (0.0,) * 4

    def measure(self, time, sample):
        """Receive a wheel sample."""
        self._control.add_reading(sample.velocity, round(time * NS_PER_S), sample.stamp_ns)

    def update(self, time):
        """Return whether there is a new duty."""
        if time < self._next:
            return False
        self._next += 1.0 / RATE
        started = [rpm for begin, rpm, _ in self._schedule if begin <= time]
        wanted = (started[-1] if started else 0.0) * math.tau / 60.0
        _, self.duty = self._control.step((wanted,) * 4, round(time * NS_PER_S))
        return True


class _Host:
    """Motor driver: reads encoders, and currents some steps later."""

    def __init__(self, params, wait):
        self._encoder, self._due = params.robot.encoder, PeriodicTimer(NS_PER_S / RATE)
        self._rng, self._last = np.random.default_rng([params.seed, 11]), None
        self._wait, self._pending = wait, []  # steps; steps left and samples without torque
        self.velocity = (0.0,) * 4

    def poll(self, robot, duty):
        """Return the wheel sample when its currents are read, else None."""
        if sample := self._read_encoders(robot.plant):
            self._pending.append([self._wait, sample])
        if not self._pending or self._pending[0][0]:
            for waiting in self._pending:
                waiting[0] -= 1
            return None
        _, sample = self._pending.pop(0)
        self.velocity = sample.velocity
        return replace(sample, effort=robot.motors.torques(robot.plant, duty, self.velocity))

    def _read_encoders(self, plant):
        if not self._due.expired(plant.time_ns):
            return None
        encoder = self._encoder
        stamp = EPOCH_NS + plant.time_ns + round(
            self._rng.normal(0.0, encoder.stamp_jitter) * NS_PER_S)
        angles = wheel_angles(encoder_counts(plant, encoder.counts_per_revolution),
                              encoder.counts_per_revolution)
        before, self._last = self._last, (stamp, angles)
        if before is None:
            return None
        elapsed = (stamp - before[0]) / NS_PER_S
        return WheelSample(stamp, tuple(
            (new - old) / elapsed for new, old in zip(angles, before[1])), angles)


def recorded(events):
    """Return the recording of IMU, wheels and motor commands in ``events``."""
    def of(kind):
        samples = [sample for _, _, sample in events if isinstance(sample, kind)]
        return samples, np.array([(sample.stamp_ns - EPOCH_NS) / NS_PER_S for sample in samples])

    imu, imu_time = of(ImuSample)
    wheels, wheel_time = of(WheelSample)
    commands, command_time = of(MotorCommand)
    return CalibrationRecording(
        ImuRecord(imu_time, np.array([sample.rate for sample in imu]),
                  np.array([sample.acceleration for sample in imu])),
        WheelRecord(wheel_time, *(np.array([getattr(sample, name) for sample in wheels])
                                  for name in ('velocity', 'position', 'effort'))),
        duties=DutyRecord(command_time, np.array([sample.duty for sample in commands]))
        if commands else None)
