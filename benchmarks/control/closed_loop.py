# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Closed control loop offline: deterministic, faster than real time."""

from __future__ import annotations

from collections.abc import Callable
import heapq
from typing import Protocol

from smart_tire.control.wheel_control import WheelControl
from smart_tire.parameters.control import WheelControllerParams
from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.samples import Four, NS_PER_S, Sample, WheelSample
from smart_tire.simulation.offline import EPOCH_NS, Event, SimulatedHost
from smart_tire.simulation.plant import Plant, TIME_STEP
from smart_tire.simulation.robot import PeriodicTimer, Robot

DUTY_DELAY_NS = 2_000_000  # from the controller to the motors: one request to each board


class Controller(Protocol):
    """Software on the host; all times are nanoseconds of the clock of the host."""

    def receive(self, topic: str, sample: Sample, now_ns: int) -> None:
        """Process a message received at ``now_ns``: sensors and ``ground_truth/*``."""

    def duty(self, now_ns: int) -> Four:
        """Return the duties [-1, 1] from ``now_ns`` on; called in each control period."""

    def finished(self, now_ns: int) -> bool:
        """Return whether the run may end."""


class WheelHost:
    """Wheel control that follows ``set_points`` [rad/s], of the time [s] since the first duty."""

    def __init__(self, params: WheelControllerParams, set_points: Callable[[float], Four]) -> None:
        self.control = WheelControl(params)
        self._set_points = set_points
        self._begin_ns: int | None = None

    def receive(self, topic: str, sample: Sample, now_ns: int) -> None:
        """Take the wheel speeds."""
        if isinstance(sample, WheelSample):
            self.control.add_reading(sample.velocity, now_ns, sample.stamp_ns, sample.position,
                                     sample.effort)

    def elapsed(self, now_ns: int) -> float:
        """Return the time [s] since the first duty; 0 before."""
        return (now_ns - (self._begin_ns or now_ns)) / NS_PER_S

    def duty(self, now_ns: int) -> Four:
        """Return the duties for the set points at ``now_ns``."""
        self._begin_ns = self._begin_ns or now_ns
        return self.control.step(self._set_points(self.elapsed(now_ns)), now_ns)[1]

    def finished(self, now_ns: int) -> bool:
        """Return False: the run ends by its duration."""
        return False


def run_closed_loop(params: SimulatorParams, controller: Controller, duration: float, *,
                    wheel_rate: float = 16.0, control_rate: float = 16.0,
                    watch: Callable[[Plant], None] | None = None,
                    plant: type[Plant] = Plant) -> list[Event]:
    """
    Return the messages of a run in which ``controller`` drives the robot, sorted by reception.

    The run ends after ``duration`` [s], or when the controller has finished. ``wheel_rate`` [Hz]
    is that of ``wheel_states``, ``control_rate`` [Hz] that of the duties. Each message reaches the
    controller at its time of reception; a duty reaches the motors ``DUTY_DELAY_NS`` later. The
    same seed and controller give the same run. ``watch`` is called with the true state at each
    step; ``plant`` may have other tires.
    """
    robot, host = Robot(params, plant), SimulatedHost(params, wheel_rate, EPOCH_NS)
    control_due = PeriodicTimer(NS_PER_S / control_rate)
    arriving: list[tuple[int, int, str, Sample]] = []  # heap: reception, number, topic, sample
    commanded: list[tuple[int, Four]] = []             # time at the motors, duty
    duty: Four = (0.0, 0.0, 0.0, 0.0)
    taken = 0                                          # events moved to the heap
    for _ in range(round(duration / TIME_STEP)):
        while commanded and commanded[0][0] <= robot.plant.time_ns:
            duty = commanded.pop(0)[1]
        for observation in robot.step(duty):
            host.receive(observation)
        host.poll_wheels(robot, duty)
        if watch is not None:
            watch(robot.plant)
        for receive_ns, topic, sample in host.events[taken:]:
            heapq.heappush(arriving, (receive_ns, taken, topic, sample))
            taken += 1
        now_ns = EPOCH_NS + robot.plant.time_ns
        while arriving and arriving[0][0] <= now_ns:
            receive_ns, _, topic, sample = heapq.heappop(arriving)
            controller.receive(topic, sample, receive_ns)
        if control_due.expired(robot.plant.time_ns):
            if controller.finished(now_ns):
                break
            commanded.append((robot.plant.time_ns + DUTY_DELAY_NS, controller.duty(now_ns)))
    return sorted(host.events, key=lambda event: event[0])
