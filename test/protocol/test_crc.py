"""CRC-16/XMODEM."""

from smart_tire.protocol.crc import crc16


def test_the_check_value_is_the_published_one():
    # Catalogue of parametrised CRC algorithms (reveng), CRC-16/XMODEM: check 0x31c3.
    assert crc16(b'123456789') == 0x31C3


def test_a_message_with_its_crc_has_the_crc_0():
    message = bytes(range(40))
    assert crc16(message + crc16(message).to_bytes(2, 'big')) == 0
    assert crc16(b'') == 0
