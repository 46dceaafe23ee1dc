# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulated drives in closed loop with the check of the encoders, and faults of these."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.control.wheel_control import WheelControl
from smart_tire.drivers.motor_board import CHECK_PERIOD_NS, MotionCheck, Reading
from smart_tire.models.vehicle.drive import measured_torque
from smart_tire.parameters import MotorDriverParams, RobotParams, SimulatorParams
from smart_tire.parameters.control import WheelControllerParams
from smart_tire.parameters.robot import MotorParams, TreadFilmParams
from smart_tire.parameters.simulation import DriveParams, SurfaceParams
from smart_tire.samples import NS_PER_S, VelocityCommand
from smart_tire.simulation.plant import Plant, SurfaceMap, TIME_STEP
from smart_tire.simulation.robot import Motors

RESOLUTION = math.tau / 2000
GRAVITY = 9.81    # m/s2
WHEELS = range(4)


def ground(friction, stiffness=52.7, drag=0.015):
    """Return uniform ground."""
    return SurfaceParams(names=('ground',), friction=(friction,), stiffness=(stiffness,),
                         drag=(drag,), base='ground', patches=())


GROUNDS = {'concrete': ground(0.47), 'sand': ground(0.35, 30.0, 0.16), 'ice': ground(0.1),
           'air': ground(0.0, 1e-3, 0.0)}


@dataclass(frozen=True)
class Fault:
    """What the encoder of one wheel reports from a time [s] on."""

    kind: str    # 'frozen', 'toggling', 'reversed' or 'losing'
    wheel: int
    begin: float

    def count(self, angle, angle_before):
        """Return the count at an angle [rad], given the angle at which the fault began."""
        before = math.floor(angle_before / RESOLUTION)
        share = {'losing': 0.2, 'reversed': -1.0}.get(self.kind, 0.0)
        toggle = math.floor(angle / RESOLUTION) % 2 if self.kind == 'toggling' else 0
        return before + toggle + math.floor(share * (angle - angle_before) / RESOLUTION)


def other_robot(seed):
    """Return robot and drive whose parameters differ from the configured ones by up to 20 %."""
    rng, motor, drive = np.random.default_rng(seed), MotorParams(), DriveParams()

    def vary(value):
        return value * (1.0 + rng.uniform(-0.2, 0.2))

    names = 'torque_constant', 'coulomb_friction', 'axle_friction', 'inertia'
    return (RobotParams(film=TreadFilmParams(wheels=()), mass=vary(10.9), motor=replace(
        motor, **{name: vary(getattr(motor, name)) for name in names})),
        DriveParams(stall_torque=vary(drive.stall_torque), free_speed=vary(drive.free_speed)))


def random_drive(seed, duration):
    """Return a function of time: starts, stops, reversals, curves and turns in place."""
    rng, parts, time = np.random.default_rng([seed, 9]), [], 0.5
    while time < duration:
        forward, turn = rng.uniform(-1.4, 1.4), rng.uniform(-3.0, 3.0)
        choices = ((forward, 0.0), (0.0, turn), (0.6 * forward, 0.6 * turn), (0.1 * forward, 0.0),
                   (0.0, 0.2 * turn), (0.0, 0.0))
        parts.append((time, *choices[rng.integers(len(choices))]))
        time += rng.uniform(0.3, 3.0)

    def command(now):
        return next(((v, w) for begin, v, w in reversed(parts) if begin <= now), (0.0, 0.0))
    return command


class Drive:
    """
    One simulated drive; ``command`` gives (m/s, rad/s) at each time, or ``duty`` the duties.

    ``currents`` is False for boards that do not measure them, ``braking_currents`` for those that
    report none while a motor brakes. ``slope`` [rad] is positive uphill.
    """

    def __init__(self, command=None, *, surface='concrete', seed=1, robot=None, rate=16.0,
                 duty=None, fault=None, currents=True, slope=0.0, tolerance=0.2,
                 braking_currents=True):
        robot, drive = robot or (RobotParams(film=TreadFilmParams(wheels=())), DriveParams())
        if surface == 'air':
            robot = replace(robot, mass=0.01)
        params = SimulatorParams(seed=seed, ground=GROUNDS[surface], robot=robot, drive=drive)
        self._motors, self._driver = Motors(params), MotorDriverParams(
            rate=rate, motor_tolerance=tolerance)
        self.plant = Plant(robot, drive, SurfaceMap(params.ground),
                           friction_scale=self._motors.friction_scale)
        self._command, self._open_loop, self._fault = command, duty, fault
        self._currents, self._braking = currents, braking_currents
        self._pull = GRAVITY * math.sin(slope) * TIME_STEP
        self._checks = [MotionCheck(self._driver, RESOLUTION) for _ in WHEELS]
        self._control = WheelControl(WheelControllerParams(rate=rate))
        self._period = 1.0 / rate
        self._poll, self._step = np.random.default_rng([seed, 7]).uniform(0.0, self._period, 2)
        self._check = 0.0
        self._angle_at_fault, self._last, self._duty = None, None, (0.0,) * 4

    def trips(self, duration):
        """Return (time [s], wheel, text) of the faults found within ``duration`` [s]."""
        return list(self._run(duration))

    def first_trip(self, duration):
        """Return the first of them, None if there is none."""
        return next(self._run(duration), None)

    def _run(self, duration):
        for step in range(round(duration / TIME_STEP)):
            now = step * TIME_STEP
            self.plant.step(self._duty)
            self.plant.v_x -= self._pull
            if now >= self._poll:
                self._poll += self._period
                yield from ((now, wheel, text) for wheel, text in self._read(now))
            if now >= self._step:
                self._step += self._period
                self._duty = self._duties(now)

    def _duties(self, now):
        if self._open_loop is not None:
            return self._open_loop
        v_x, yaw_rate = self._command(now)
        return self._control.follow(VelocityCommand(1, v_x, yaw_rate), _ns(now))[1]

    def _count(self, wheel, now):
        fault, angle = self._fault, self.plant.wheel_angle[wheel]
        if fault is None or fault.wheel != wheel or now < fault.begin:
            return math.floor(angle / RESOLUTION)
        if self._angle_at_fault is None:
            self._angle_at_fault = angle
        return fault.count(angle, self._angle_at_fault)

    def _read(self, now):
        angles = [RESOLUTION * self._count(wheel, now) for wheel in WHEELS]
        before, self._last = self._last, (now, angles)
        if before is None:
            return
        velocity = tuple((new - old) / (now - before[0]) for new, old in zip(angles, before[1]))
        self._control.add_reading(velocity, _ns(now), _ns(now))
        if now < self._check:
            return
        self._check = now + CHECK_PERIOD_NS / NS_PER_S
        torques = self._torques(velocity)
        found = [check.check_reading(Reading(now, *reading)) for check, *reading in zip(
            self._checks, angles, self._duty, torques)]
        for wheel, check in enumerate(self._checks):
            if text := found[wheel] or check.lag(self._checks[wheel - 2]):
                check.reset()
                yield wheel, text

    def _torques(self, velocity):
        if not self._currents:
            return (math.nan,) * 4
        currents = self._motors.reported(self._motors.currents(self.plant), self._duty)
        if not self._braking:
            currents = [max(current, 0.0) for current in currents]
        return tuple(measured_torque(
            *one, torque_constant=self._driver.robot.motor.torque_constant, current_sign='draw')
            for one in zip(currents, self._duty, velocity))


def _ns(time):
    return round((time + 1.0) * NS_PER_S)
