# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Radio bytes to samples: sequences, timers, duplicates, resets, unknown nodes."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given, settings, strategies as st
import pytest
from smart_tire.drivers.tire_receiver import SensorNode, TireStream
from smart_tire.protocol.tire_payload import encode_batch, SATURATED, TireBatch
from smart_tire.protocol.xbee import encode_frame, encode_receive_packet, ReceivePacket
from smart_tire.samples import BatterySample, TireSamples

ADDRESS, OTHER_ADDRESS = 0x0013A20040A1B2C3, 0x0013A200DEADBEEF
HOST_NS = 1_700_000_000_000_000_000
BATCH = TireBatch(flags=0, sequence=100, timer_us=5_000_000, period_us=2500,
                  codes=((0, 512),) * 15 + ((1023, 511),), battery_mv=3700)
YOUNG = replace(BATCH, sequence=0, timer_us=1000)  # after a restart
SPAN_US = 40_000  # between batches of 16 samples


def batch(count, **changes):
    """Return the batch ``count`` batches after ``BATCH``, wrapped as in the payload."""
    changed = replace(BATCH, **changes)
    return replace(changed, sequence=(changed.sequence + count) % 65536,
                   timer_us=(changed.timer_us + count * SPAN_US) % 2**32)


def arrival(count):
    """Return when the batch ``count`` arrives over a radio with a delay of 5 ms."""
    return HOST_NS + count * SPAN_US * 1000 + 15 * 2_500_000 + 5_000_000


def packet(payload, source=ADDRESS):
    """Return the bytes that the coordinator sends for a payload."""
    return encode_frame(encode_receive_packet(ReceivePacket(source, 0xFFFE, 1, payload)))


def received(node, one, receive_ns):
    """Feed a batch and return its samples."""
    found = node.samples(one, receive_ns)
    return [] if found is None else found.samples


def feed(node, *batches):
    """Feed (count, batch) pairs and return all samples."""
    return [sample for count, one in batches for sample in received(node, one, arrival(count))]


def samples_of(stream, chunk, receive_ns):
    """Feed bytes and return the samples of the batches that they complete."""
    return [sample for item in stream.receive(chunk, receive_ns) if isinstance(item, TireSamples)
            for sample in item.samples]


@pytest.fixture
def node():
    return SensorNode('front_right', latency_ns=5_000_000)


def test_every_conversion_has_its_time_and_its_voltages(node):
    samples = feed(node, *((count, batch(count)) for count in range(50)))
    assert len(samples) == 50 * 16
    late = samples[-320:]
    assert [sample.stamp_ns for sample in late] == [
        pytest.approx(HOST_NS + index * 2_500_000, abs=20_000) for index in range(480, 800)]
    assert {sample.wheel for sample in samples} == {'front_right'}
    assert late[0].volts == pytest.approx((0.0, 512 * 3.3 / 1023))
    assert late[-1].volts == pytest.approx((3.3, 511 * 3.3 / 1023))  # saturated
    assert node.lost == node.duplicates == node.resets == 0


@st.composite
def orders(draw):
    """Return the numbers of batches in the order of arrival: some lost, repeated or late."""
    keys = [(count + shift, count) for count in range(30) for shift in draw(st.sampled_from(
        [(0.0,)] * 12 + [(), (0.0, 0.5), (1.5,), (3.5,), (0.0, 2.5), (1.5, 2.5)]))]
    return [count for _, count in sorted(keys)]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(orders(), st.sampled_from([100, 65536, 65536 - 10]), st.sampled_from([0, 9, 10, 40]))
def test_each_batch_is_delivered_once_with_the_times_of_its_conversions(order, sequence, timer):
    """Batches are lost, late and repeated while sequence and timer wrap."""
    node = SensorNode('front_right', latency_ns=5_000_000)
    newest, seen, late, repeated = -1, set(), 0, 0
    for count in order:
        late += count < newest and count not in seen
        repeated += count in seen
        newest = max(count, newest)
        one = batch(count, sequence=sequence % 65536, timer_us=2**32 - timer * SPAN_US)
        samples = received(node, replace(one, timer_us=one.timer_us % 2**32), arrival(newest))
        assert len(samples) == 16 * (count not in seen)
        seen.add(count)
        for index, sample in enumerate(samples):
            true_ns = HOST_NS + count * SPAN_US * 1000 + index * 2_500_000
            assert sample.stamp_ns == pytest.approx(true_ns, abs=50_000)
    lost = len(set(range(order[0], newest + 1)) - seen) if order else 0
    assert (node.batches, node.lost, node.late, node.duplicates, node.resets) == (
        len(seen), lost, late, repeated, 0)


@pytest.mark.parametrize('jump', [-90, 1000, 40_000])
def test_losses_at_a_sequence_jump_are_bounded_by_the_elapsed_time(node, jump):
    changes = {'sequence': BATCH.sequence + jump}
    samples = feed(node, *((count, batch(count)) for count in range(20)),
                   *((count, batch(count, **changes)) for count in range(23, 40)))
    assert node.resets == 0
    assert node.lost == 3
    stamps = [sample.stamp_ns for sample in samples]
    assert stamps == sorted(stamps)


@pytest.mark.parametrize(('first', 'restarted', 'count'), [
    pytest.param(BATCH, YOUNG, 60, id='sequence and timer start again'),
    pytest.param(BATCH, batch(40), 10_000, id='the timer advanced'),
    pytest.param(YOUNG, YOUNG, 40, id='in the first second of the timer')])
def test_a_restart_of_the_node_is_detected_and_counts_no_losses(node, first, restarted, count):
    feed(node, *((earlier, replace(first, sequence=first.sequence + earlier,
                                   timer_us=first.timer_us + earlier * SPAN_US))
                 for earlier in range(5, 30)))
    samples = feed(node, (count, restarted))
    assert node.resets == 1
    assert node.lost == 0
    assert samples[-1].stamp_ns == arrival(count) - 5_000_000


def test_a_restart_at_the_sequence_number_of_a_lost_batch_is_not_a_late_batch(node):
    feed(node, (0, batch(0)), (2, batch(2)), (3, batch(1, timer_us=YOUNG.timer_us)))
    assert (node.late, node.resets) == (0, 1)


def test_batches_that_arrive_faster_than_possible_are_counted(node):
    samples = [sample for count in (0, 1, 2, 30, 31, 40)
               for sample in received(node, batch(count), HOST_NS + count * 1_000_000)]
    assert len(samples) == 6 * 16
    assert node.lost == 27 + 8
    assert node.resets == 0


def test_saturated_batches_are_counted(node):
    found = [node.samples(one, arrival(count)) for count, one in enumerate(
        (replace(BATCH, flags=SATURATED), batch(1)))]
    assert node.saturated == 1
    assert [one.saturated for one in found] == [True, False]


def test_the_conversions_of_a_batch_have_equal_periods_of_the_host_clock(node):
    """The timer of the node is fast by 1000 ppm, so that its 2500 us are 2497.5 us."""
    found = [node.samples(replace(BATCH, sequence=count, timer_us=count * SPAN_US),
                          HOST_NS + round(count * SPAN_US * 999)) for count in range(600)][-1]
    assert found.period_ns == pytest.approx(2_497_500, abs=100)
    stamps = [sample.stamp_ns for sample in found.samples]
    assert stamps == [found.stamp_ns + index * found.period_ns for index in range(16)]


def test_the_battery_is_reported_once_a_second():
    stream = TireStream({ADDRESS: 'front_right'})
    reports = [sample for count in range(100)
               for sample in stream.receive(packet(encode_batch(batch(count))), arrival(count))
               if isinstance(sample, BatterySample)]
    assert [report.stamp_ns for report in reports] == [arrival(count) for count in
                                                       (0, 25, 50, 75)]
    assert {(report.wheel, report.volts) for report in reports} == {('front_right', 3.7)}


def test_each_sensor_node_has_its_own_wheel_sequence_and_clock():
    stream = TireStream({ADDRESS: 'front_right', OTHER_ADDRESS: 'rear_left'})
    wheels = [sample.wheel
              for source, count in (
                  (ADDRESS, 0), (OTHER_ADDRESS, 7), (ADDRESS, 1), (OTHER_ADDRESS, 9))
              for sample in samples_of(stream, packet(encode_batch(batch(count)), source),
                                       arrival(count))]
    assert wheels == ['front_right'] * 16 + ['rear_left'] * 16 + ['front_right'] * 16 + [
        'rear_left'] * 16
    assert [node.lost for node in stream.sensor_nodes.values()] == [0, 1]


def test_a_status_of_the_radio_module_is_no_bad_frame():
    stream = TireStream({ADDRESS: 'front_right'})
    chunk = encode_frame(b'\x8a\x06') + packet(encode_batch(batch(0)))
    assert len(samples_of(stream, chunk, arrival(1))) == 16
    assert (stream.frames_ok, stream.frames_bad, stream.bytes_skipped) == (1, 0, 0)


@pytest.mark.parametrize(('bad', 'error'), [
    (packet(encode_batch(BATCH), OTHER_ADDRESS), 'unknown sensor node 0013A200DEADBEEF'),
    (packet(b'\x02' + encode_batch(BATCH)[1:]), 'version 02'),
    (packet(encode_batch(BATCH)[:-1]), 'expected 78'),
    (encode_frame(b'\x92' + bytes(12)), 'XBee'),
])
def test_unexpected_packets_are_rejected_and_decoding_continues(bad, error):
    stream = TireStream({ADDRESS: 'front_right'})
    chunk = packet(encode_batch(batch(0))) + bad + packet(encode_batch(batch(1)))
    assert len(samples_of(stream, chunk, arrival(1))) == 2 * 16
    assert (stream.frames_ok, stream.frames_bad) == (2, 1)
    assert error in stream.last_error


def test_a_damaged_frame_is_counted_and_does_not_affect_others():
    stream = TireStream({ADDRESS: 'front_right'})
    good = [packet(encode_batch(batch(count))) for count in range(3)]
    damaged = good[1][:40] + bytes((good[1][40] ^ 1,)) + good[1][41:]
    assert len(samples_of(stream, good[0] + damaged + good[2], arrival(2))) == 2 * 16
    assert (stream.frames_ok, stream.frames_bad) == (2, 1)
    assert stream.sensor_nodes[ADDRESS].lost == 1
    assert stream.bytes_skipped == len(damaged)
