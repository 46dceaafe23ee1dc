# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Device emulators: their bytes and times agree with the protocols of the hardware."""

import itertools

import numpy as np
import pytest
from smart_tire.protocol import roboclaw, tire_payload, vectornav, vectornav_ascii, xbee, xsens
from smart_tire.samples import ImuSample, NS_PER_S
from smart_tire.simulation import device_emulators
from smart_tire.simulation.device_emulators import (
    DriftingClock, ImuEmulator, RadioEmulator, RoboclawEmulator, SensorNodeEmulator)

MS = 1_000_000  # ns
CODES = tuple((500 + k, 510 - k) for k in range(16))
LEFT, RIGHT = 0x0013A20040A1B2C2, 0x0013A20040A1B2C3


# Clocks and sensor nodes

@pytest.mark.parametrize('error', [0.0, 50e-6, -300e-6])
def test_a_drifting_clock_is_fast_by_its_error_and_invertible(error):
    clock = DriftingClock(error, start_ns=12345)
    assert clock.read(0) == 12345
    assert clock.read(100 * NS_PER_S) - 12345 == 100 * NS_PER_S + round(100 * NS_PER_S * error)
    for true_ns in (0, 7, 999_999_999, 3600 * NS_PER_S + 1):
        assert abs(clock.true_ns(clock.read(true_ns)) - true_ns) <= 1


def test_the_timer_of_a_batch_agrees_with_the_true_times_of_its_conversions():
    node = SensorNodeEmulator(LEFT, clock_error=40e-6, first_us=1234)
    for first in (0, 16, 160_000):
        batch = node.batch(first, CODES)
        timer = (batch.timer_us - device_emulators.START_TIMER_US) % tire_payload.TIMER_WRAP_US
        for k in range(16):
            device_ns = 1000 * (timer + k * batch.period_us)
            assert node.instant_ns(first + k) == pytest.approx(device_ns / (1.0 + 40e-6), abs=2.0)


def test_sequence_and_timer_wrap_within_the_duration_of_the_demo():
    node = SensorNodeEmulator(LEFT)
    batches = [tire_payload.decode_batch(tire_payload.encode_batch(node.batch(16 * n, CODES)))
               for n in range(1000)]  # 40 s
    for one, following in itertools.pairwise(batches):
        assert (following.sequence - one.sequence) % tire_payload.SEQUENCE_WRAP == 1
        assert (following.timer_us - one.timer_us) % tire_payload.TIMER_WRAP_US == 16 * 2500
    assert batches[-1].sequence < batches[0].sequence
    assert batches[-1].timer_us < batches[0].timer_us


@pytest.mark.parametrize('code, flags', [(0, 1), (1, 0), (1022, 0), (1023, 1)])
def test_a_saturated_batch_is_flagged(code, flags):
    assert SensorNodeEmulator(LEFT).batch(0, [(512, 512), (512, code)]).flags == flags


# Radio

def drive(radio, batches, wheels=('front_left',), period_ns=40 * MS):
    """Send ``batches`` per wheel; return times sent and (arrival, address, batch) received."""
    arrived, deframer = [], xbee.XBeeDeframer()
    sent = {}
    for now in range(0, batches * period_ns + 100 * MS, MS):
        n, rest = divmod(now, period_ns)
        if rest == 0 and n < batches:
            for wheel in wheels:
                sent[wheel, radio.send(wheel, 16 * n, CODES, now)] = now
        for body in deframer.extract(radio.due(now)):
            packet = xbee.decode_receive_packet(body)
            arrived.append((now, packet.source, tire_payload.decode_batch(packet.data)))
    assert deframer.bad_frames == deframer.skipped_bytes == 0
    return sent, arrived


def test_without_loss_every_batch_arrives_once_in_order_and_within_the_maximum_delay():
    nodes = {'front_left': SensorNodeEmulator(LEFT), 'front_right': SensorNodeEmulator(RIGHT)}
    radio = RadioEmulator(nodes, np.random.default_rng(1), delay=0.005, jitter=0.003,
                          max_delay=0.020)
    sent, arrived = drive(radio, 300, tuple(nodes))
    assert radio.dropped == {'front_left': 0, 'front_right': 0}
    for wheel, node in nodes.items():
        own = [(now, batch) for now, source, batch in arrived if source == node.address]
        assert [batch.sequence for _, batch in own] == [
            sequence for sender, sequence in sent if sender == wheel]
        delays = [now - sent[wheel, batch.sequence] for now, batch in own]
        assert min(delays) >= 5 * MS
        assert max(delays) <= 20 * MS
        assert np.std(delays) > 1.5 * MS
        assert all(batch.codes == CODES and batch.battery_mv == 3900 for _, batch in own)


def test_packets_of_a_node_arrive_in_order_even_if_sent_at_once():
    radio = RadioEmulator({'front_left': SensorNodeEmulator(LEFT)}, np.random.default_rng(2))
    expected = [radio.send('front_left', 16 * n, CODES, 0) for n in range(50)]
    bodies = xbee.XBeeDeframer().extract(radio.due(NS_PER_S))
    found = [tire_payload.decode_batch(xbee.decode_receive_packet(body).data).sequence
             for body in bodies]
    assert found == expected


def test_lost_batches_are_gaps_in_the_sequence_and_counted():
    nodes = {'front_left': SensorNodeEmulator(LEFT)}
    radio = RadioEmulator(nodes, np.random.default_rng(3), loss=0.1)
    sent, arrived = drive(radio, 1000)
    dropped = radio.dropped['front_left']
    assert len(arrived) == 1000 - dropped
    assert 70 < dropped < 130  # +-3 standard deviations
    missing = {sequence for _, sequence in sent} - {batch.sequence for *_, batch in arrived}
    assert len(missing) == dropped
    assert radio.sensor_nodes['front_left'].batches == 1000


def test_a_packet_arrives_once_and_not_before_its_time():
    nodes = {'front_left': SensorNodeEmulator(LEFT)}
    radio = RadioEmulator(nodes, np.random.default_rng(4), jitter=0.0)
    radio.send('front_left', 0, CODES, 40 * MS)
    assert radio.next_ns() == 45 * MS
    assert radio.due(45 * MS - 1) == b''
    assert len(radio.due(45 * MS)) >= 94
    assert radio.due(10 * NS_PER_S) == b''
    assert radio.next_ns() is None


# IMU

SAMPLE = ImuSample(2 * NS_PER_S, (0.5, -0.25, 9.75), (0.125, 0.25, -0.5))
DECODE = {'vectornav_binary': (vectornav.BinaryDeframer, vectornav.decode_binary),
          'vectornav_ascii': (vectornav_ascii.AsciiDeframer, vectornav_ascii.decode_ymr),
          'xsens': (xsens.XsensDeframer, xsens.decode_imu)}


@pytest.mark.parametrize('protocol', DECODE)
def test_every_protocol_encodes_the_same_sample(protocol):
    deframer, decode = DECODE[protocol]
    (body,) = deframer().extract(ImuEmulator(protocol).frame(SAMPLE))
    _, decoded = decode(body, SAMPLE.stamp_ns)
    assert decoded.acceleration == SAMPLE.acceleration
    assert decoded.rate == SAMPLE.rate


@pytest.mark.parametrize('protocol, resolution', [('vectornav_binary', 1), ('xsens', 100_000)])
def test_the_device_time_drifts_by_the_clock_error(protocol, resolution):
    deframer, decode = DECODE[protocol]
    device, times = ImuEmulator(protocol, clock_error=100e-6), []
    for seconds in (0, 10, 60):
        sample = ImuSample(seconds * NS_PER_S, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0))
        times += [decode(body)[0] for body in deframer().extract(device.frame(sample))]
    wrap = xsens.SAMPLE_TIME_WRAP_NS if protocol == 'xsens' else 1 << 64
    assert (times[1] - times[0]) % wrap == pytest.approx(10_001_000_000, abs=resolution)
    assert (times[2] - times[0]) % wrap == pytest.approx(60_006_000_000, abs=resolution)
    assert (times[2] < times[0]) == (protocol == 'xsens')


def test_xsens_messages_are_numbered():
    device = ImuEmulator('xsens')
    stream = b''.join(device.frame(SAMPLE) for _ in range(3))
    bodies = xsens.XsensDeframer().extract(stream)
    assert list(map(xsens.packet_counter, bodies)) == [0, 1, 2]


# Motor boards

COUNTS = (100, -1, 3000, 2**33 + 5)
CURRENTS = (0.5, -0.01, 12.345, 400.0)
SPEEDS = (10.2, -20.9, 0.0, 4000.0)


def ask(boards, address, command, *values, now_ns=0):
    """Return the values of the reply to one request."""
    request = roboclaw.encode_request(address, command, *values)
    return roboclaw.decode_reply(
        address, command, boards.replies(request, now_ns, COUNTS, CURRENTS, SPEEDS))


def test_each_board_reports_counts_speeds_and_currents_of_its_own_wheels():
    boards = RoboclawEmulator((128, 129))
    assert ask(boards, 128, roboclaw.READ_ENCODERS) == (100, 2**32 - 1)
    assert ask(boards, 129, roboclaw.READ_ENCODERS) == (3000, 5)
    assert ask(boards, 128, roboclaw.READ_SPEEDS) == (10, -21)
    assert ask(boards, 129, roboclaw.READ_SPEEDS) == (0, 4000)
    assert ask(boards, 128, roboclaw.READ_CURRENTS) == (50, -1)
    assert ask(boards, 129, roboclaw.READ_CURRENTS) == (1234, 32767)


def test_both_boards_reply_in_the_order_of_the_requests():
    boards = RoboclawEmulator()
    stream = (roboclaw.encode_request(129, roboclaw.READ_BATTERY)
              + roboclaw.encode_request(128, roboclaw.READ_STATUS))
    assert boards.replies(stream, 0, COUNTS) == (
        roboclaw.encode_reply(129, roboclaw.READ_BATTERY, 148)
        + roboclaw.encode_reply(128, roboclaw.READ_STATUS, 0))


def test_duties_reach_the_motors_of_the_board():
    boards = RoboclawEmulator()
    assert boards.duty(0) == (0.0, 0.0, 0.0, 0.0)
    ask(boards, 128, roboclaw.SET_DUTY, 32767, -32768)
    ask(boards, 129, roboclaw.SET_DUTY, 16384, 0)
    assert boards.duty(0) == pytest.approx((1.0, -1.0, 0.5, 0.0), abs=2e-5)


def test_a_board_without_requests_stops_its_motors_until_the_next_duty():
    boards = RoboclawEmulator()
    for address in (128, 129):
        ask(boards, address, roboclaw.SET_TIMEOUT, roboclaw.timeout_code(0.3))
        ask(boards, address, roboclaw.SET_DUTY, 1000, 2000)
    assert ask(boards, 128, roboclaw.READ_TIMEOUT) == (3,)
    ask(boards, 128, roboclaw.READ_ENCODERS, now_ns=200 * MS)  # a request to board 1
    assert boards.duty(300 * MS)[2:] == pytest.approx((1000 / 32767, 2000 / 32767))
    assert boards.duty(301 * MS) == pytest.approx((1000 / 32767, 2000 / 32767, 0.0, 0.0))
    assert boards.duty(501 * MS) == (0.0, 0.0, 0.0, 0.0)
    ask(boards, 128, roboclaw.READ_ENCODERS, now_ns=502 * MS)
    assert boards.duty(502 * MS) == (0.0, 0.0, 0.0, 0.0)
    ask(boards, 128, roboclaw.SET_DUTY, 3000, 4000, now_ns=503 * MS)
    assert boards.duty(503 * MS) == pytest.approx((3000 / 32767, 4000 / 32767, 0.0, 0.0))


def test_motors_are_stopped_by_a_time_out_before_the_next_request():
    boards = RoboclawEmulator()
    ask(boards, 128, roboclaw.SET_TIMEOUT, 1)
    ask(boards, 128, roboclaw.SET_DUTY, 1000, 1000)
    ask(boards, 128, roboclaw.READ_ENCODERS, now_ns=NS_PER_S)
    assert boards.duty(NS_PER_S) == (0.0, 0.0, 0.0, 0.0)


def test_without_a_time_out_a_duty_lasts():
    boards = RoboclawEmulator()
    ask(boards, 128, roboclaw.SET_DUTY, 1000, 1000)
    assert boards.duty(3600 * NS_PER_S)[0] == pytest.approx(1000 / 32767)


def test_a_request_with_a_wrong_crc_is_ignored():
    boards = RoboclawEmulator()
    request = bytearray(roboclaw.encode_request(128, roboclaw.SET_DUTY, 1000, 1000))
    request[-1] ^= 1
    assert boards.replies(bytes(request), 0, COUNTS) == b''
    assert boards.duty(0) == (0.0, 0.0, 0.0, 0.0)
    assert boards.bad_frames == 1


def test_a_request_to_an_unknown_address_gets_no_reply():
    request = roboclaw.encode_request(130, roboclaw.READ_ENCODERS)
    assert RoboclawEmulator().replies(request, 0, COUNTS) == b''


def test_a_packet_may_arrive_in_parts_but_not_with_a_pause():
    boards = RoboclawEmulator()
    request = roboclaw.encode_request(128, roboclaw.SET_DUTY, 1000, 1000)
    assert boards.replies(request[:3], 0, COUNTS) == b''
    assert boards.replies(b'', 9 * MS, COUNTS) == b''
    assert boards.replies(request[3:], 10 * MS, COUNTS) == b'\xff'
    assert boards.replies(request[:3], 50 * MS, COUNTS) == b''
    assert boards.replies(request[3:], 61 * MS, COUNTS) == b''
    assert boards.replies(request, 80 * MS, COUNTS) == b'\xff'
