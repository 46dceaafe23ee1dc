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

"""Counting of frames in the base of the receivers."""

from __future__ import annotations

import pytest

from smart_tire.drivers.sample_stream import FrameReceiver
from smart_tire.errors import FrameError
from smart_tire.protocol.xbee import encode_frame, XBeeDeframer

GOOD, INVALID = encode_frame(b'\x01'), encode_frame(b'\x02')
DAMAGED = GOOD[:-1] + bytes((GOOD[-1] ^ 1,))


class Receiver(FrameReceiver):
    """A receiver that accepts a single body only."""

    def receive(self, chunk, receive_ns):
        """Return the bodies accepted in ``chunk``."""
        return list(self._decoded(chunk, receive_ns, self._decode))

    def _decode(self, body):
        if body != b'\x01':
            raise FrameError(f'invalid body {body.hex()}')
        return body


@pytest.fixture
def receiver():
    return Receiver(XBeeDeframer())


def test_good_frames_are_yielded_and_counted_with_their_arrival_time(receiver):
    assert receiver.receive(GOOD + GOOD, 7) == [b'\x01'] * 2
    assert (receiver.frames_ok, receiver.frames_bad, receiver.last_ok_ns) == (2, 0, 7)


def test_a_frame_with_invalid_content_is_rejected_with_the_reason(receiver):
    assert receiver.receive(INVALID + GOOD, 7) == [b'\x01']
    assert (receiver.frames_ok, receiver.frames_bad, receiver.rejected) == (1, 1, 1)
    assert receiver.last_error == 'invalid body 02'


def test_a_damaged_frame_is_bad_but_not_rejected(receiver):
    assert receiver.receive(DAMAGED + GOOD, 7) == [b'\x01']
    assert (receiver.frames_ok, receiver.frames_bad, receiver.rejected) == (1, 1, 0)
    assert receiver.bytes_skipped == len(DAMAGED)
