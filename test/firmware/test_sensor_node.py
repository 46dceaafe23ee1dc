# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The firmware of the sensor node on simulated peripherals, read by the decoders of the host."""

from itertools import count
from pathlib import Path
import random
import runpy
import struct
import sys
from types import ModuleType, SimpleNamespace

import pytest

from smart_tire.protocol.tire_payload import decode_batch
from smart_tire.protocol.xbee import (
    decode_receive_packet, encode_receive_packet, ReceivePacket, XBeeDeframer)

FOLDER = Path(__file__).resolve().parents[2] / 'firmware' / 'sensor_node'
TICKS_WRAP = 1 << 30  # us, of MicroPython on the RP2040
PERIOD_US = 2500
BATCH, CHANNELS = 16, 2

PACKET = SimpleNamespace(**runpy.run_path(str(FOLDER / 'packet.py')))


def received(frame: bytes) -> ReceivePacket:
    """Return what the coordinator receives of a transmit request, by its own frame."""
    (body,) = XBeeDeframer().extract(bytes(frame))
    kind, identifier, address, network, radius, options = struct.unpack_from('>BBQHBB', body)
    assert (kind, identifier, network, radius, options) == (0x10, 0, 0xFFFE, 0, 0x01)
    packet = ReceivePacket(address, 0xFFFE, 1, body[14:])
    assert decode_receive_packet(encode_receive_packet(packet)) == packet
    return packet


@pytest.mark.parametrize('seed', range(20))
def test_the_host_reads_any_payload(seed):
    rng = random.Random(seed)
    channels, samples = rng.choice((1, 2)), rng.randint(1, 17)
    codes = [rng.randint(1, 1022) for _ in range(channels * samples)]
    sequence, timer, battery = rng.getrandbits(16), rng.getrandbits(32), rng.randint(0, 4200)
    data = PACKET.payload(sequence, timer, PERIOD_US, channels, codes, battery)
    assert len(data) <= 84  # one packet of ZigBee
    packet = received(PACKET.transmit_request(data, 0x0013A20040A1B2C3))
    assert packet.source == 0x0013A20040A1B2C3
    batch = decode_batch(packet.data)
    assert [code for row in batch.codes for code in row] == codes
    assert (batch.sequence, batch.timer_us, batch.period_us, batch.battery_mv, batch.flags) == (
        sequence, timer, PERIOD_US, battery, 0)


@pytest.mark.parametrize('code, saturated', [(0, True), (1, False), (1022, False), (1023, True)])
def test_a_reading_at_a_limit_is_flagged(code, saturated):
    assert decode_batch(PACKET.payload(0, 0, 1, 1, [512, code], 0)).saturated is saturated


def test_numbers_wrap():
    batch = decode_batch(PACKET.payload(-1, -1, 1, 1, [512], 1 << 20))
    assert (batch.sequence, batch.timer_us, batch.battery_mv) == (65535, (1 << 32) - 1, 65535)


class Board:
    """Converters, timer, UART and clock of a board, as the firmware sees them."""

    def __init__(self, start_us: int = 0) -> None:
        self.now_us, self.held, self.busy, self.sent = start_us, 0, False, list[bytes]()
        self.codes = {26: count(100), 27: count(600)}  # of 10 bits; the pin of the battery: half

    def modules(self) -> dict[str, ModuleType]:
        """Return the modules ``machine`` and ``time``."""
        machine, time, board = ModuleType('machine'), ModuleType('time'), self

        class Converter:

            def __init__(self, pin: int) -> None:
                self.pin = pin

            def read_u16(self) -> int:
                return (next(board.codes[self.pin]) % 1024 << 6) + 63 if (
                    self.pin in board.codes) else 0x8000

        class Timer:
            PERIODIC = 1

            def __init__(self, *, freq, mode, callback, hard) -> None:
                assert (freq, mode, hard) == (1e6 / PERIOD_US, self.PERIODIC, True)
                board.tick = lambda: callback(self)

        class Pin:
            IN = 0

            def __init__(self, number, mode=None) -> None:
                self.number = number

            def value(self) -> int:
                return board.held

        class Uart:

            def __init__(self, number, baud_rate, *, tx, rx, txbuf) -> None:
                assert (number, baud_rate, tx.number, rx.number) == (0, 115200, 0, 1)
                self.room = txbuf

            def txdone(self) -> bool:
                return not board.busy

            def write(self, data: bytes) -> int:
                assert len(data) <= self.room
                board.sent.append(bytes(data))
                return len(data)
        machine.ADC, machine.Timer, machine.Pin, machine.UART = Converter, Timer, Pin, Uart
        time.ticks_us = lambda: self.now_us % TICKS_WRAP
        time.ticks_diff = lambda a, b: (a - b + TICKS_WRAP // 2) % TICKS_WRAP - TICKS_WRAP // 2
        return {'machine': machine, 'time': time}


class PowerOffError(Exception):
    """Ends the main loop."""


@pytest.fixture
def run(monkeypatch):
    """Return a function that runs the firmware on a board for some batches."""
    def run(board: Board, batches: int, each=lambda number: None) -> list:
        for name, module in board.modules().items():
            monkeypatch.setitem(sys.modules, name, module)
        monkeypatch.setitem(sys.modules, 'packet', PACKET)
        main = runpy.run_path(str(FOLDER / 'main.py'))
        node, steps = main['Node'], iter(range(batches * BATCH))
        step = node.step

        def sample_and_step(self):
            number = next(steps, None)
            if number is None:
                raise PowerOffError
            if number % BATCH == 0:
                each(number // BATCH)
            board.tick()
            board.now_us += PERIOD_US
            step(self)
        monkeypatch.setattr(node, 'step', sample_and_step)
        with pytest.raises(PowerOffError):
            main['main']()
        return [decode_batch(received(frame).data) for frame in board.sent]
    return run


def test_batches_hold_all_samples_in_order(run):
    board = Board(start_us=5_000)
    batches = run(board, 4)
    rows = [row for batch in batches for row in batch.codes]
    assert rows == [(100 + i, 600 + i) for i in range(4 * BATCH)]
    assert [batch.sequence for batch in batches] == [0, 1, 2, 3]
    assert [batch.timer_us for batch in batches] == [
        5_000 + BATCH * PERIOD_US * i for i in range(4)]
    assert {(batch.period_us, batch.battery_mv) for batch in batches} == {(PERIOD_US, 3300)}
    assert all(received(frame).source == 0 for frame in board.sent)  # to the coordinator


def test_the_timer_has_32_bits_although_ticks_wrap(run):
    begin = TICKS_WRAP - BATCH * PERIOD_US
    batches = run(Board(start_us=begin), 3)
    assert [(batch.timer_us - batches[0].timer_us) % (1 << 32) for batch in batches] == [
        BATCH * PERIOD_US * i for i in range(3)]


@pytest.mark.parametrize('refuse', ['held', 'busy'])
def test_a_batch_that_the_radio_refuses_is_a_gap_in_the_numbers(run, refuse):
    board = Board()
    # a batch is sent with its last sample
    batches = run(board, 6, lambda number: setattr(board, refuse, number in (2, 3)))
    assert [batch.sequence for batch in batches] == [0, 1, 4, 5]
    assert [batch.timer_us for batch in batches] == [
        BATCH * PERIOD_US * i for i in (0, 1, 4, 5)]
    assert batches[2].codes[0] == (100 + 4 * BATCH, 600 + 4 * BATCH)


def test_a_batch_is_sent_once(run):
    board = Board()
    assert len(run(board, 2)) == 2


def test_numbers_of_batches_wrap_at_16_bits(run):
    board = Board()
    last = []
    batches = run(board, 65540, lambda number: (
        last.append(number), setattr(board, 'held', number < 65534)))
    assert [batch.sequence for batch in batches] == [65534, 65535, 0, 1, 2, 3]
