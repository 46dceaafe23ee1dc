"""XBee API mode 2 and the 0x90 frame, against the examples in Digi's user guides."""

from hypothesis import given, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol import xbee
from smart_tire.protocol.xbee import ReceivePacket, XBeeDeframer

# "XBee/XBee-PRO ZigBee RF Modules User Guide", "ZigBee Receive Packet" (0x90): RxData from
# 0x0013A200 40522BAA, network address 0x7D84. The guide prints the length as 0x11; its 18 bytes
# and its checksum 0x0D say 0x12.
ZIGBEE = (ReceivePacket(0x0013A20040522BAA, 0x7D84, 0x01, b'RxData'),
          '7e 0012 90 0013a20040522baa 7d84 01 527844617461 0d',
          '7e 0012 90 007d33a20040522baa 7d5d84 01 527844617461 0d')
# "XBee SX 868 RF Module User Guide", "Receive Packet - 0x90", "64-bit unicast".
SX868 = (ReceivePacket(0x0013A20041AEB54E, 0xFFFE, 0xC1, b'TxData'),
         '7e 0012 90 0013a20041aeb54e fffe c1 547844617461 c4',
         '7e 0012 90 007d33a20041aeb54e fffe c1 547844617461 c4')
# "XBee/XBee-PRO DigiMesh 2.4 User Manual", "Receive Packet".
DIGIMESH = (ReceivePacket(0x0013A20040522BAA, 0xFFFE, 0x01, b'RxData'),
            '7e 0012 90 0013a20040522baa fffe 01 527844617461 11',
            '7e 0012 90 007d33a20040522baa fffe 01 527844617461 7d31')
PACKETS = [ZIGBEE, SX868, DIGIMESH]

# Whole frames that the guides print with escapes: "API operation with escaped characters", and
# "XBee-PRO 900HP/XSC RF Modules", "Transmit Request frame - 0x10", with AP = 2.
ESCAPED = ['7e 0002 23 7d31 cb',
           '7e 0016 10 01 007d33a200400a0127 fffe 00 00 5478446174613041 7d33']


@pytest.mark.parametrize('packet, plain, escaped', PACKETS)
def test_published_receive_packets_decode_and_encode(packet, plain, escaped):
    escaped = bytes.fromhex(escaped)
    (body,) = XBeeDeframer().feed(escaped)
    assert body == bytes.fromhex(plain)[3:-1]
    assert xbee.decode_receive_packet(body) == packet
    assert xbee.encode_frame(xbee.encode_receive_packet(packet)) == escaped


@pytest.mark.parametrize('text', ESCAPED)
def test_published_escaped_frames_decode_and_encode(text):
    frame = bytes.fromhex(text)
    (body,) = XBeeDeframer().feed(frame)
    assert xbee.encode_frame(body) == frame


@pytest.mark.parametrize('packet, plain, escaped', PACKETS)
def test_xon_and_xoff_that_came_without_escape_are_taken_as_they_are(packet, plain, escaped):
    unescaped = plain.replace('7d84', '7d5d84')  # the escape character itself has no such way
    (body,) = XBeeDeframer().feed(bytes.fromhex(unescaped))
    assert xbee.decode_receive_packet(body) == packet


@given(st.binary(max_size=60))
def test_escaping_leaves_no_special_byte_and_can_be_undone(data):
    escaped = xbee.escape(data)
    assert not set(escaped) & {0x7E, 0x11, 0x13}
    assert escaped.count(0x7D) == sum(data.count(byte) for byte in b'\x7e\x7d\x11\x13')
    assert xbee.unescape(escaped) == data


@given(st.integers(0, 2**64 - 1), st.integers(0, 0xFFFF), st.integers(0, 0xFF),
       st.binary(max_size=255))
def test_receive_packets_survive_the_round_trip(source, network, options, data):
    packet = ReceivePacket(source, network, options, data)
    (body,) = XBeeDeframer().feed(xbee.encode_frame(xbee.encode_receive_packet(packet)))
    assert xbee.decode_receive_packet(body) == packet


@pytest.mark.parametrize('bad', ['7e 0002 2311 00', '7e ffff', '7e', '7e7e', '7e 0000 ff',
                                 '7e 0002 23', '7e 00 7d', '7e 0002 23 7d', '00 11 7d'])
def test_a_good_frame_survives_a_bad_one_in_the_same_read(bad):
    deframer = XBeeDeframer()
    assert list(deframer.feed(bytes.fromhex(bad + '7e 0002 2311 cb'))) == [b'\x23\x11']
    assert deframer.bad_frames == bytes.fromhex(bad).count(0x7E)
    assert deframer.skipped_bytes >= len(bytes.fromhex(bad)) - 1


def test_a_frame_that_ends_in_an_escape_waits_for_the_byte_behind_it():
    deframer = XBeeDeframer()
    assert list(deframer.feed(bytes.fromhex('7e 0002 2e c0 7d'))) == []
    assert list(deframer.feed(bytes.fromhex('31'))) == [b'\x2e\xc0']
    assert deframer.bad_frames == 0


def test_another_frame_type_is_refused_by_name():
    with pytest.raises(FrameError, match='type is 0x8b, expected 0x90'):
        xbee.decode_receive_packet(b'\x8b' + bytes(20))


def test_a_body_that_is_too_short_is_refused():
    with pytest.raises(FrameError, match='has 11 bytes, expected at least 12'):
        xbee.decode_receive_packet(b'\x90' + bytes(10))


@pytest.mark.parametrize('size', [0, xbee.MAX_BODY + 1])
def test_a_body_that_no_deframer_would_take_is_not_encoded(size):
    with pytest.raises(FrameError, match=f'{size} bytes'):
        xbee.encode_frame(bytes(size))
