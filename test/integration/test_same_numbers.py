# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Equal estimates live, replayed at any rate and offline, also with late messages."""

from __future__ import annotations

from pathlib import Path

from benchmarks.faults import reordered, stalled
import numpy as np
import pytest
from smart_tire.analysis.pipeline import INPUTS
from smart_tire.bags import BagWriter
from smart_tire.parameters import build, SimulatorParams
from smart_tire.samples import Friction
from smart_tire.simulation.offline import simulate
from support.replaying import (
    assert_same, normalized_errors, offline_estimates, played_live, replayed)
from support.stack import parameter_file

pytestmark = pytest.mark.processes

ROOT = Path(__file__).resolve().parents[2]
WHEELS = ['front_left', 'front_right']
LATE_SHARE, MAX_DELAY = 0.05, 0.2  # of the messages; s
QUANTILE, MAX_ERROR = 0.98, 0.7    # standard deviations, of the differences
STALLS = ((2.0, 2.15), (3.0, 3.1), (4.0, 4.5), (5.2, 5.25))  # s, stalls of the recorder


@pytest.fixture(scope='module')
def events():
    """Return the received inputs of a simulated turn."""
    params = build(SimulatorParams, {
        'seed': 5, 'film.wheels': WHEELS, 'ground.base': 'concrete', 'radio.loss': 0.02})
    return [event for event in simulate(params, [(1.5, 120.0, 60.0)], 7.0) if event[1] in INPUTS]


@pytest.fixture(scope='module')
def params(tmp_path_factory):
    """Return the parameter file of the robot."""
    return parameter_file(tmp_path_factory.mktemp('params') / 'robot.yaml',
                          {'/**': {'film.wheels': WHEELS}})


def recorded(folder, events):
    """Return the bag of ``events``."""
    with BagWriter(folder / 'bag') as writer:
        for receive_ns, topic, sample in events:
            writer.write_sample(topic, receive_ns, sample)
    return folder / 'bag'


@pytest.fixture(scope='module')
def recording(events, params, tmp_path_factory):
    """Return a bag and its estimates offline."""
    bag_path = recorded(tmp_path_factory.mktemp('recording'), events)
    return bag_path, offline_estimates(bag_path, params)


@pytest.fixture(scope='module')
def overloaded(events, params, tmp_path_factory):
    """Return a bag with many late messages, and its estimates offline."""
    disordered = reordered(events, INPUTS, duplicate_share=0.02, late_share=LATE_SHARE,
                           max_delay=MAX_DELAY, seed=3)
    mixed = stalled(disordered, STALLS)
    bag_path = recorded(tmp_path_factory.mktemp('overloaded'), mixed)
    return bag_path, offline_estimates(bag_path, params)


def test_a_replay_yields_the_estimates_of_the_offline_analysis(recording, params, tmp_path):
    bag_path, offline = recording
    found, late = replayed(bag_path, params, tmp_path, 20.0, offline, composed=True)
    assert sum(isinstance(estimate, Friction) for estimate in offline.values()) >= 10
    assert_same(found, offline)
    assert not late


@pytest.mark.parametrize('rate', [3.0, 50.0])
def test_replays_with_late_messages_yield_the_estimates_of_the_offline_analysis(
        overloaded, recording, params, tmp_path, rate):
    bag_path, offline = overloaded
    found, late = replayed(bag_path, params, tmp_path, rate, offline)
    assert_same(found, offline)
    assert late['slip_estimator'] > 20
    assert late['friction_estimator'] > 200
    frictions, in_time = (
        [estimate.friction_coefficient.value for estimate in estimates.values()
         if isinstance(estimate, Friction)] for estimates in (found, recording[1]))
    assert frictions != pytest.approx(in_time, abs=1e-3)  # late messages do change the estimates


def test_the_size_of_these_differences_is_that_of_the_document():
    text = ' '.join((ROOT / 'docs/theory.md').read_text(encoding='utf-8').split())
    assert (f'With {100 * LATE_SHARE:.0f} % of them up to {MAX_DELAY} s late and stalls of up to '
            f'{max(end - begin for begin, end in STALLS):.1f} s, {100 * QUANTILE:.0f} % of the '
            f'differences between live and offline are below {MAX_ERROR} standard') in text


def test_live_estimates_with_late_messages_are_consistent_with_the_offline_analysis(
        overloaded, params, tmp_path):
    bag_path, offline = overloaded
    found = played_live(bag_path, params, tmp_path)
    errors = normalized_errors(found, offline)
    assert min(map(len, errors.values())) >= 10
    for topic, values in errors.items():
        # a stall of 0.5 s drops other samples live: during it the estimates differ by their errors
        assert np.quantile(values, QUANTILE) < MAX_ERROR, (topic, np.quantile(values, QUANTILE))
        assert max(values) < 2.0, (topic, max(values))
