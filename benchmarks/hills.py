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
Scenarios on slopes and rough ground, for the slip benchmark and the tests of the estimator.

The robot drives straight, turns, stops and reverses. The terrain is added to the events of a
horizontal plane, with a seed of its own for each run.
"""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.scenarios import Fault, Leg, Scenario, sequence
from benchmarks.terrain import on_rough_ground, on_slopes, ramp, rolling_hills, speed_bump, Terrain
from smart_tire.parameters import RobotParams
from smart_tire.simulation.offline import Event

WAVELENGTHS = 5.0, 30.0  # m, of rolling hills
SLOPE_SIGMA = 0.02       # rad
RAMP = 0.05              # rad, down, after RAMP_BEGIN
RAMP_BEGIN = 4.0         # m
BUMP = 0.05, 1.0         # m, height and length of the speed bump
VIBRATION = 1.0          # m/s2, at 1 m/s
STOP: Leg = (2.0, 0.0, 0.0)
COURSE: tuple[Leg, ...] = (
    (8.0, 90.0, 90.0), (6.0, 110.0, 70.0), STOP, (8.0, 120.0, 120.0), (6.0, 70.0, 110.0),
    (8.0, 100.0, 100.0), STOP, (4.0, -60.0, -60.0), STOP, (10.0, 110.0, 110.0),
    (6.0, 80.0, 120.0), (8.0, 60.0, 60.0), STOP)


def on_terrain(terrain: Terrain, robot: RobotParams | None = None) -> Fault:
    """Return the change of events that puts a run on ``terrain``."""
    def change(events: list[Event], seed: int) -> list[Event]:
        return on_slopes(events, robot or RobotParams(), terrain)
    return change


def _on_hills(events: list[Event], seed: int) -> list[Event]:
    hills = rolling_hills(SLOPE_SIGMA, WAVELENGTHS, seed)
    return on_slopes(events, RobotParams(), hills)


def _on_rough_hills(events: list[Event], seed: int) -> list[Event]:
    return on_rough_ground(_on_hills(events, seed), VIBRATION, seed)


def _scenario(name: str, title: str, fault: Fault) -> Scenario:
    legs, duration = sequence(*COURSE)
    return Scenario(name=name, title=title, legs=legs, duration=duration, fault=fault)


HILL_SCENARIOS: Mapping[str, Scenario] = {scenario.name: scenario for scenario in (
    _scenario('hills', 'rolling hills, 20 mrad', _on_hills),
    _scenario('rough_hills', 'rolling hills, rough ground', _on_rough_hills),
    _scenario('ramp', 'constant ramp, 50 mrad',
              on_terrain(ramp(-RAMP, RAMP_BEGIN, transition=1.0))),
    _scenario('speed_bump', 'speed bump, 50 mm',
              on_terrain(speed_bump(*BUMP, center=RAMP_BEGIN))),
)}
