# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Simulated scenarios of the slip and localization benchmark, and the grounds of all benchmarks.

Each is a full simulation with sensor errors and starts at standstill. The scenarios of the
friction benchmark (``friction.scenarios``) are derived from them. The default surface is flat
concrete.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import accumulate
from typing import Any

from benchmarks.events import cached_events
from benchmarks.faults import delayed, interrupted, reordered
import numpy as np
from smart_tire.parameters import RobotParams, SimulatorParams
from smart_tire.parameters.robot import EncoderParams, TireParams, TreadFilmParams
from smart_tire.parameters.simulation import PatchParams, RadioParams, SurfaceParams
from smart_tire.simulation.offline import Event, simulate

Leg = tuple[float, float, float]  # start time [s], rpm left, rpm right
Fault = Callable[[list[Event], int], list[Event]]  # events and seed to modified events

STANDSTILL = 3.0      # s, before the robot drives
WHEEL_LATENCY = 0.2   # s, in the scenario late_wheels
DROPOUTS = {          # topic -> start and end times [s]
    'imu/data': ((20.0, 22.0), (55.0, 58.0), (90.0, 91.0), (130.0, 132.0)),
    'wheel_states': ((40.0, 42.0), (110.0, 113.0))}
GAIN_STREAM = 3  # of random numbers; differs from the streams of the simulator

CONCRETE = SurfaceParams(base='concrete', patches=())
SAND = SurfaceParams(base='sand', patches=())
# mu .47, .20 and .60 along a left circle, all with the stiffness of concrete
JUMPS = SurfaceParams(
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
    ground: SurfaceParams = CONCRETE
    wheel_rate: float = 16.0         # Hz
    bias_scale: float = 1.0          # of the true turn-on biases, unknown to the estimator
    latency: float = 0.0             # s, of the wheel speeds, known to the estimator
    film: TreadFilmParams = TreadFilmParams(wheels=())  # nominal, known to the estimator
    gain_error: float = 0.0          # relative standard deviation of the true gains, unknown to it
    tire: TireParams = TireParams()  # of the estimator; the true C_x is that of the surface
    radio: RadioParams = RadioParams()
    fault: Fault | None = field(default=None, compare=False)

    @property
    def robot(self) -> RobotParams:
        """Return the robot parameters of the estimator."""
        return RobotParams(encoder=EncoderParams(latency=self.latency), film=self.film,
                           tire=self.tire)

    def simulator(self, seed: int) -> SimulatorParams:
        """Return the parameters of the simulated robot and surface."""
        robot = self.robot
        imu = replace(robot.imu, gyro_bias=self.bias_scale * robot.imu.gyro_bias,
                      accel_bias=self.bias_scale * robot.imu.accel_bias)
        nominal = np.array([gain for wheel in self.film.wheels for gain in self.film.gains(wheel)])
        errors = np.random.default_rng([seed, GAIN_STREAM]).standard_normal(len(nominal))
        gains = nominal * (1.0 + self.gain_error * errors)
        film = replace(robot.film, stretch_gain=tuple(gains.tolist()) or self.film.stretch_gain)
        return SimulatorParams(seed=seed, ground=self.ground, radio=self.radio,
                               robot=replace(robot, imu=imu, film=film))

    def events(self, seed: int) -> list[Event]:
        """Return the received messages and ``ground_truth/*`` in order of reception."""
        params = self.simulator(seed)
        run = repr((params, self.legs, self.duration, self.wheel_rate))
        events = cached_events(run, lambda: simulate(
            params, self.legs, self.duration, wheel_rate=self.wheel_rate))
        # a delayed message arrives after its timestamp
        events = delayed(events, 'wheel_states', self.latency)
        return self.fault(events, seed) if self.fault else events


def sequence(*parts: Leg) -> tuple[tuple[Leg, ...], float]:
    """Return legs from ``parts`` (duration [s], left, right [rpm]), and the end time [s]."""
    times = list(accumulate((length for length, _, _ in parts), initial=STANDSTILL))
    return tuple((t, left, right) for t, (_, left, right) in zip(times, parts)), times[-1]


def _insert_faults(events: list[Event], seed: int) -> list[Event]:
    """Insert four IMU and two wheel dropouts; repeat and reorder the remaining messages."""
    for topic, intervals in DROPOUTS.items():
        events = interrupted(events, topic, intervals)
    return reordered(events, tuple(DROPOUTS), duplicate_share=0.05, late_share=0.1,
                     max_delay=0.025, seed=seed)


REST: Leg = (1.5, 0.0, 0.0)
STOP: Leg = (2.0, 0.0, 0.0)
TURN = ((30.0, 120.0, 60.0),)
LEVELS = range(20, 141, 20)  # rpm, of the left side in a sweep
MOVES = ((4.0, 90.0, 90.0), (3.0, 100.0, 50.0), (3.0, -60.0, -60.0), (3.0, 50.0, 100.0),
         (2.0, 140.0, 140.0), (4.0, 40.0, 40.0))
STARTS = ((1.0, 140.0, 140.0), (0.6, 0.0, 0.0)) * 4
PULSES = ((0.9, 140.0, 140.0), (0.9, 20.0, 20.0)) * 4
BACK = ((1.0, -140.0, -140.0), (0.6, 0.0, 0.0)) * 4
SPIN = ((6.0, -50.0, 50.0), REST, (6.0, 60.0, -60.0), REST, (6.0, -60.0, -60.0), REST,
        (7.0, -80.0, -50.0), REST)


def _loops() -> Iterator[Leg]:
    """Yield 14 alternating right and left loops with a stop after every third."""
    for loop in range(14):
        yield (11.3, 98.0, 62.0) if loop % 2 == 0 else (11.3, 62.0, 98.0)
        if loop % 3 == 2:
            yield 4.0, 0.0, 0.0


def scenario(name: str, title: str, *parts: Leg, **properties: Any) -> Scenario:
    """Return the scenario of ``sequence(*parts)``; its duration may be given."""
    legs, end = sequence(*parts)
    return Scenario(name=name, title=title, legs=legs, **{'duration': end, **properties})


def _eight(name: str, title: str, **properties: Any) -> Scenario:
    return scenario(name, title, *_loops(), duration=180.0, **properties)


def by_name(*scenarios: Scenario) -> Mapping[str, Scenario]:
    """Return name -> scenario."""
    return {one.name: one for one in scenarios}


SCENARIOS = by_name(
    scenario('concrete', 'concrete, 120/60 rpm', *TURN),
    scenario('sand', 'sand, 120/60 rpm', *TURN, ground=SAND),
    *(scenario(f'sweep_{right}', f'sweep, right {right} rpm',
               *((5.0, float(left), float(right)) for left in LEVELS)) for right in (60, 80)),
    scenario('mu_jumps', 'mu jumps on a curve', (60.0, 60.0, 90.0), ground=JUMPS),
    _eight('figure_eight', 'figure-eight with stops'),
    scenario('stop_and_go', 'stop and go', *(part for move in MOVES * 2 for part in (move, REST))),
    _eight('degraded', 'degraded: 4 Hz, biases x3', wheel_rate=4.0, bias_scale=3.0),
    _eight('late_wheels', 'degraded: 4 Hz, 0.2 s late', wheel_rate=4.0, latency=WHEEL_LATENCY),
    _eight('gaps', 'degraded: dropouts, reordering', fault=_insert_faults),
    scenario('straight', 'straight accelerate / brake', *STARTS, *PULSES, (0.6, 0.0, 0.0), *BACK),
    scenario('spin_reverse', 'spin in place, reverse', *SPIN))
