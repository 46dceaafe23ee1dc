# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wheels at a set point of zero: held on a slope, and without duty on level ground."""

from __future__ import annotations

import math

from benchmarks.control.closed_loop import run_closed_loop, WheelHost
import numpy as np
import pytest
from smart_tire.control.constants import MAX_HOLD_DUTY
from smart_tire.control.wheel_control import WheelControl
from smart_tire.drivers.motor_board import MotionCheck, Reading
from smart_tire.parameters.control import WheelControllerParams
from smart_tire.parameters.hardware import MotorDriverParams
from smart_tire.samples import GRAVITY, NS_PER_S, WheelSample
from smart_tire.simulation.plant import Plant
from support.cases import long
from support.motors import simulator

STOP = 1.0       # s, when the set points become zero
DURATION = 7.0   # s
RADIUS = 0.087   # m
RESOLUTION = math.tau / 2000  # rad
SPEED = 6.0      # rad/s
FREE_SPEED = 22.2  # rad/s


class Host(WheelHost):
    """Drives with ``speed`` [rad/s], then commands zero; checks it as motor_driver does."""

    def __init__(self, speed, rate):
        super().__init__(WheelControllerParams(rate=rate),
                         lambda time: (speed * (time < STOP),) * 4)
        self._checks = [MotionCheck(MotorDriverParams(), RESOLUTION) for _ in range(4)]
        self._duty, self.rows, self.faults = (0.0,) * 4, [], []

    def receive(self, topic, sample, now_ns):
        """Take a reading of the wheels."""
        super().receive(topic, sample, now_ns)
        if isinstance(sample, WheelSample):
            self.faults += filter(None, (
                check.check_reading(Reading(sample.stamp_ns / NS_PER_S, *reading))
                for check, *reading in zip(
                    self._checks, sample.position, self._duty, sample.effort)))

    def duty(self, now_ns):
        """Return the duties."""
        self._duty = super().duty(now_ns)
        self.rows.append((self.elapsed(now_ns), *self._duty))
        return self._duty


def sloped(slope):
    """Return a plant on ground that rises by ``slope`` [rad] along x of the world."""
    class Sloped(Plant):

        def _step_body(self):
            forces, down = self.acceleration, -GRAVITY * math.sin(slope)
            self.acceleration = (forces[0] + down * math.cos(self.yaw),
                                 forces[1] - down * math.sin(self.yaw))
            super()._step_body()
            self.acceleration = forces  # the IMU measures specific force
    return Sloped


def stopped(degrees, speed, rate=16.0):
    """Return rolled distances [m] after the stop, at the end and in 3 s before, duties, faults."""
    host, states = Host(speed, rate), []
    run_closed_loop(simulator(21), host, DURATION, wheel_rate=rate, control_rate=rate,
                    plant=sloped(math.radians(degrees)),
                    watch=lambda plant: states.append([*plant.wheel_speed, *plant.wheel_angle]))
    states = np.array(states)
    after = round(1000 * STOP) + 100
    rest = after + int(np.argmax(np.abs(states[after:, :4]).max(axis=1) < 0.1))
    rolled = RADIUS * np.abs(states[:, 4:] - states[rest, 4:]).max(axis=1)
    rows = np.array(host.rows)
    return (rolled[rest:].max(), RADIUS * np.ptp(states[-3000:, 4:], axis=0).max(),
            rows[rows[:, 0] > DURATION - 3.0, 1:], host.faults)


@pytest.mark.parametrize(('speed', 'rate'), [
    (SPEED, 16.0), *long((-SPEED, 16.0), (SPEED, 100.0), (-SPEED, 100.0))])
def test_wheels_hold_on_8_degrees_and_do_not_count_as_blocked(speed, rate):
    rolled, late, duties, faults = stopped(8.0, speed, rate)
    assert rolled < 0.03  # 90 mm in 2 s, and on, without the hold
    assert late < 0.005   # dry friction of the plant is linear at low speeds
    assert np.ptp(duties, axis=0).max() < 0.02
    assert 0.02 < duties.min() <= duties.max() < 0.1
    assert not faults


@pytest.mark.parametrize('rate', [16.0, *long(4.0, 100.0)])
def test_wheels_on_level_ground_get_no_duty_and_do_not_move(rate):
    rolled, late, duties, faults = stopped(0.0, SPEED, rate)
    assert rolled < 0.004
    assert late < 0.001
    assert np.abs(duties).max() < 0.005  # of 0.037, which overcomes friction
    assert not faults or rate < 16.0  # motor_driver checks faster, whatever it publishes


class StickingWheel:
    """A wheel with static friction above the kinetic one, and its encoder."""

    INERTIA, STALL, KINETIC, STATIC = 0.028, 5.0, 0.18, 0.3  # kg m2, N m

    def __init__(self, load):
        self.load, self.speed, self.angle = load, 0.0, 0.0

    def move(self, duty, seconds=1.0 / 16):
        """Return the mean speed by the counts."""
        before = math.floor(self.angle / RESOLUTION)
        for _ in range(125):
            step = seconds / 125
            torque = self.STALL * (duty - self.speed / FREE_SPEED) - self.load
            if self.speed == 0.0 and abs(torque) <= self.STATIC:
                continue
            direction = math.copysign(1.0, self.speed or torque)
            speed = self.speed + (torque - direction * self.KINETIC) / self.INERTIA * step
            self.speed = speed if speed * direction > 0.0 else 0.0
            self.angle += self.speed * step
        return (math.floor(self.angle / RESOLUTION) - before) * RESOLUTION / seconds


@pytest.mark.parametrize('load', [0.0, 0.32, -0.32, 0.6])
def test_static_friction_causes_no_limit_cycle(load):
    control, wheel, duties, angles = WheelControl(WheelControllerParams()), StickingWheel(load), \
        [], []
    duty = 0.0
    for tick in range(200):
        now_ns = tick * NS_PER_S // 16
        control.add_reading((wheel.move(duty),) * 4, now_ns, now_ns + 1)
        duty = control.step((SPEED * (tick < 24),) * 4, now_ns)[1][0]
        duties.append(duty)
        angles.append(wheel.angle)
    assert max(angles[72:]) == min(angles[72:])  # from 3 s after the stop
    assert max(duties[80:]) == min(duties[80:])
    assert abs(duties[-1]) < (0.02 if load == 0.0 else 0.15)


def test_a_wheel_that_is_turned_by_force_resists_with_a_limited_duty():
    control = WheelControl(WheelControllerParams())
    for tick in range(160):
        now_ns = tick * NS_PER_S // 16
        control.add_reading((-2.0 * (tick > 2),) * 4, now_ns, now_ns + 1)
        duty = control.step((0.0,) * 4, now_ns)[1]
    assert duty == (MAX_HOLD_DUTY,) * 4
    assert MotorDriverParams().stall_duty > MAX_HOLD_DUTY


def test_the_hold_ends_with_the_commands():
    control, wheel = WheelControl(WheelControllerParams()), StickingWheel(0.32)
    duty = 0.0
    for tick in range(80):
        now_ns = tick * NS_PER_S // 16
        control.add_reading((wheel.move(duty),) * 4, now_ns, now_ns + 1)
        duty = control.step((SPEED * (tick < 24),) * 4, now_ns)[1][0]
    assert duty > 0.0
    assert control.step(None, now_ns + 1)[1] == (0.0,) * 4
    assert control.step((0.0,) * 4, now_ns + 2)[1] == (0.0,) * 4  # begins at zero again
