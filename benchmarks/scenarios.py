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

"""
Simulated scenarios of the slip and localization benchmark.

Each is a full simulation with sensor errors and starts at standstill. The scenarios of the
friction benchmark (``friction.scenarios``) are derived from them. The default surface is flat
concrete. Wheel speeds are chosen so that the true slip resembles that of the runs of the
reference filter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import accumulate

from benchmarks.efforts import scaled_efforts
from benchmarks.event_cache import cached_events
from benchmarks.faults import delayed, interrupted, reordered
import numpy as np

from smart_tire.parameters import RobotParams, SimulatorParams
from smart_tire.parameters.robot import EncoderParams, FilmParams, TireParams
from smart_tire.parameters.simulation import (
    DriveParams, GroundParams, PatchParams, RadioParams, SensorErrorParams)
from smart_tire.simulation.offline import Event, simulate

Leg = tuple[float, float, float]  # start time [s], rpm left, rpm right
Fault = Callable[[list[Event], int], list[Event]]  # events and seed to modified events

STANDSTILL = 3.0      # s, before the robot drives
WHEEL_LATENCY = 0.2   # s, in the scenario late_wheels
DROPOUTS = {          # topic -> start and end times [s]
    'imu/data': ((20.0, 22.0), (55.0, 58.0), (90.0, 91.0), (130.0, 132.0)),
    'wheel_states': ((40.0, 42.0), (110.0, 113.0))}
GAIN_STREAM = 3  # of random numbers; differs from the streams of the simulator

CONCRETE = GroundParams(base='concrete', patches=())
SAND = GroundParams(base='sand', patches=())
# mu .47, .20 and .60 along a left circle, all with the stiffness of concrete
JUMPS = GroundParams(
    names=('concrete', 'slippery', 'rough'), friction=(0.47, 0.20, 0.60),
    stiffness=(52.7, 52.7, 52.7), drag=(0.015, 0.015, 0.015), base='concrete',
    patches=(PatchParams(name='right', surface='slippery', x=(0.0, 50.0), y=(0.9, 50.0)),
             PatchParams(name='left', surface='rough', x=(-50.0, 0.0), y=(0.9, 50.0))))


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A simulated run: wheel speeds, surface and sensor errors."""

    name: str
    title: str
    legs: tuple[Leg, ...]
    duration: float                  # s
    ground: GroundParams = CONCRETE
    wheel_rate: float = 16.0         # Hz
    bias_scale: float = 1.0          # of the true turn-on biases, unknown to the estimator
    latency: float = 0.0             # s, of the wheel speeds, known to the estimator
    film: FilmParams = FilmParams(wheels=())  # nominal, known to the estimator
    gain_error: float = 0.0          # relative standard deviation of the true gains, unknown to it
    tire: TireParams = TireParams()  # of the estimator; the true C_x is that of the surface
    platform: RobotParams = RobotParams()  # robot apart from encoders, films and tires
    center_of_mass_error: tuple[float, float] = (0.0, 0.0)  # m, true minus known, x and y
    drive: DriveParams = DriveParams()
    torque_ratio: float = 1.0              # true torque constants over those of the estimator
    errors: SensorErrorParams = SensorErrorParams()
    radio: RadioParams = RadioParams()
    fault: Fault | None = field(default=None, compare=False)
    averaged: bool = False           # scored at all times against truth averaged over 125 ms

    @property
    def robot(self) -> RobotParams:
        """Return the robot parameters of the estimator."""
        return replace(self.platform, encoder=EncoderParams(latency=self.latency),
                       film=self.film, tire=self.tire)

    def simulator(self, seed: int) -> SimulatorParams:
        """Return the parameters of the simulated robot and surface."""
        robot = self.robot
        imu = replace(robot.imu, gyro_bias=self.bias_scale * robot.imu.gyro_bias,
                      accel_bias=self.bias_scale * robot.imu.accel_bias)
        nominal = np.array([gain for wheel in self.film.wheels for gain in self.film.gains(wheel)])
        errors = np.random.default_rng([seed, GAIN_STREAM]).standard_normal(len(nominal))
        gains = nominal * (1.0 + self.gain_error * errors)
        film = replace(robot.film, stretch_gain=tuple(gains.tolist()) or self.film.stretch_gain)
        x, y, z = robot.center_of_mass
        off_x, off_y = self.center_of_mass_error
        true = replace(robot, imu=imu, film=film, center_of_mass=(x + off_x, y + off_y, z))
        return SimulatorParams(seed=seed, ground=self.ground, radio=self.radio, drive=self.drive,
                               errors=self.errors, robot=true)

    def events(self, seed: int) -> list[Event]:
        """Return the received messages and ``ground_truth/*`` in order of reception."""
        params = self.simulator(seed)
        run = repr((params, self.legs, self.duration, self.wheel_rate))
        events = cached_events(run, lambda: simulate(
            params, self.legs, self.duration, wheel_rate=self.wheel_rate))
        if self.torque_ratio != 1.0:
            events = scaled_efforts(events, 1.0 / self.torque_ratio)
        # a delayed message arrives after its timestamp
        events = delayed(events, 'wheel_states', self.latency)
        return self.fault(events, seed) if self.fault else events


def sequence(*parts: Leg) -> tuple[tuple[Leg, ...], float]:
    """Return legs from ``parts`` (duration [s], left, right [rpm]), and the end time [s]."""
    times = list(accumulate((length for length, _, _ in parts), initial=STANDSTILL))
    return tuple((t, left, right) for t, (_, left, right) in zip(times, parts)), times[-1]


def _sweep(right: float) -> Scenario:
    legs, duration = sequence(*((5.0, left, right) for left in range(20, 141, 20)))
    return Scenario(name=f'sweep_{right:.0f}', title=f'sweep, right {right:.0f} rpm', legs=legs,
                    duration=duration)


def _figure_eight() -> tuple[tuple[Leg, ...], float]:
    """Return 180 s of alternating right and left loops with a stop after every third."""
    lobes: list[Leg] = []
    for loop in range(14):
        lobes.append((11.3, 98.0, 62.0) if loop % 2 == 0 else (11.3, 62.0, 98.0))
        if loop % 3 == 2:
            lobes.append((4.0, 0.0, 0.0))
    legs, _ = sequence(*lobes)
    return legs, 180.0


def _stop_and_go() -> Scenario:
    moves = ((4.0, 90.0, 90.0), (3.0, 100.0, 50.0), (3.0, -60.0, -60.0), (3.0, 50.0, 100.0),
             (2.0, 140.0, 140.0), (4.0, 40.0, 40.0))
    rest = 1.5, 0.0, 0.0
    legs, duration = sequence(*(part for move in moves * 2 for part in (move, rest)))
    return Scenario(name='stop_and_go', title='stop and go', legs=legs, duration=duration)


def _straight() -> Scenario:
    starts = [(1.0, 140.0, 140.0), (0.6, 0.0, 0.0)] * 4
    pulses = [(0.9, speed, speed) for speed in (140.0, 20.0)] * 4
    back = [(1.0, -140.0, -140.0), (0.6, 0.0, 0.0)] * 4
    legs, duration = sequence(*starts, *pulses, (0.6, 0.0, 0.0), *back)
    return Scenario(name='straight', title='straight accelerate / brake', legs=legs,
                    duration=duration, averaged=True)


def _spin() -> Scenario:
    rest = 1.5, 0.0, 0.0
    legs, duration = sequence(
        (6.0, -50.0, 50.0), rest, (6.0, 60.0, -60.0), rest, (6.0, -60.0, -60.0), rest,
        (7.0, -80.0, -50.0), rest)
    return Scenario(name='spin_reverse', title='spin in place, reverse', legs=legs,
                    duration=duration)


def _insert_faults(events: list[Event], seed: int) -> list[Event]:
    """Insert four IMU and two wheel dropouts; repeat and reorder the remaining messages."""
    for topic, intervals in DROPOUTS.items():
        events = interrupted(events, topic, intervals)
    return reordered(events, tuple(DROPOUTS), duplicate_share=0.05, late_share=0.1,
                     max_delay=0.025, seed=seed)


def _all() -> tuple[Scenario, ...]:
    turn, turn_end = sequence((30.0, 120.0, 60.0))
    curve, curve_end = sequence((60.0, 60.0, 90.0))
    eight, eight_end = _figure_eight()
    loops = partial(Scenario, legs=eight, duration=eight_end)
    return (
        Scenario(name='concrete', title='concrete, 120/60 rpm', legs=turn, duration=turn_end),
        Scenario(name='sand', title='sand, 120/60 rpm', legs=turn, duration=turn_end, ground=SAND),
        _sweep(60.0), _sweep(80.0),
        Scenario(name='mu_jumps', title='mu jumps on a curve', legs=curve,
                 duration=curve_end, ground=JUMPS),
        loops(name='figure_eight', title='figure-eight with stops'),
        _stop_and_go(),
        loops(name='degraded', title='degraded: 4 Hz, biases x3', wheel_rate=4.0,
              bias_scale=3.0),
        loops(name='late_wheels', title='degraded: 4 Hz, 0.2 s late', wheel_rate=4.0,
              latency=WHEEL_LATENCY),
        loops(name='gaps', title='degraded: dropouts, reordering', fault=_insert_faults),
        _straight(), _spin())


SCENARIOS: Mapping[str, Scenario] = {scenario.name: scenario for scenario in _all()}
