"""The tap on the radio passes every byte on and tells batches apart by their samples."""

import os
import select
import tty

import pytest

from benchmarks.latency_probe import RadioTap
from smart_tire.protocol.tire_payload import encode_batch, TireBatch, volts
from smart_tire.protocol.xbee import encode_frame, encode_receive_packet, ReceivePacket
from smart_tire.samples import TireSample
from smart_tire.simulation.pty import PtyPort

PATIENCE = 10.0  # s


def batch(number):
    codes = tuple((500 + 16 * number + i, 520 + i) for i in range(16))
    return TireBatch(0, number, 40_000 * number, 2500, codes, 3700)


def frame(number):
    packet = ReceivePacket(7, 0xFFFE, 1, encode_batch(batch(number)))
    return encode_frame(encode_receive_packet(packet))


def samples(number):
    return [TireSample(number, 'front_right', tuple(map(volts, codes)))
            for codes in batch(number).codes]


def read(descriptor, size):
    """Return ``size`` bytes."""
    data = b''
    while len(data) < size and select.select([descriptor], [], [], PATIENCE)[0]:
        data += os.read(descriptor, size - len(data))
    return data


@pytest.fixture
def line(tmp_path):
    """Return a radio's port, the tap on it, and what a receiver has open."""
    with PtyPort(str(tmp_path / 'radio')) as radio, RadioTap(
            radio.link, str(tmp_path / 'tapped')) as tap:
        descriptor = os.open(tmp_path / 'tapped', os.O_RDWR | os.O_NOCTTY)
        tty.setraw(descriptor)
        while not select.select([descriptor], [], [], 0.02)[0]:
            radio.write(b'?')  # is lost until the tap has the port open
        while select.select([descriptor], [], [], 0.2)[0]:
            os.read(descriptor, 100)
        yield radio, tap, descriptor
        os.close(descriptor)


def test_all_bytes_go_through_and_each_batch_has_its_latency(line):
    radio, tap, descriptor = line
    for number in range(3):
        radio.write(frame(number))
        assert read(descriptor, len(frame(number))) == frame(number)
        for sample in samples(number):
            tap.heard(sample)
    assert len(tap.latencies) == 3
    assert all(0.0 < latency < PATIENCE for latency in tap.latencies)


def test_a_batch_in_pieces_counts_from_its_last_byte(line):
    radio, tap, descriptor = line
    whole = frame(1)
    radio.write(whole[:20])
    assert read(descriptor, 20) == whole[:20]
    for sample in samples(1):
        tap.heard(sample)
    assert tap.latencies == []  # heard before it was complete: not from this batch
    radio.write(whole[20:])
    assert read(descriptor, len(whole) - 20) == whole[20:]
    for sample in samples(1):
        tap.heard(sample)
    assert len(tap.latencies) == 1


def test_samples_of_no_batch_that_went_through_are_passed_over(line):
    radio, tap, descriptor = line
    for sample in samples(5):
        tap.heard(sample)
    assert tap.latencies == []
