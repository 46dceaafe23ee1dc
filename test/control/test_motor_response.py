# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Speed control with measured torques: motors that are late, limited, blocked and released."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from smart_tire.control.motor_response import MotorResponse, MotorState
from smart_tire.control.wheel_control import WheelControl, WheelServo
from smart_tire.control.wheel_feedback import WheelFeedback
from smart_tire.control.wheel_servo import drive_model, Pid
from smart_tire.parameters.control import PidParams, WheelControllerParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import NS_PER_S
from support.cases import long

MODEL = drive_model(PidParams(), RobotParams())
STEP = 0.002       # s, of the plant
SET_POINT = 10.0   # rad/s
RATES, PHASES = (16.0, 100.0), (0.0, 0.3, 0.7)  # Hz; periods between a duty and a reading

every_phase = pytest.mark.parametrize(
    ('rate', 'phase'), [(16.0, 0.3), (100.0, 0.0), *long(*(
        (rate, phase) for rate in RATES for phase in PHASES))])


@dataclass(frozen=True)
class Motor:
    """Four equal motors with wheels on the ground; ``measured`` with their torques."""

    delay: float = 0.0             # s, from a duty to the torque
    limit: float = math.inf        # N m
    blocked: tuple[float, float] = (math.inf, math.inf)  # s
    strength: float = 1.0          # of the torque at a duty and a speed, over that of the model
    free_speed: float = 1.0        # over that of the model
    measured: bool = True

    def torque(self, duty: float, speed: float) -> float:
        """Return the torque [N m]."""
        free = self.strength * MODEL.stall_torque * (
            duty - MODEL.free_gain / self.free_speed * speed)
        return min(max(free, -self.limit), self.limit)


def run(motor, rate, phase, duration=4.0, sign=1.0, known=0.0):
    """
    Return the times [s] and the speeds [rad/s] after a step, and the controller.

    The latter has learned the ``known`` delay [s] before.
    """
    control = WheelControl(WheelControllerParams(rate=rate))
    control._response.delay = known
    speed = angle = duty = torque = before = 0.0
    times, pending, speeds = np.arange(0.0, duration, STEP), [], []
    control_due, reading_due, read_s = 0.0, phase / rate, -1.0 / rate
    for time in times.tolist():
        now_ns = round((time + 100.0) * NS_PER_S)
        if time >= reading_due:
            control.add_reading(((angle - before) / (time - read_s),) * 4, now_ns, now_ns,
                                (angle,) * 4, (torque,) * 4 if motor.measured else None)
            before, read_s, reading_due = angle, time, reading_due + 1.0 / rate
        if time >= control_due:
            command = SET_POINT if time > 0.8 else 0.0
            pending.append((time + motor.delay, control.step((sign * command,) * 4, now_ns)[1][0]))
            control_due += 1.0 / rate
        while pending and pending[0][0] <= time:
            duty = pending.pop(0)[1]
        torque = motor.torque(duty, speed)
        friction = MODEL.friction * MODEL.stall_torque
        free = speed + STEP * torque / MODEL.inertia
        speed = math.copysign(max(abs(free) - STEP * friction / MODEL.inertia, 0.0), free)
        if motor.blocked[0] <= time < motor.blocked[1]:
            speed = 0.0
        angle += STEP * speed
        speeds.append(sign * speed)
    return times, np.array(speeds), control


@every_phase
def test_a_wheel_that_is_released_soon_has_its_speed_again(rate, phase):
    """Its speed is known one or two readings later, when it may be too high already."""
    motor = Motor(blocked=(1.5, 3.0))
    too_fast, without = (STEP * np.sum(speeds > 1.1 * SET_POINT) for _, speeds, _ in (
        run(motor, rate, phase), run(replace(motor, measured=False), rate, phase)))
    assert without > 0.35
    assert too_fast < (0.25 if rate < 50.0 else 0.1)


@every_phase
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_behind_a_limit_of_the_current_the_integral_does_not_grow(rate, phase, sign):
    motor = Motor(limit=0.6)
    _, speeds, _ = run(motor, rate, phase, sign=sign)
    assert speeds.max() < 1.2 * SET_POINT
    assert speeds[-1] == pytest.approx(SET_POINT, abs=0.1)
    _, without, _ = run(replace(motor, measured=False), rate, phase, sign=sign)
    assert without.max() > 1.35 * SET_POINT


@every_phase
@pytest.mark.parametrize('delay', [0.2, *long(0.1, 0.4)])
def test_a_delay_of_the_motors_is_found_and_the_control_is_stable(rate, phase, delay):
    times, speeds, control = run(Motor(delay=delay), rate, phase, duration=6.0)
    found, reduced = control.motor_delay
    assert found == pytest.approx(delay, abs=0.5 / rate + 0.0251)
    assert reduced or delay < 0.12
    assert np.abs(speeds[times > 4.0] - SET_POINT).max() < 0.05 * SET_POINT


@every_phase
def test_a_speed_is_compared_with_that_expected_of_late_motors(rate, phase):
    _, speeds, _ = run(Motor(delay=0.2), rate, phase, known=0.2)
    assert speeds.max() < 1.01 * SET_POINT  # 1.29 where a late wheel is taken for a slow one


def test_a_delay_that_is_not_measured_makes_the_speed_oscillate():
    times, speeds, control = run(Motor(delay=0.2, measured=False), 100.0, 0.0, duration=6.0)
    assert np.ptp(speeds[times > 4.0]) > 0.5 * SET_POINT
    assert control.motor_delay == (0.0, False)


@every_phase
@pytest.mark.parametrize('motor', [
    Motor(strength=0.7), Motor(strength=1.4), Motor(free_speed=0.75), Motor(free_speed=1.3),
    Motor(limit=0.4), *long(Motor(limit=0.6), Motor(blocked=(1.5, 3.0)))], ids=str)
def test_a_motor_that_differs_from_its_model_is_not_late_and_reaches_the_speed(
        rate, phase, motor):
    _, speeds, control = run(motor, rate, phase, duration=5.0)
    assert control.motor_delay == (0.0, False)
    assert speeds[-1] == pytest.approx(SET_POINT, rel=0.02)


def test_without_torques_of_all_motors_nothing_is_known():
    response, feedback = MotorResponse(), WheelFeedback(0.06)
    for tick, torque in enumerate(((1.0,) * 4, (1.0,) * 4, (1.0, 1.0, math.nan, 1.0))):
        feedback.add_reading((1.0,) * 4, (tick + 1) * NS_PER_S // 10)
        response.learn(torque, feedback, MODEL)
        assert bool(response.motors) is (tick == 1)


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize(('torque', 'missing'), [
    (0.5, 0.0), (0.36, 0.0), (0.34, 0.16), (0.0, 0.5), (-0.2, 0.7),
    (0.9, 0.0)])  # more than given: supply and heat, and no limit
def test_a_part_of_the_duty_is_missing_of_a_motor_with_less_torque(sign, torque, missing):
    response, feedback = MotorResponse(), WheelFeedback(0.06)
    response.command((sign * 0.5,) * 4, 0)
    for tick in (1, 2):
        feedback.add_reading((0.0,) * 4, tick * NS_PER_S // 10)
        response.learn((sign * torque * MODEL.stall_torque,) * 4, feedback, MODEL)
    assert [one.missing for one in response.motors] == [pytest.approx(sign * missing)] * 4


def test_a_wheel_that_accelerates_on_its_own_has_no_load_that_ended():
    def duties(tire, motors=()):
        servo, feedback = WheelServo(0, WheelControllerParams()), WheelFeedback(0.06)
        response = SimpleNamespace(delay=0.0, motors=motors)
        found = []
        for tick in range(1, 30):
            now_ns = tick * NS_PER_S // 16
            feedback.add_reading((1.0,) * 4, now_ns)
            found.append(servo.step(4.0, feedback, 1 / 16, now_ns, response, tire))
        return found

    released = (MotorState(0.0, 1.0, 0.0),) * 4
    on_its_own = Mock(torque=0.0, slips=Mock(return_value=False))
    assert duties(on_its_own, released) == duties(on_its_own)
    assert duties(None, released)[-1] < 0.9 * duties(None)[-1]


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_only_a_torque_that_accelerates_with_the_integral_ends_its_load(sign):
    def left(inertial, load, error=0.1):
        pid = Pid(PidParams(proportional=0.0, integral=1.0))
        pid.duty(0.0, sign * 0.5, 0.0, 1.0)  # integral 0.5
        pid.unload(sign * inertial, sign * load, error)
        return sign * pid.duty(0.0, 0.0, 0.0, 1.0)

    assert left(0.3, 0.0) == pytest.approx(0.1)    # the error remains
    assert left(0.3, 0.25) == pytest.approx(0.35)  # of the load that is left
    assert left(0.3, 2.0) == left(0.09, 0.0) == left(-0.3, 0.0) == pytest.approx(0.5)
    assert left(0.3, -0.09) == pytest.approx(0.01)
    assert left(0.3, -0.11) == pytest.approx(0.5)  # the wheel slides
