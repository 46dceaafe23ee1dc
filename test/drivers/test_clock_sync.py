# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Timestamps of messages whose delays have any distribution, with and without device time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from smart_tire.drivers.clock_sync import ArrivalTimestamps, ClockSync
from support.cases import long

HOST_NS = 1_700_000_000_000_000_000
DEVICE_NS = 4_000_000_000_000
BATCH, PERIOD_NS = 16, 2_500_000  # a sensor node: 25 batches per second
SEEDS = range(12)
some_seeds = pytest.mark.parametrize('seeds', [SEEDS[:3], *long(SEEDS)], ids=len)

JITTER = {  # s, above the constant delay
    'exponential': lambda rng: rng.exponential(3e-3),
    'uniform': lambda rng: rng.uniform(0.0, 8e-3),
    'two hops': lambda rng: rng.gamma(2.0, 1.5e-3),
    'half normal': lambda rng: abs(rng.normal(0.0, 4e-3)),
    'retries': lambda rng: rng.exponential(2e-3) + (rng.random() < 0.1) * rng.uniform(0.01, 0.04),
}


def batches(seed, jitter, seconds=10.0, drift=40e-6, loss=0.02, latency=0.0):
    """Yield the device times of a batch, the true host times, and its arrival."""
    rng = np.random.default_rng(seed)
    rate = 1.0 + drift * rng.uniform(-1.0, 1.0)
    for start in range(0, round(seconds * 1e9), BATCH * PERIOD_NS):
        if rng.random() >= loss:
            device = [DEVICE_NS + start + i * PERIOD_NS for i in range(BATCH)]
            host = [HOST_NS + round((time - DEVICE_NS) * rate) for time in device]
            yield device, host, host[-1] + round((latency + jitter(rng)) * 1e9)


def errors(clock, stream):
    """Return the times [s] since the start and the errors of the timestamps [s], per sample."""
    rows = []
    for device, host, arrival in stream:
        clock.add_arrival(device[-1], arrival)
        rows += [((time - DEVICE_NS) * 1e-9, (clock.host_ns(time) - true) * 1e-9)
                 for time, true in zip(device, host)]
    return np.array(rows).T


@pytest.mark.parametrize('name', JITTER)
@some_seeds
def test_after_one_second_timestamp_errors_are_below_half_a_millisecond(name, seeds):
    found = [errors(ClockSync(), batches(seed, JITTER[name])) for seed in seeds]
    late = np.concatenate([error[time > 1.0] for time, error in found])
    assert math.sqrt(np.mean(late**2)) < 0.5e-3
    settled = np.concatenate([error[time > 5.0] for time, error in found])
    assert math.sqrt(np.mean(settled**2)) < 0.3e-3


@pytest.mark.parametrize('name', JITTER)
@some_seeds
def test_timestamps_ascend_without_steps(name, seeds):
    for seed in seeds:
        clock, last = ClockSync(), None
        for device, _, arrival in batches(seed, JITTER[name]):
            clock.add_arrival(device[-1], arrival)
            for time in device:
                if last is not None:
                    elapsed, step = time - last[0], clock.host_ns(time) - last[1]
                    assert abs(step - elapsed) <= 0.11 * elapsed
                last = time, clock.host_ns(time)


def test_the_constant_delay_remains_in_the_timestamps():
    error = errors(ClockSync(), batches(1, JITTER['exponential'], latency=0.005))[1]
    assert np.median(error[-1000:]) == pytest.approx(0.005, abs=0.2e-3)


def test_without_jitter_the_timestamps_are_exact():
    time, error = errors(ClockSync(), batches(3, lambda rng: 0.0, loss=0.0))
    assert np.abs(error[time > 1.0]).max() < 20e-6


@pytest.mark.parametrize('drift', [-3e-3, 500e-6, 3e-3])
def test_a_drift_far_beyond_the_prior_is_estimated_within_seconds(drift):
    rate = 1.0 + drift
    clock, rng = ClockSync(), np.random.default_rng(5)
    for start in range(0, 15_000_000_000, 40_000_000):
        clock.add_arrival(DEVICE_NS + start,
                          HOST_NS + round(start * rate + rng.exponential(3e-3) * 1e9))
    assert clock.drift == pytest.approx(drift, abs=20e-6)
    assert clock.jitter == pytest.approx(3e-3, rel=0.2)


def test_a_drift_of_more_than_a_minute_ago_is_forgotten():
    clock = ClockSync()
    for second in range(150):
        clock.add_arrival(DEVICE_NS + second * 1_000_000_000,
                          HOST_NS + round((second + min(second, 70) * 100e-6) * 1e9))
    assert clock.drift == pytest.approx(0.0, abs=1e-7)


def test_the_fit_restarts_at_once_with_the_device():
    clock = ClockSync()
    for device, _, arrival in batches(2, JITTER['exponential'], seconds=2.0):
        clock.add_arrival(device[-1], arrival)
    assert not clock.is_consistent(0, arrival + 1_000_000_000)
    assert clock.add_arrival(0, arrival + 1_000_000_000) == arrival + 1_000_000_000


def test_timestamps_of_messages_that_arrive_at_once_advance_by_a_tenth_of_their_period():
    clock, period_ns = ClockSync(), 40_000_000
    stamps = [clock.add_arrival(index * period_ns, HOST_NS) for index in range(50)]
    steps = np.diff(stamps)
    assert steps.min() == period_ns // 10 and steps.max() < 1.1 * period_ns


def test_before_the_first_message_the_times_are_those_of_the_device():
    assert ClockSync().host_ns(7) == 7


@pytest.mark.parametrize('jump', [-30_000_000_000, -1_000_000_000, 30_000_000_000])
def test_the_fit_restarts_at_once_after_a_large_step_of_the_host_clock(jump):
    clock = ClockSync()
    for device, _, arrival in batches(2, JITTER['exponential'], seconds=2.0):
        clock.add_arrival(device[-1], arrival)
    arrival += jump + 40_000_000
    assert clock.add_arrival(device[-1] + 40_000_000, arrival) == arrival


def test_a_small_forward_step_of_the_host_clock_is_corrected_within_seconds():
    clock = ClockSync()
    for device, true, arrival in batches(2, JITTER['exponential'], seconds=20.0):
        late = 500_000_000 if true[0] - HOST_NS > 10_000_000_000 else 0
        clock.add_arrival(device[-1], arrival + late)
    assert clock.host_ns(device[-1]) - true[-1] == pytest.approx(500e6, abs=1e6)


def test_a_pause_of_the_reader_does_not_shift_the_timestamps():
    clock, worst = ClockSync(), 0.0
    for device, host, arrival in batches(4, JITTER['exponential'], seconds=20.0, loss=0.0):
        paused = 8_000_000_000 <= arrival - HOST_NS < 10_000_000_000
        clock.add_arrival(device[-1], HOST_NS + 10_000_000_000 if paused else arrival)
        if device[0] - DEVICE_NS > 2_000_000_000:
            worst = max(worst, abs(clock.host_ns(device[-1]) - host[-1]))
    assert worst < 0.5e6


def test_a_repeated_message_changes_nothing():
    clock = ClockSync()
    first = clock.add_arrival(DEVICE_NS, HOST_NS)
    assert clock.add_arrival(DEVICE_NS, HOST_NS + 5_000_000) == first


@some_seeds
def test_messages_queued_before_the_first_reading_do_not_leave_timestamps_in_the_future(seeds):
    """Half a second of messages is buffered while the reader starts, and arrives at once."""
    for seed in seeds:
        clock, rows = ClockSync(), []
        for device, host, arrival in batches(seed, JITTER['exponential'], seconds=3.0):
            arrival = max(arrival, HOST_NS + 500_000_000)
            clock.add_arrival(device[-1], arrival)
            rows.append((arrival - HOST_NS, clock.host_ns(device[-1]) - arrival,
                         clock.host_ns(device[-1]) - host[-1]))
        time, ahead, error = (np.array(column) * 1e-9 for column in zip(*rows))
        assert np.all(ahead < 0.11)
        assert np.all(ahead[time > 0.6] < 0.051)
        assert np.all(np.abs(error[time > 2.0]) < 3e-3)


ARRIVAL_JITTER = {
    'serial port': lambda rng: rng.exponential(1e-3),
    'busy host': lambda rng: rng.exponential(5e-3),
    'USB latency timer of 16 ms': lambda rng: rng.uniform(0.0, 16e-3),
}


def arrival_errors(seed, jitter, period, seconds=8.0, damaged=0.0, lost_at=()):
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
@pytest.mark.parametrize('name', ARRIVAL_JITTER)
@pytest.mark.parametrize('seeds', [range(1), *long(range(1, 5))], ids=len)
def test_timestamps_are_regular_after_two_to_four_seconds(name, period, damaged, seeds):
    for seed in seeds:
        time, error = arrival_errors(seed, ARRIVAL_JITTER[name], period, damaged=damaged)
        assert np.abs(error[time > 2.0]).max() < 4e-3
        assert np.abs(error[time > 4.0]).max() < 2e-3
        assert np.std(error[time > 4.0]) < 0.5e-3


def test_timestamps_ascend_from_the_first_message():
    for seed in range(5):
        time, error = arrival_errors(seed, ARRIVAL_JITTER['USB latency timer of 16 ms'], 0.01)
        assert np.all(np.diff(time + error) > 0.0)


def test_undetected_losses_are_inferred_from_late_messages():
    time, error = arrival_errors(1, ARRIVAL_JITTER['serial port'], 0.01, lost_at=(3.0, 3.01, 5.0))
    assert np.abs(error[(time > 3.5) & (time < 4.9)]).max() < 1e-3
    assert np.abs(error[time > 5.5]).max() < 1e-3
