# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulated recordings with injected faults, as input of the checks."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any

from benchmarks.events import cached_events
from smart_tire.checks import findings
from smart_tire.checks.recording import CheckedRecording, READ
from smart_tire.findings import Finding, Level
from smart_tire.parameters import RobotParams
from smart_tire.parameters.simulation import SimulatorParams, SurfaceParams
from smart_tire.recording import SampleArrays
from smart_tire.simulation.offline import Event, simulate

DRIVE = ((2.0, 90.0, 90.0), (5.0, 100.0, 60.0), (9.0, 40.0, 80.0), (12.0, 0.0, 0.0),
         (15.0, -60.0, -80.0), (19.0, 90.0, 90.0), (22.0, 0.0, 0.0))  # start time [s], rpm
DURATION = 24.0  # s
DEFAULT = RobotParams()

Drive = tuple[tuple[float, float, float], ...]


@lru_cache
def clean(seed: int = 1, base: str = 'concrete', drive: Drive = DRIVE,
          wheel_rate: float = 16.0, robot: RobotParams = DEFAULT) -> tuple[Event, ...]:
    """Return the events of a drive, by default with turns, starts, stops and standstill."""
    ground = SurfaceParams(base=base, patches=())
    params = SimulatorParams(seed=seed, ground=ground, robot=robot)
    return tuple(event for event in cached_events(
        f'{params} {drive} {wheel_rate} {DURATION}',
        lambda: simulate(params, drive, DURATION, wheel_rate=wheel_rate)) if event[1] in READ)


def changed(topic: str, change: Callable[[Any], Any]) -> list[Event]:
    """Return the clean events with each sample of ``topic`` changed; None removes it."""
    return [(at, name, new) for at, name, sample in clean()
            if (new := change(sample) if name == topic else sample) is not None]


def recording(events: Iterable[Event], robot: RobotParams | None = None) -> CheckedRecording:
    """Return ``events`` as input of the checks."""
    samples = SampleArrays()
    for receive_ns, _, sample in events:
        samples.add_sample(sample, receive_ns)
    return CheckedRecording(robot or RobotParams(), samples)


def problems(events: Iterable[Event], robot: RobotParams | None = None) -> list[Finding]:
    """Return the warnings and errors of all checks."""
    return [one for one in findings(recording(events, robot)) if one.level >= Level.WARNING]


def texts(found: Iterable[Finding]) -> str:
    """Return level and text of the findings, one per line."""
    return '\n'.join(f'{one.level.name} {one.text}' for one in found)
