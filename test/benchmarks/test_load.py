# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The radio tap forwards every byte and identifies batches by their samples."""

import os
import select
import tty

from benchmarks.load import RadioTap
import pytest
from smart_tire.protocol.tire_payload import encode_batch, TireBatch, volts
from smart_tire.protocol.xbee import encode_frame, encode_receive_packet, ReceivePacket
from smart_tire.samples import TireSample
from smart_tire.simulation.pseudo_terminal import PtyPort
from support.waiting import PATIENCE


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
    """Return the port of a radio, the tap, and the open port of a receiver."""
    with PtyPort(str(tmp_path / 'radio')) as radio, RadioTap(
            radio.link, str(tmp_path / 'tapped')) as tap:
        descriptor = os.open(tmp_path / 'tapped', os.O_RDWR | os.O_NOCTTY)
        tty.setraw(descriptor)
        while not select.select([descriptor], [], [], 0.02)[0]:
            radio.write(b'?')  # lost until the tap has opened the port
        radio.write(b'!')
        while read(descriptor, 1) == b'?':
            pass
        yield radio, tap, descriptor
        os.close(descriptor)


def test_all_bytes_are_forwarded_and_each_complete_batch_has_a_latency(line):
    radio, tap, descriptor = line
    for number in range(3):
        whole = frame(number)
        for part in whole[:20], whole[20:]:
            for sample in samples(number):
                tap.add_sample(sample)  # of a batch that is not complete
            assert len(tap.latencies) == number
            radio.write(part)
            assert read(descriptor, len(part)) == part
        for sample in samples(number):
            tap.add_sample(sample)
    assert len(tap.latencies) == 3 and min(tap.latencies) > 0.0
