"""The 16-bit cyclic redundancy check that VectorNav and RoboClaw share."""

from __future__ import annotations

import binascii


def crc16(data: bytes) -> int:
    """
    Return the CRC-16/XMODEM of ``data``: polynomial 0x1021, start 0, nothing reflected.

    A message with its CRC appended, high byte first, has the CRC 0. VectorNav UM001 3.8.3;
    RoboClaw user manual, "CRC16 Checksum Calculation".
    """
    return binascii.crc_hqx(data, 0)
