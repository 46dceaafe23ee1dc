# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Bytes of the sensor node: payload of a batch, and its transmit request to the XBee module.

For MicroPython and Python alike. The host reads them with ``smart_tire/protocol``, whose
``tire_payload`` and ``xbee`` have the layouts; the tests compare both.
"""

import struct

VERSION = 1             # of the payload
SATURATED = 0x01        # flag: a sample of the batch is at a limit of the converter
MAX_CODE = 1023         # highest reading, 10 bits
TRANSMIT_REQUEST = 0x10  # frame type
NO_STATUS = 0           # frame id: the module reports nothing, which nobody would read
COORDINATOR = 0         # 64-bit address
UNKNOWN_NETWORK = 0xFFFE  # 16-bit address
NO_RETRIES = 0x01       # option: a batch that is sent again would be late
START, ESCAPE, ESCAPE_XOR = 0x7E, 0x7D, 0x20
SPECIAL = b'\x7e\x7d\x11\x13'


def payload(sequence, timer_us, period_us, channels, codes, battery_mv):
    """
    Return the payload of a batch.

    ``timer_us`` is that of the first sample, ``codes`` are the readings (0 to 1023), sample by
    sample with all channels of each. Sequence number and timer wrap at 16 and 32 bits.
    """
    saturated = min(codes) <= 0 or max(codes) >= MAX_CODE
    return struct.pack(
        '<BBHIHBB', VERSION, SATURATED if saturated else 0, sequence & 0xFFFF,
        timer_us & 0xFFFFFFFF, period_us, channels, len(codes) // channels) + struct.pack(
            f'<{len(codes)}H', *codes) + struct.pack('<H', min(battery_mv, 0xFFFF))


def transmit_request(data, address=COORDINATOR):
    """Return the frame of API mode 2 that sends ``data`` to a module, without retries."""
    body = struct.pack('>BBQHBB', TRANSMIT_REQUEST, NO_STATUS, address, UNKNOWN_NETWORK, 0,
                       NO_RETRIES) + data
    content = struct.pack('>H', len(body)) + body + bytes((0xFF - (sum(body) & 0xFF),))
    frame = bytearray((START,))
    for byte in content:
        if byte in SPECIAL:
            frame.append(ESCAPE)
            byte ^= ESCAPE_XOR
        frame.append(byte)
    return frame
