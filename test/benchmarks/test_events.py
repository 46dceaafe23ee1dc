# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulated events: cached on request for the same run and simulator; torques removed, scaled."""

from dataclasses import replace
from itertools import count
import math
import sys

from benchmarks import events
from benchmarks.scenarios import SCENARIOS
import pytest
from smart_tire.samples import ImuSample, WheelSample

IMU = ImuSample(1, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0))
WHEELS = WheelSample(2, (1.0,) * 4, (3.0,) * 4, (0.1, 0.2, -0.3, math.nan))
SILENT = WheelSample(3, (1.0,) * 4, (3.0,) * 4)


@pytest.fixture
def make():
    """Return a function that returns other events each time."""
    numbers = count()
    return lambda: [(next(numbers), 'imu/data', None)]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(events.FOLDER_VARIABLE, str(tmp_path / 'new'))
    return tmp_path / 'new'


def test_without_a_folder_events_are_made_every_time(make, monkeypatch):
    monkeypatch.delenv(events.FOLDER_VARIABLE, raising=False)
    assert events.cached_events('a', make) != events.cached_events('a', make)


def test_events_of_the_same_run_and_simulator_are_made_once(make, folder, monkeypatch):
    first, again = (events.cached_events('a', make) for _ in range(2))
    assert first == again != events.cached_events('b', make)
    assert sorted(path.suffix for path in folder.iterdir()) == ['.pickle'] * 2
    monkeypatch.setattr(events, 'source_digest', lambda: 'changed')
    assert events.cached_events('a', make) == [(2, 'imu/data', None)]


def test_cached_events_are_those_of_the_scenario_and_seed(folder):
    short = replace(SCENARIOS['late_wheels'], duration=3.2)
    made = {seed: short.events(seed) for seed in (1, 2)}
    assert repr(made[1]) != repr(made[2])
    assert repr({seed: short.events(seed) for seed in (1, 2)}) == repr(made)  # NaN included
    assert len(replace(short, duration=3.4).events(1)) > len(made[1])
    assert len(list(folder.iterdir())) == 3


def test_the_simulator_consists_of_plant_films_and_models_but_not_of_estimators():
    found = events.imported_modules('smart_tire.simulation.offline')
    assert {'smart_tire.simulation.plant', 'smart_tire.simulation.films',
            'smart_tire.models.tire.brush_tire', 'smart_tire.samples'} <= found.keys()
    assert not any('.estimation' in name or '.parameters' in name for name in found)
    without_cython = {'smart_tire.numerics.uncompiled'}
    assert found.keys() - without_cython < {
        name for name in sys.modules if name.startswith('smart_tire.')}


def test_ground_truth_and_inputs_are_apart():
    both = [(1, 'ground_truth/odom', 'truth'), (2, 'imu/data', 'input')]
    assert (events.truth_of(both), events.inputs_of(both)) == (['truth'], ['input'])


def test_efforts_are_removed_where_measured():
    assert events.has_efforts([IMU, SILENT, WHEELS])
    assert not events.has_efforts([IMU, SILENT, replace(SILENT, effort=(math.nan,) * 4)])
    assert events.without_efforts([IMU, WHEELS, SILENT]) == [
        IMU, WheelSample(2, WHEELS.velocity, WHEELS.position), SILENT]
