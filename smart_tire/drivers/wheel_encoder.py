# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Encoder of one wheel: unwrapped angle, and plausibility against the duty of the motor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import itertools
import math
from statistics import fmean

from smart_tire.parameters.hardware import MotorDriverParams
from smart_tire.protocol.roboclaw import count_step
from smart_tire.samples import WHEELS

MAX_SPEED = 100.0           # rad/s; a larger step of the counts means that the board lost them
MIN_DRIVING_DUTY = 0.05     # -, below it gear friction may stop a wheel
MIN_ROLLING_SPEED = 0.5     # rad/s, above it a wheel counts as rolling
MIN_ROLLING_COUNTS = 4      # counts of a rolling wheel within two stall times, in 1.5 counts
MIN_DUTY_RATIO = 0.9        # duty over that of the rolling wheel, above which it is not reduced
# N m, of the mean of measured torques: three sigma of noise (0.05) and offset (0.015), see
# errors.torque_noise and errors.torque_offset of the simulator
MAX_TORQUE_ERROR = 0.1
MIN_MEASURED = 2            # readings of the torque within the stall time, for their mean
# Of a wheel that lags behind the other one of its side, over three stall times; no simulated drive
# on slopes of 8 degrees, with motors 20 % off, was stopped.
MAX_SIDE_RATIO = 0.4        # speed over that of the other wheel
MIN_EXTRA_DUTY = 0.1        # duty above that of the other wheel
# Torque of the tire over stall torque at most, friction * load * radius: 0.47 * 26.7 N * 0.087 m
# is 0.22 of a stall torque of 5 N m, and about twice that on surfaces with high friction.
MAX_LOAD = 0.5


class WheelEncoder:
    """Unwraps the counts of one encoder; ``sign`` is -1 if it counts backwards."""

    def __init__(self, sign: int, counts_per_revolution: float) -> None:
        self.sign = sign
        self.resolution = math.tau / counts_per_revolution  # rad, angle of one count
        self._count: int | None = None
        self.position = 0.0  # rad, unwrapped
        self.jumped = False  # whether the latest step exceeded MAX_SPEED

    def add_count(self, count: int, elapsed: float) -> None:
        """Update the angle with a count read ``elapsed`` seconds after the previous one."""
        self.jumped = False
        if self._count is not None and elapsed > 0.0:
            step = self.sign * count_step(count, self._count) * self.resolution
            self.jumped = abs(step) > MAX_SPEED * elapsed
            if not self.jumped:
                self.position += step
        self._count = count


@dataclass(frozen=True, slots=True)
class Reading:
    """Angle of a wheel, duty and torque of its motor at one time."""

    time: float      # s
    position: float  # rad
    duty: float      # [-1, 1]
    torque: float    # N m at the wheel, NaN if it was not measured at this duty


class MotionCheck:
    """
    Plausibility check of an encoder by a model of its motor.

    With duty d and torque tau at the wheel the motor turns at ``w_0 (d - tau / tau_0)``, with
    free speed w_0 and stall torque tau_0. Speed, duty and torque are averaged over the stall
    time, which leaves this linear relation as it is. An encoder that reports less than the duty
    and the largest torque permit is a fault. The largest torque is the measured one with its
    errors; if the board does not measure it, the largest one of the tire. The torque that
    accelerates wheel and robot as the encoder reports is added: not every board measures the
    current of a braking motor.

    Two wheels of one side are compared with each other, which needs no torque: see ``lag``.

    A wheel that does not turn at ``stall_duty``, or that was rolling and stops although its duty
    is not reduced, is blocked or its encoder is broken: a fault, too.
    """

    def __init__(self, params: MotorDriverParams, resolution: float) -> None:
        """Check against the motor of ``params``; ``resolution`` is the angle of a count [rad]."""
        self._params, self._toggle = params, 1.5 * resolution  # rad, above one count
        robot = params.robot
        self._inertia = robot.motor.inertia + robot.mass / len(WHEELS) * robot.wheel_radius**2
        self._readings: list[Reading] = []  # of the latest three stall times

    def reset(self) -> None:
        """Discard all readings, after a pause."""
        self._readings = []

    def check_reading(self, latest: Reading) -> str:
        """Add a reading; return a description of the fault, '' if there is none."""
        begin = latest.time - self._params.stall_time
        self._readings = [one for one in self._readings
                          if one.time > begin - 2.0 * self._params.stall_time] + [latest]
        count = sum(one.time <= begin for one in self._readings)
        if count == 0 or latest.duty == 0.0:
            return ''
        before, during = self._readings[:count], self._readings[count - 1:]
        duty, load = self._duty_and_load(during)
        if abs(duty) < MIN_DRIVING_DUTY:
            return ''
        turned = math.copysign(1.0, duty) * (during[-1].position - during[0].position)
        stopped = abs(turned) < self._toggle and (
            abs(duty) >= self._params.stall_duty or self._was_rolling(before))
        lowest = self._unloaded_speed(abs(duty) - load) * (during[-1].time - during[0].time)
        if stopped or turned + self._toggle < lowest:
            return self._description(turned, duty)
        return ''

    def lag(self, other: MotionCheck) -> str:
        """
        Return why this wheel contradicts the ``other`` one of its side, '' if it does not.

        Both roll under the same body: one whose motor has the higher duty is not much slower.
        """
        own, others = self._mean(), other._mean()
        if own is None or others is None:
            return ''
        direction = math.copysign(1.0, own[1])
        speed, duty, other_speed, other_duty = (direction * one for one in (*own, *others))
        if (duty < other_duty + MIN_EXTRA_DUTY or other_speed < MIN_ROLLING_SPEED
                or not 0.0 <= speed < MAX_SIDE_RATIO * other_speed):
            return ''
        return (f'turns at {own[0]:.2f} rad/s under duty {own[1]:.2f}, the other wheel of its '
                f'side at {others[0]:.2f} rad/s under {others[1]:.2f}: blocked, or counts lost')

    def _mean(self) -> tuple[float, float] | None:
        """Return mean speed [rad/s] and duty of the readings, None before they span the window."""
        readings = self._readings
        if not readings or (elapsed := readings[-1].time - readings[0].time) < (
                2.5 * self._params.stall_time):
            return None
        return ((readings[-1].position - readings[0].position) / elapsed,
                fmean(one.duty for one in readings[1:]))

    def _description(self, turned: float, duty: float) -> str:
        before, latest = self._readings[-2:]
        if min(abs(turned), abs(latest.position - before.position)) < self._toggle:
            return f'no encoder counts under duty {duty:.2f}: wheel blocked or encoder broken'
        if turned < 0.0:
            return f'turns against duty {duty:.2f}: encoder or motor reversed'
        return (f'turns too slowly under duty {duty:.2f}: encoder counts lost, or free_speed or '
                'stall_torque wrong')

    def _duty_and_load(self, readings: Sequence[Reading]) -> tuple[float, float]:
        """Return the mean duty and the largest load as a duty, torque over stall torque."""
        params, speeds = self._params, [
            (late.position - early.position) / (late.time - early.time)
            for early, late in itertools.pairwise(readings)]
        inertial = self._inertia * abs(speeds[-1] - speeds[0]) / (
            (readings[-1].time - readings[0].time) * params.stall_torque)
        measured = [one for one in readings[1:] if not math.isnan(one.torque)]
        if len(measured) < MIN_MEASURED:
            return fmean(one.duty for one in readings[1:]), MAX_LOAD + inertial
        torque = fmean(abs(one.torque) for one in measured)
        ratio = (1.0 + params.motor_tolerance) / (1.0 - params.motor_tolerance)
        return (fmean(one.duty for one in measured),
                (ratio * torque + MAX_TORQUE_ERROR) / params.stall_torque + inertial)

    def _unloaded_speed(self, duty: float) -> float:
        """Return the lowest speed [rad/s] of a motor without load at ``duty``."""
        tolerance = math.copysign(self._params.motor_tolerance, duty)
        return (1.0 - tolerance) * self._params.free_speed * duty

    def _was_rolling(self, before: Sequence[Reading]) -> bool:
        """Return whether the wheel was driven ``before``, at a duty that was not reduced since."""
        first, last = before[0], before[-1]
        direction = math.copysign(1.0, last.duty)
        duties = [direction * one.duty for one in self._readings]
        most = max(duties[:len(before)])
        driven = (min(duties) >= MIN_DRIVING_DUTY
                  and min(duties[duties.index(most):]) >= MIN_DUTY_RATIO * most)
        turned = direction * (last.position - first.position)
        return driven and turned >= max(MIN_ROLLING_SPEED * (last.time - first.time),
                                        MIN_ROLLING_COUNTS * self._toggle)
