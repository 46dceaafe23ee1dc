# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Regular timestamps of a stream without device time, from its arrivals."""

from __future__ import annotations

import numpy as np
import pytest
from smart_tire.drivers.clock_sync import ArrivalTimestamps

HOST_NS = 1_700_000_000_000_000_000
JITTER = {
    'serial port': lambda rng: rng.exponential(1e-3),
    'busy host': lambda rng: rng.exponential(5e-3),
    'USB latency timer of 16 ms': lambda rng: rng.uniform(0.0, 16e-3),
}


def errors(seed, jitter, period, seconds=8.0, damaged=0.0, lost_at=()):
    """Return the times [s] and the errors [s] of the timestamps."""
    rng = np.random.default_rng(seed)
    period *= 1.0 + rng.uniform(-1e-3, 1e-3)
    clock, missed, arrival, rows = ArrivalTimestamps(), 0, 0.0, []
    for count in range(round(seconds / period)):
        time = count * period
        if any(abs(time - at) < period / 2.0 for at in lost_at):
            continue
        if rng.random() < damaged:
            missed += 1
            continue
        arrival = max(arrival, time + jitter(rng))
        stamp = clock.timestamp(HOST_NS + round(arrival * 1e9), missed)
        missed = 0
        rows.append((time, (stamp - HOST_NS) * 1e-9 - time))
    return np.array(rows).T


@pytest.mark.parametrize('damaged', [0.0, 0.02])
@pytest.mark.parametrize('period', [0.01, 0.025])
@pytest.mark.parametrize('name', JITTER)
def test_timestamps_are_regular_after_two_to_four_seconds(name, period, damaged):
    for seed in range(5):
        time, error = errors(seed, JITTER[name], period, damaged=damaged)
        assert np.abs(error[time > 2.0]).max() < 4e-3
        assert np.abs(error[time > 4.0]).max() < 2e-3
        assert np.std(error[time > 4.0]) < 0.5e-3


def test_timestamps_ascend_from_the_first_message():
    for seed in range(5):
        time, error = errors(seed, JITTER['USB latency timer of 16 ms'], 0.01)
        assert np.all(np.diff(time + error) > 0.0)


def test_undetected_losses_are_inferred_from_late_messages():
    time, error = errors(1, JITTER['serial port'], 0.01, lost_at=(3.0, 3.01, 5.0))
    assert np.abs(error[(time > 3.5) & (time < 4.9)]).max() < 1e-3
    assert np.abs(error[time > 5.5]).max() < 1e-3
