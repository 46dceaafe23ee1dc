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
