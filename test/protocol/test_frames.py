# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Frames in test/data/frames: complete, and correct by rules independent of smart_tire."""

from functools import reduce
import operator

import pytest
from support.frames import all_frames, frames, ORIGINS

FRAMES = list(all_frames())


def crc16(data):
    """Return the CRC by the bitwise rule of the RoboClaw manual, "CRC16 Checksum Calculation"."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def escaped(frame):
    """Return ``frame`` with the bytes after the start delimiter escaped as Digi describes it."""
    result = list(frame[:1])
    for byte in frame[1:]:
        result += [0x7D, byte ^ 0x20] if byte in (0x7E, 0x7D, 0x11, 0x13) else [byte]
    return bytes(result)


def xbee_is_valid(frame):
    unescaped = bytes.fromhex(frame['unescaped'])
    return (frame.data == escaped(unescaped)
            and int.from_bytes(unescaped[1:3], 'big') == len(unescaped) - 4
            and sum(unescaped[3:]) & 0xFF == 0xFF)


def tire_payload_is_valid(frame):
    channels, samples = frame.data[10:12]
    return len(frame.data) == 12 + 2 * channels * samples + 2


def sentence_is_valid(frame):
    body, digits = frame.data[1:-2].split(b'*')
    check = b'%04X' % crc16(body) if len(digits) == 4 else b'%02X' % reduce(operator.xor, body)
    return frame.data[:1] == b'$' and frame.data[-2:] == b'\r\n' and digits == check


def binary_is_valid(frame):
    is_intact = frame.data[0] == 0xFA and crc16(frame.data[1:]) == 0
    return is_intact != ('misprint' in frame.values)


def xsens_is_valid(frame):
    return 'number' in frame.values or (
        frame.data[:2] == b'\xfa\xff' and frame.data[3] == len(frame.data) - 5
        and sum(frame.data[1:]) & 0xFF == 0)


def roboclaw_is_valid(frame):
    if 'request' in frame.values:
        return crc16(bytes.fromhex(frame['request']) + frame.data) == 0
    return len(frame.data) == 2 or frame.data == b'\xff' or crc16(frame.data) == 0


CHECKS = {
    'crc16': lambda frame: crc16(frame.data) == 0,
    'roboclaw': roboclaw_is_valid,
    'tire_payload': tire_payload_is_valid,
    'vectornav_ascii': sentence_is_valid,
    'vectornav_binary': binary_is_valid,
    'xbee': xbee_is_valid,
    'xsens': xsens_is_valid,
}


def test_every_protocol_has_frames():
    assert {file for file, _ in FRAMES} == CHECKS.keys()


@pytest.mark.parametrize('file', CHECKS)
def test_every_frame_gives_origin_device_source_and_values(file):
    for frame in frames(file).values():
        assert frame.header['origin'] in ORIGINS, frame
        assert frame.header.keys() >= {'origin', 'device', 'source'}, frame
        assert frame.header.keys() <= {'origin', 'device', 'source', 'computed'}, frame
        assert frame.values and frame.data, frame


@pytest.mark.parametrize('file, frame', FRAMES, ids=lambda part: str(part))
def test_every_frame_has_the_length_and_checksum_of_its_protocol(file, frame):
    assert CHECKS[file](frame)
