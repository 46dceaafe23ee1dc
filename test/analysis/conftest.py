# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A simulated drive for the tests of this folder, in memory and as a bag."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.events import cached_events
import pytest

from smart_tire.bags import BagWriter, channel_of
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.messages import TOPICS
from smart_tire.parameters import build, SimulatorParams
from smart_tire.simulation.offline import simulate

LEGS = [(0.0, 0.0, 0.0), (1.0, 120.0, 60.0), (7.0, 60.0, 120.0), (11.5, 0.0, 0.0)]  # s, rpm, rpm
DURATION = 12.0  # s


@pytest.fixture(scope='session')
def drive():
    """Return the events of a drive on concrete with two instrumented wheels."""
    params = build(SimulatorParams, {'film.wheels': ['front_left', 'front_right'], 'seed': 5})
    return cached_events(f'{params} {LEGS} {DURATION}', lambda: simulate(params, LEGS, DURATION))


@pytest.fixture(scope='session')
def drive_bag(drive, tmp_path_factory):
    """Return the bag of the drive."""
    return write_bag(tmp_path_factory.mktemp('recorded') / 'drive', drive)


@pytest.fixture(scope='session')
def bag_of():
    """Return the function that writes events to a bag, with renamed topics."""
    return write_bag


def write_bag(path, events, rename=lambda topic: topic):
    """Write ``events`` and return ``path``; ``rename`` gives the topics other names."""
    encoders = {}
    with BagWriter(path) as writer:
        for receive_ns, topic, sample in events:
            name = rename(topic)
            if name not in encoders:
                encoders[name] = Encoder(TOPICS[topic].type)
                writer.add_topic(replace(channel_of(topic, TOPICS[topic].type), topic=name))
            message = TOPICS[topic].to_msg(empty(TOPICS[topic].type), sample)
            writer.write(name, receive_ns, encoders[name](message))
    return path
