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

"""Offline simulation, faster than real time: samples as published by the drivers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math

from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.samples import Four, NS_PER_S
from smart_tire.simulation.host import EPOCH_NS, Event, SimulatedHost
from smart_tire.simulation.plant import Plant, TIME_STEP
from smart_tire.simulation.robot import Robot

Schedule = Callable[[float], tuple[float, float]] | Sequence[tuple[float, float, float]]

RAD_PER_S_PER_RPM = math.tau / 60.0
CONTROL_PERIOD_STEPS = 20    # plant steps between two steps of the speed control: 50 Hz
MAX_SET_POINT_RATE = 20.0    # rad/s2, of the wheel speeds
SPEED_KP = 0.1               # s/rad, duty per speed error
SPEED_KI = 0.5               # 1/rad, duty per integrated speed error


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
    control = _SpeedControl(_as_function(schedule), params.drive.free_speed)
    duty: Four = (0.0, 0.0, 0.0, 0.0)
    for step in range(round(duration / TIME_STEP)):
        if step % CONTROL_PERIOD_STEPS == 0:
            duty = control.update(robot.plant)
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
                 free_speed: float) -> None:
        self._schedule, self._free_speed = schedule, free_speed
        self._set_point = [0.0] * 4  # rad/s
        self._integral = [0.0] * 4   # duty

    def update(self, plant: Plant) -> Four:
        dt = CONTROL_PERIOD_STEPS * TIME_STEP
        scheduled = self._schedule(plant.time_ns / NS_PER_S) * 2  # left, right, left, right
        fl, fr, rl, rr = (self._duty(i, scheduled[i] * RAD_PER_S_PER_RPM, plant.wheel_speed[i], dt)
                          for i in range(4))
        return fl, fr, rl, rr

    def _duty(self, i: int, scheduled: float, speed: float, dt: float) -> float:
        limit = MAX_SET_POINT_RATE * dt
        self._set_point[i] += min(max(scheduled - self._set_point[i], -limit), limit)
        error = self._set_point[i] - speed
        integral = self._integral[i] + SPEED_KI * error * dt
        duty = self._set_point[i] / self._free_speed + SPEED_KP * error + integral
        if abs(duty) < 1.0 or error * duty < 0.0:
            self._integral[i] = integral
        return min(max(duty, -1.0), 1.0)
