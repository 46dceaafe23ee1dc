"""CRC-16 of the VectorNav and RoboClaw protocols."""

from __future__ import annotations

import binascii


def crc16(data: bytes) -> int:
    """
    Return the CRC-16/XMODEM of ``data``: polynomial 0x1021, initial value 0, not reflected.

    The CRC of a message followed by its own CRC, high byte first, is 0. VectorNav UM001, 3.8.3;
    RoboClaw user manual, "CRC16 Checksum Calculation".
    """
    return binascii.crc_hqx(data, 0)
