# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""XBee API mode 2 and the 0x90 frame, against the frames of test/data/frames/xbee.txt."""

from hypothesis import given, strategies as st
import numpy as np
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol import xbee
from smart_tire.protocol.xbee import ReceivePacket, XBeeDeframer
from support.frames import each_frame, frames

GOOD = frames('xbee')['escaped_data'].data
RECEIVE_PACKET_VALUES = ('source', 'network', 'options', 'data')


def body_of(frame):
    """Return the body of ``frame``, from its bytes in API mode 1."""
    return bytes.fromhex(frame['unescaped'])[3:-1]


def packet_of(frame):
    """Return the packet that the file gives for ``frame``."""
    return ReceivePacket(*(frame[key] for key in RECEIVE_PACKET_VALUES))


@each_frame('xbee')
def test_a_frame_yields_the_body_that_it_has_in_api_mode_1(frame):
    deframer = XBeeDeframer()
    assert list(deframer.extract(frame.data)) == [body_of(frame)]
    assert body_of(frame)[0] == frame['frame_type']
    assert (deframer.bad_frames, deframer.skipped_bytes) == (0, 0)


@each_frame('xbee', *RECEIVE_PACKET_VALUES)
def test_a_receive_packet_decodes_to_its_documented_fields(frame):
    assert xbee.decode_receive_packet(body_of(frame)) == packet_of(frame)
    assert xbee.encode_receive_packet(packet_of(frame)) == body_of(frame)


@each_frame('xbee', *RECEIVE_PACKET_VALUES)
def test_xon_and_xoff_are_also_accepted_without_escape(frame):
    partly_escaped = frame.data.replace(b'\x7d\x31', b'\x11').replace(b'\x7d\x33', b'\x13')
    assert partly_escaped != frame.data
    (body,) = XBeeDeframer().extract(partly_escaped)
    assert xbee.decode_receive_packet(body) == packet_of(frame)


@given(st.binary(max_size=60))
def test_escaped_data_has_no_special_byte_and_can_be_unescaped(data):
    escaped = xbee.escape(data)
    assert not set(escaped) & {0x7E, 0x11, 0x13}
    assert escaped.count(0x7D) == sum(data.count(byte) for byte in b'\x7e\x7d\x11\x13')
    assert xbee.unescape(escaped) == data


@given(st.integers(0, 2**64 - 1), st.integers(0, 0xFFFF), st.integers(0, 0xFF),
       st.binary(max_size=255))
def test_receive_packets_survive_the_round_trip(source, network, options, data):
    packet = ReceivePacket(source, network, options, data)
    (body,) = XBeeDeframer().extract(xbee.encode_frame(xbee.encode_receive_packet(packet)))
    assert xbee.decode_receive_packet(body) == packet


@pytest.mark.parametrize('bad', ['7e 0002 2311 00', '7e ffff', '7e', '7e7e', '7e 0000 ff',
                                 '7e 0002 23', '7e 00 7d', '7e 0002 23 7d', '00 11 7d'])
def test_a_good_frame_survives_a_bad_one_in_the_same_read(bad):
    deframer = XBeeDeframer()
    assert list(deframer.extract(bytes.fromhex(bad) + GOOD)) == [b'\x23\x11']
    assert deframer.bad_frames == bytes.fromhex(bad).count(0x7E)
    assert deframer.skipped_bytes >= len(bytes.fromhex(bad)) - 1


@pytest.mark.parametrize('name', ['escaped_checksum', 'start_delimiter_as_checksum'])
def test_a_frame_that_ends_in_an_escape_waits_for_the_escaped_byte(name):
    frame = frames('xbee')[name]
    deframer = XBeeDeframer()
    assert list(deframer.extract(frame.data[:-1])) == []
    assert list(deframer.extract(frame.data[-1:])) == [body_of(frame)]
    assert deframer.bad_frames == 0


def test_another_frame_type_is_named_in_the_error():
    with pytest.raises(FrameError, match='type is 0x92, expected 0x90'):
        xbee.decode_receive_packet(body_of(frames('xbee')['io_sample_zigbee']))


def test_a_body_that_is_too_short_is_refused():
    with pytest.raises(FrameError, match='has 11 bytes, expected at least 12'):
        xbee.decode_receive_packet(body_of(frames('xbee')['receive_packet_zigbee'])[:11])


@pytest.mark.parametrize('size', [0, xbee.MAX_BODY_LENGTH + 1])
def test_a_body_of_a_length_that_the_deframer_refuses_is_not_encoded(size):
    with pytest.raises(FrameError, match=f'{size} bytes'):
        xbee.encode_frame(bytes(size))


def test_bytes_without_a_start_byte_are_discarded_at_once():
    deframer = XBeeDeframer()
    assert list(deframer.extract(bytes(1000))) == []
    assert (deframer.skipped_bytes, deframer.bad_frames) == (1000, 0)


def plain(body):
    """Return the frame of API mode 1 with ``body``."""
    return b'\x7e' + len(body).to_bytes(2, 'big') + body + bytes((0xFF - sum(body) % 256,))


def packets(count=400, size=90):
    """Return bodies of received packets with random data."""
    rng = np.random.default_rng(5)
    return [xbee.encode_receive_packet(ReceivePacket(0x13A20040A1B2C3, 0xFFFE, 1, rng.bytes(size)))
            for _ in range(count)]


@pytest.mark.parametrize('chunk', [1, 7, 64, 5000])
def test_frames_of_mode_1_are_named_until_mode_2_is_set(chunk):
    bodies, deframer, found = packets(), XBeeDeframer(), []
    stream = b''.join(map(plain, bodies))
    for k in range(0, len(stream), chunk):
        found += deframer.extract(stream[k:k + chunk])
    assert set(found) <= set(bodies) and deframer.bad_frames > 100
    assert deframer.damage == 'frames are not escaped: set AP = 2 of the coordinator'
    list(deframer.extract(b''.join(map(xbee.encode_frame, bodies))))
    assert deframer.damage == ''


def test_one_byte_that_mode_2_escapes_is_evidence_of_mode_1():
    def said(data):
        deframer = XBeeDeframer()
        assert len(list(deframer.extract(plain(xbee.encode_receive_packet(
            ReceivePacket(1, 0xFFFE, 1, data)))))) == 1
        return deframer.damage
    assert not said(b'abc') and said(b'a\x11c') and said(b'a\x13c')


def test_damage_does_not_look_like_mode_1():
    rng, deframer, found = np.random.default_rng(6), XBeeDeframer(), []
    bodies = packets(2000, 40)
    for body in bodies:
        frame = bytearray(xbee.encode_frame(body))
        if rng.random() < 0.3:
            frame[rng.integers(len(frame))] ^= 1 << rng.integers(8)
        found += deframer.extract(bytes(frame))
        assert deframer.damage == ''
    assert len(set(found) & set(bodies)) > 0.6 * len(bodies)


def test_explicit_packets_have_the_same_data():
    body = bytes.fromhex('91 0013a20040a1b2c3 fffe e8 e8 0011 c105 01') + b'data'
    assert xbee.decode_receive_packet(body) == ReceivePacket(
        0x13A20040A1B2C3, 0xFFFE, 1, b'data')
    with pytest.raises(FrameError, match='has 17 bytes, expected at least 18'):
        xbee.decode_receive_packet(body[:17])


@pytest.mark.parametrize('body, expected', [
    (b'\x8a\x06', True), (b'\x8b' + bytes(6), True), (b'\x90' + bytes(11), False),
    (b'\x92' + bytes(11), False)])
def test_a_status_of_the_module_is_no_data_and_no_fault(body, expected):
    assert xbee.is_status(body) == expected
