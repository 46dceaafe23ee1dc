"""CRC-16/XMODEM."""

from smart_tire.protocol.crc import crc16
from support.frames import each_frame


@each_frame('crc16')
def test_the_crc_of_a_published_message_is_the_published_one(frame):
    assert crc16(frame.data[:-2]) == frame['crc']


@each_frame('crc16')
def test_a_message_followed_by_its_crc_has_crc_zero(frame):
    assert crc16(frame.data) == 0


def test_the_crc_starts_at_zero():
    assert crc16(b'') == 0
