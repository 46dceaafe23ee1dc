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

"""CRC-16/XMODEM."""

from smart_tire.protocol.deframer import crc16
from support.frames import each_frame


@each_frame('crc16')
def test_the_crc_of_a_published_message_is_the_published_one(frame):
    assert crc16(frame.data[:-2]) == frame['crc']


@each_frame('crc16')
def test_a_message_followed_by_its_crc_has_crc_zero(frame):
    assert crc16(frame.data) == 0


def test_the_crc_starts_at_zero():
    assert crc16(b'') == 0
