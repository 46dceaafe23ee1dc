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

"""
Path from the bytes of a serialized message, whose number of poses is read first.

rclpy converts all poses of a message, at 20 us each, before it can be refused.
"""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

from smart_tire.errors import MessageError
from smart_tire.messages.path import path_from_msg
from smart_tire.samples import PlannedPath

# OMG DDSI-RTPS 2.5, 10.2: encapsulation identifier and options. CDR aligns each number to its
# size, counted from the end of this header.
BYTE_ORDERS = {b'\x00\x00': '>', b'\x00\x01': '<'}  # CDR_BE, CDR_LE
HEADER_SIZE = 4  # bytes


class CdrReader:
    """Reads the parts of a Path in their order; raises struct.error at the end of the data."""

    def __init__(self, data: bytes) -> None:
        """Raise MessageError for bytes that are not CDR."""
        order = BYTE_ORDERS.get(data[:2])
        if order is None:
            raise MessageError(f'path: encapsulation is {data[:2].hex() or "missing"}, '
                               'expected 0000 or 0001 (CDR)')
        self._data, self._at = memoryview(data)[HEADER_SIZE:], 0
        self._stamp, self._count, self._pose = (
            struct.Struct(order + layout) for layout in ('iI', 'I', '7d'))

    def _numbers(self, layout: struct.Struct, alignment: int) -> tuple[Any, ...]:
        begin = -(-self._at // alignment) * alignment
        self._at = begin + layout.size
        return layout.unpack_from(self._data, begin)

    def count(self) -> int:
        """Return the length of a string or sequence."""
        (count,) = self._numbers(self._count, 4)
        return int(count)

    def header(self) -> SimpleNamespace:
        """Return a Header."""
        seconds, nanoseconds = self._numbers(self._stamp, 4)
        size = self.count()  # with the zero byte at the end
        text = bytes(self._data[self._at:self._at + size])[:-1]
        self._at += size
        return SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds),
                               frame_id=text.decode())

    def stamped_pose(self) -> SimpleNamespace:
        """Return a PoseStamped."""
        header = self.header()
        p_x, p_y, p_z, q_x, q_y, q_z, q_w = self._numbers(self._pose, 8)
        return SimpleNamespace(header=header, pose=SimpleNamespace(
            position=SimpleNamespace(x=p_x, y=p_y, z=p_z),
            orientation=SimpleNamespace(x=q_x, y=q_y, z=q_z, w=q_w)))


def path_from_bytes(data: bytes, max_poses: int) -> PlannedPath:
    """Return the path in a serialized Path; raise MessageError if it has too many poses."""
    reader = CdrReader(data)
    try:
        header, count = reader.header(), reader.count()
        if count > max_poses:
            raise MessageError(f'path: {count} poses, expected at most {max_poses} '
                               '(checks.max_path_poses)')
        return path_from_msg(SimpleNamespace(
            header=header, poses=(reader.stamped_pose() for _ in range(count))))
    except (struct.error, UnicodeDecodeError) as error:
        raise MessageError(f'path: {len(data)} bytes are no nav_msgs/Path: {error}') from error
