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

"""Frames of a byte stream, decoded and counted: what all receivers of a device share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from smart_tire.errors import FrameError
from smart_tire.protocol.deframer import Deframer

Item = TypeVar('Item')


class FrameReceiver:
    """Base of the receivers: splits a byte stream into frames and counts good and bad ones."""

    def __init__(self, deframer: Deframer) -> None:
        self.frames_ok = 0
        self.last_ok_ns = 0   # host clock, when the latest good frame arrived
        self.rejected = 0     # intact frames with invalid or unexpected content
        self.last_error = ''  # why the latest one was rejected
        self._deframer = deframer

    @property
    def frames_bad(self) -> int:
        """Return how many frames were damaged or rejected."""
        return self._deframer.bad_frames + self.rejected

    @property
    def bytes_skipped(self) -> int:
        """Return how many bytes did not belong to an intact frame."""
        return self._deframer.skipped_bytes

    def _decoded(self, chunk: bytes, receive_ns: int,
                 decode: Callable[[bytes], Item]) -> Iterator[Item]:
        """Yield the decoded frames that ``chunk`` completes; reject those with a FrameError."""
        for body in self._deframer.extract(chunk):
            try:
                item = decode(body)
            except FrameError as error:
                self.rejected += 1
                self.last_error = str(error)
                continue
            self.frames_ok += 1
            self.last_ok_ns = receive_ns
            yield item
