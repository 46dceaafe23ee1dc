# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pacing of samples: spacing, order, delay, and no backlog."""

from __future__ import annotations

from dataclasses import replace
import itertools
import threading

import pytest

from smart_tire.drivers import pacing
from smart_tire.drivers.pacing import (
    MAX_BURST_SAMPLES, MAX_PENDING_SAMPLES, MIN_BURST_SAMPLES, PacedSender, PacingQueue,
    SAMPLE_SPACING_NS, WAKE_PERIOD_NS)
from smart_tire.samples import NS_PER_S, TireSample, WHEELS
from support.waiting import PATIENCE

PERIOD_NS = 2_500_000           # of the conversions, 400 Hz
BATCH_NS = 16 * PERIOD_NS       # from a batch to the next one
RADIO_NS = 5_000_000            # from the last conversion to the arrival
DEPTH = 10                      # default history depth of a subscriber


def batch(number, wheel='front_left', start_ns=0):
    """Return a batch of 16 samples, which arrives at ``arrival(number, start_ns)``."""
    return [TireSample(start_ns + number * BATCH_NS + index * PERIOD_NS, wheel, (1.65, 1.65))
            for index in range(16)]


def arrival(number, start_ns=0):
    """Return when the batch ``number`` arrives."""
    return start_ns + number * BATCH_NS + 15 * PERIOD_NS + RADIO_NS


def drain(queue, until_ns, late_ns=0):
    """Take samples up to ``until_ns``, each ``late_ns`` after its time; return (time, samples)."""
    taken = []
    while (due_ns := queue.due_ns()) is not None and due_ns + late_ns <= until_ns:
        taken.append((due_ns + late_ns, queue.take(due_ns + late_ns)))
    return taken


def run(batches, wheels, late_ns=0):
    """Put (arrival, batch) pairs into a queue and return the sent samples with their times."""
    queue, taken = PacingQueue(wheels), []
    for now_ns, one in sorted(batches, key=lambda item: item[0]):
        taken += drain(queue, now_ns, late_ns)
        queue.put(one, now_ns)
    taken += drain(queue, 1 << 62, late_ns)
    assert queue.overruns == 0
    return taken


def flat(taken):
    """Return (time, sample) of each sample."""
    return [(now_ns, sample) for now_ns, samples in taken for sample in samples]


@pytest.mark.parametrize('count', [2, 3])
def test_the_samples_of_a_batch_are_spread_over_their_period(count):
    queue, period_ns = PacingQueue(wheels=1), SAMPLE_SPACING_NS
    queue.put([TireSample(index * period_ns, 'front_left', (1.65,)) for index in range(count)], 0)
    first, second, *_ = (slot[0] for slot in sorted(queue._slots))
    assert second - first == int(pacing.MAX_SPACING_SHARE * period_ns)


def together(number):
    """Return a batch of each of four wheels, with the same time of arrival."""
    return [(arrival(number), batch(number, wheel)) for wheel in WHEELS]


def staggered(number):
    """Return a batch of each of four wheels, arriving at intervals of 10 ms."""
    return [(arrival(number, index * 10_000_000), batch(number, wheel, index * 10_000_000))
            for index, wheel in enumerate(WHEELS)]


def test_the_first_sample_is_sent_at_once_and_the_others_a_millisecond_apart():
    sent = flat(run([(arrival(0), batch(0))], 1))
    assert [sample for _, sample in sent] == batch(0)
    assert sent[0][0] == arrival(0)
    assert sent[-1][0] - sent[0][0] == pytest.approx(15 * SAMPLE_SPACING_NS, abs=WAKE_PERIOD_NS)


@pytest.mark.parametrize(('arriving', 'wheels'), [
    (lambda number: [(arrival(number), batch(number))], 1),
    (lambda number: staggered(number)[::2], 2), (together, 4), (staggered, 4)])
@pytest.mark.parametrize('late_ns', [0, 300_000, 1_000_000])
def test_samples_are_spread_over_time_in_order_and_without_a_backlog(arriving, wheels, late_ns):
    batches = [item for number in range(50) for item in arriving(number)]
    sent = flat(run(batches, wheels, late_ns))
    # Ten samples are never sent faster than the sample rate requires: four wheels send 1600/s, 10
    # samples in 6.25 ms on average.
    least_ns = 2 * WAKE_PERIOD_NS if wheels == 4 else 4 * WAKE_PERIOD_NS
    times = [now_ns for now_ns, _ in sent]
    assert min(last - first for first, last in zip(times, times[DEPTH:])) >= least_ns
    for wheel in {one[0].wheel for _, one in batches}:
        stamps = [sample.stamp_ns for _, sample in sent if sample.wheel == wheel]
        assert stamps == sorted(stamps) and len(stamps) == 50 * 16
    if late_ns < 1_000_000:  # sent before the next batch of its wheel arrives
        sent_ns = {(sample.wheel, sample.stamp_ns): now_ns for now_ns, sample in sent}
        for now_ns, one in batches:
            assert sent_ns[one[0].wheel, one[-1].stamp_ns] < now_ns + BATCH_NS
    if late_ns == 0:  # never older than the first sample of a batch
        oldest_ns = 15 * PERIOD_NS + RADIO_NS
        assert max(now_ns - sample.stamp_ns for now_ns, sample in sent) <= (
            oldest_ns + WAKE_PERIOD_NS)
    if arriving is together:
        for start in range(0, 64, 4):
            assert {sample.wheel for _, sample in sent[start:start + 4]} == set(WHEELS)


@pytest.mark.parametrize('factor', [1, 2, 3, 4, 8])
def test_four_wheels_at_higher_rates_have_no_backlog_either(factor):
    def faster(sample):
        return replace(sample, stamp_ns=sample.stamp_ns // factor)
    batches = [(now_ns // factor, [faster(sample) for sample in one])
               for number in range(50) for now_ns, one in staggered(number)]
    taken = run(batches, 4)  # without overruns
    assert max(len(samples) for _, samples in taken) <= MAX_BURST_SAMPLES < DEPTH
    age = max(now_ns - sample.stamp_ns for now_ns, sample in flat(taken))
    assert age <= (15 * PERIOD_NS + RADIO_NS) // factor + WAKE_PERIOD_NS


@pytest.mark.parametrize('period_ns', [0, 1, -PERIOD_NS])
def test_impossible_periods_keep_no_core_busy(period_ns):
    queue = PacingQueue(4)
    queue.put([TireSample(index * period_ns, 'front_left', (1.65,)) for index in range(16)], 0)
    taken = drain(queue, NS_PER_S)
    assert sum(len(samples) for _, samples in taken) == 16
    assert len(taken) <= 16


def test_a_batch_that_arrives_after_the_next_one_is_sent_after_it():
    sent = [sample for _, sample in flat(run(
        [(arrival(1), batch(1)), (arrival(1) + 1, batch(0))], 1))]
    assert sent == batch(1) + batch(0)


def test_a_late_wake_up_does_not_cause_a_burst():
    taken = run([(arrival(0), batch(0))], 1, late_ns=20_000_000)
    assert max(len(samples) for _, samples in taken) <= MIN_BURST_SAMPLES


def test_batches_that_arrive_together_are_sent_faster():
    queue = PacingQueue(1)
    for number in range(5):  # after a stall of the host
        queue.put(batch(number), arrival(4))
    taken = drain(queue, arrival(4) + BATCH_NS + WAKE_PERIOD_NS)
    assert [sample for _, sample in flat(taken)] == [
        sample for number in range(5) for sample in batch(number)]
    assert queue.overruns == 0


def test_too_many_pending_samples_are_sent_at_once():
    queue, count = PacingQueue(1), MAX_PENDING_SAMPLES // 16 + 1
    for number in range(count):
        queue.put(batch(number), arrival(0))
    assert queue.overruns == 1
    assert queue.take(arrival(0)) == [
        sample for number in range(count) for sample in batch(number)]
    assert queue.due_ns() is None


@pytest.mark.parametrize('stamps', [[7], [7, 7, 7], [9, 8, 7]])
def test_samples_without_a_valid_period_are_sent(stamps):
    samples = [TireSample(stamp, 'front_left', (1.65,)) for stamp in stamps]
    assert [sample for _, sample in flat(run([(100, samples)], 1))] == samples


@pytest.fixture
def new_sender(monkeypatch):
    """Return a function that makes a sender, on whose clock 10 ms pass from look to look."""
    monkeypatch.setattr(pacing, 'CLOSE_TIMEOUT', PATIENCE)
    return lambda send: PacedSender(send, 1, itertools.count(0, 10_000_000).__next__)


def test_stop_sends_pending_samples(new_sender):
    sent = []
    sender = new_sender(sent.append)
    sender.start()
    sender.put(batch(0))
    sender.put(batch(1))
    sender.stop()
    assert sent == batch(0) + batch(1)


def test_the_thread_sleeps_until_samples_are_due():
    now, waits = [1_000], []

    class Condition:

        def __enter__(self):
            pass

        __exit__ = notify = lambda self, *_: None

        def wait(self, seconds=None):
            waits.append(seconds)
            assert len(waits) < 100
            if seconds is None:
                sender._stopping = True
            else:
                now[0] += round(seconds * 1e9)

    sender = PacedSender(print, 1, lambda: now[0])
    sender._changed = Condition()
    sender.put(batch(0))
    sent = []
    while (samples := sender._next()) is not None:
        sent += samples
    assert sent == batch(0)
    assert waits[:-1] == pytest.approx([WAKE_PERIOD_NS * 1e-9] * (len(waits) - 1))
    assert waits[-1] is None and len(waits) > 4


def test_a_sender_that_never_started_can_be_stopped(new_sender):
    new_sender(lambda sample: None).stop()


def test_queuing_a_batch_does_not_wait_for_the_publisher(new_sender):
    release, entered = threading.Event(), threading.Event()

    def send(sample):
        entered.set()
        assert release.wait(PATIENCE)

    sender = new_sender(send)
    sender.start()
    sender.put(batch(0))
    assert entered.wait(PATIENCE)
    sender.put(batch(1))  # if it blocked, ``send`` would wait in vain and fail
    release.set()
    sender.stop()


def test_an_overrun_does_not_end_the_sender(new_sender):
    sent, batches = [], [batch(number) for number in range(2 * MAX_PENDING_SAMPLES // 16 + 1)]
    sender = new_sender(sent.append)
    for one in batches[:-1]:
        sender.put(one)
    sender.start()
    sender.put(batches[-1])
    sender.stop()
    assert sent == [sample for one in batches for sample in one]
    assert sender.overruns > 0
