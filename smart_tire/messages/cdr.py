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
Serialized messages of frequent types, without message objects of ROS.

A robot sends the same frames, names and numbers of values in all messages of a topic, so that all
numbers stand at the same places: such a layout is one ``struct.Struct``, found from the first
message and checked in each further one. Messages of any layout are understood. ``LayoutDecoder``
returns and ``LayoutEncoder`` takes messages with the attributes of those of ROS.

CDR (OMG DDSI-RTPS 2.5, 10.2) aligns each number to its size, counted from the end of the
encapsulation header; the bytes in between have no meaning.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter, itemgetter
import struct
from types import SimpleNamespace
from typing import Any, TYPE_CHECKING

from smart_tire.errors import MessageError
from smart_tire.messages.header import Columns, MAX_NAME_LENGTH, MAX_NAMES
from smart_tire.messages.joint_names import LAYOUT_CACHE_SIZE
from smart_tire.samples import NS_PER_S

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from smart_tire.arrays import Instants

BYTE_ORDERS = {b'\x00\x00': '>', b'\x00\x01': '<'}  # CDR_BE, CDR_LE
HEADER_SIZE = 4  # bytes: encapsulation identifier and options
STAMPS = tuple(struct.Struct(f'{order}4xiI') for order in BYTE_ORDERS.values())
# bytes: names with length and end, in UTF-8, three numbers for each, and the rest of any type
MAX_SIZE = MAX_NAMES * (4 * MAX_NAME_LENGTH + 8 + 3 * 8) + 2048

# Attributes in the order of their bytes, each with its kind: a time stamp, a string, a double, a
# sequence of strings or of doubles, the number of doubles of an array, or the names of the doubles
# in a part.
TIME, STRING, STRINGS, DOUBLES, DOUBLE = 'time', 'string', 'strings', 'doubles', 'double'
VECTOR, QUATERNION = ('x', 'y', 'z'), ('x', 'y', 'z', 'w')
Kind = str | int | tuple[str, ...]
HEADER: tuple[tuple[str, Kind], ...] = (('header.stamp', TIME), ('header.frame_id', STRING))
FIELDS: dict[str, tuple[tuple[str, Kind], ...]] = {
    'sensor_msgs/msg/JointState': (
        *HEADER, ('name', STRINGS), ('position', DOUBLES), ('velocity', DOUBLES),
        ('effort', DOUBLES)),
    'sensor_msgs/msg/Imu': (
        *HEADER, ('orientation', QUATERNION), ('orientation_covariance', 9),
        ('angular_velocity', VECTOR), ('angular_velocity_covariance', 9),
        ('linear_acceleration', VECTOR), ('linear_acceleration_covariance', 9)),
    'nav_msgs/msg/Odometry': (
        *HEADER, ('child_frame_id', STRING), ('pose.pose.position', VECTOR),
        ('pose.pose.orientation', QUATERNION), ('pose.covariance', 36),
        ('twist.twist.linear', VECTOR), ('twist.twist.angular', VECTOR),
        ('twist.covariance', 36)),
    'sensor_msgs/msg/Temperature': (*HEADER, ('temperature', DOUBLE), ('variance', DOUBLE)),
    'geometry_msgs/msg/PointStamped': (*HEADER, ('point', VECTOR)),
    'geometry_msgs/msg/TwistStamped': (
        *HEADER, ('twist.linear', VECTOR), ('twist.angular', VECTOR)),
}
VARIABLE: dict[Kind, Callable[[Any], Any]] = {  # kind -> what messages of a layout share
    STRING: str, STRINGS: tuple, DOUBLES: len}
Shape = tuple[Any, ...]  # strings, tuples of strings and numbers of doubles of a layout


class CdrReader:
    """Reads the parts of a message in their order; raises struct.error at the end of the data."""

    def __init__(self, data: bytes, what: str) -> None:
        """Raise MessageError, with ``what`` is read, for bytes that are not plain CDR."""
        order = BYTE_ORDERS.get(bytes(data[:2]))
        if order is None:
            raise MessageError(f'{what}: begins with {bytes(data[:4]).hex(" ")}, '
                               'expected 00 00 or 00 01 (plain CDR)')
        self.order, self._data, self._at = order, memoryview(data)[HEADER_SIZE:], 0

    def numbers(self, layout: str, alignment: int) -> tuple[Any, ...]:
        """Return numbers of a struct format, the first one at a multiple of ``alignment``."""
        begin = -(-self._at // alignment) * alignment
        self._at = begin + struct.calcsize(self.order + layout)
        return struct.unpack_from(self.order + layout, self._data, begin)

    def count(self) -> int:
        """Return the length of a string or sequence."""
        (count,) = self.numbers('I', 4)
        return int(count)

    def string(self) -> str:
        """Return a string; raise UnicodeDecodeError if it is not UTF-8."""
        size = self.count()  # with the zero byte at the end
        text = bytes(self._data[self._at:self._at + size])
        if len(text) != size:
            raise struct.error(f'a string of {size} bytes has {len(text)}')
        self._at += size
        return text[:-1].decode()

    def header(self) -> SimpleNamespace:
        """Return a Header."""
        seconds, nanoseconds = self.numbers('iI', 4)
        return SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds),
                               frame_id=self.string())


class MessageLayout:
    """
    Messages of a type with the same strings and the same numbers of doubles.

    ``msg`` is one of them, with zeros.
    """

    def __init__(self, type_name: str, shape: Shape, order: str = '<') -> None:
        self.shape = shape
        self._parts: list[str] = [order, '2s2x']
        self._size = 0  # without the encapsulation header
        identifier = next(key for key, value in BYTE_ORDERS.items() if value == order)
        self._template: list[Any] = [identifier]
        self._static = [0]  # indices into the template
        self.msg = SimpleNamespace()
        self._order = order
        self._doubles: list[slice] = []  # parts of the template with doubles, in their order
        self._scalars: list[tuple[str, int]] = []  # path and index
        self._arrays: list[tuple[str, slice]] = []
        self._bytes: list[tuple[str, str, int, int]] = []  # path, type, first byte and end
        self._static_bytes = [(0, identifier)]  # first byte and content
        shapes = iter(shape)
        for path, kind in FIELDS[type_name]:
            self._add_field(path, kind, shapes)
        self._struct = struct.Struct(''.join(self._parts))
        self.size = self._struct.size
        if len(self._static) == 1:
            self._static.append(0)  # an itemgetter of one index returns no tuple
        self._get_static = itemgetter(*self._static)
        self._statics = self._get_static(self._template)
        self._scalar_places = [(*_owner(self.msg, path), i) for path, i in self._scalars]
        self._array_places = [(*_owner(self.msg, path), part) for path, part in self._arrays]
        self._numbers = attrgetter(*(path for path, _ in (*self._scalars, *self._arrays)))

    def _add_field(self, path: str, kind: Kind, shapes: Iterator[Any]) -> None:
        owner, name = _owner(self.msg, path)
        if kind == TIME:
            setattr(owner, name, SimpleNamespace(sec=0, nanosec=0))
            self._scalars += [(f'{path}.{part}', self._add('iI'[i], 4))
                              for i, part in enumerate(('sec', 'nanosec'))]
            end = HEADER_SIZE + self._size
            self._bytes += [(f'{path}.sec', 'i4', end - 8, end - 4),
                            (f'{path}.nanosec', 'u4', end - 4, end)]
        elif kind == STRING:
            setattr(owner, name, text := next(shapes))
            self._add_string(text)
        elif kind == STRINGS:
            setattr(owner, name, texts := next(shapes))
            self._add_static(self._count(len(texts)))
            for text in texts:
                self._add_string(text)
        elif kind == DOUBLE:
            setattr(owner, name, 0.0)
            self._scalars.append((path, self._add('d', 8)))
            self._add_doubles(path, 1)
        elif isinstance(kind, tuple):
            setattr(owner, name, SimpleNamespace(**dict.fromkeys(kind, 0.0)))
            self._scalars += [(f'{path}.{part}', self._add('d', 8)) for part in kind]
            self._add_doubles(path, len(kind))
        else:
            count = kind if isinstance(kind, int) else int(next(shapes))
            if kind == DOUBLES:
                self._add_static(self._count(count))
            setattr(owner, name, (0.0,) * count)
            begin = len(self._template)
            for _ in range(count):
                self._add('d', 8)
            if count:
                self._arrays.append((path, slice(begin, begin + count)))
            self._add_doubles(path, count)

    def _add_doubles(self, path: str, count: int) -> None:
        """Note where the latest doubles are."""
        end = len(self._template)
        if self._doubles and self._doubles[-1].stop == end - count:
            self._doubles[-1] = slice(self._doubles[-1].start, end)
        else:
            self._doubles.append(slice(end - count, end))
        end = HEADER_SIZE + self._size
        self._bytes.append((path, 'f8', end - 8 * count, end))

    def _count(self, count: int) -> bytes:
        return struct.pack(self._order + 'I', count)

    def _add_string(self, text: str) -> None:
        data = text.encode() + b'\0'
        self._add_static(self._count(len(data)) + data)

    def _add_static(self, data: bytes) -> None:
        self._static.append(self._add(f'{len(data)}s', 4, len(data)))
        self._template[-1] = data
        self._static_bytes.append((HEADER_SIZE + self._size - len(data), data))

    def _add(self, code: str, alignment: int, size: int = 0) -> int:
        """Add a number or bytes to the format; return their index."""
        padding = -self._size % alignment
        self._parts.append(f'{padding}x{code}')
        self._size += padding + (size or alignment)
        self._template.append(0)
        return len(self._template) - 1

    def read(self, data: bytes) -> Any:
        """Return the message in ``data``, valid until the next call; None in another layout."""
        values = self._struct.unpack_from(data)
        if self._get_static(values) != self._statics:
            return None
        for owner, name, i in self._scalar_places:
            setattr(owner, name, values[i])
        for owner, name, part in self._array_places:
            setattr(owner, name, values[part])
        return self.msg

    def rows_in(self, data: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which messages (n, bytes) have this layout."""
        import numpy as np
        columns = [i for begin, content in self._static_bytes
                   for i in range(begin, begin + len(content))]
        content = np.frombuffer(b''.join([content for _, content in self._static_bytes]), np.uint8)
        same: NDArray[np.bool_] = (data[:, columns] == content).all(axis=1)
        return same

    def columns(self, data: NDArray[np.uint8]) -> Columns:
        """Return the numbers of messages (n, bytes) of this layout."""
        import numpy as np
        return {path: np.ascontiguousarray(data[:, begin:end]).view(self._order + kind)
                for path, kind, begin, end in self._bytes}

    def write(self, msg: Any) -> bytes:
        """Return ``msg``, which must have this layout, as CDR."""
        values, numbers = self._template, iter(self._numbers(msg))
        for (_, i), number in zip(self._scalars, numbers):
            values[i] = number
        for (_, part), number in zip(self._arrays, numbers):
            values[part] = number
        return self._struct.pack(*values)

    def write_numbers(self, stamp_ns: int, numbers: Sequence[float]) -> bytes:
        """Return the message with this stamp and all of its doubles, in their order, as CDR."""
        values, begin = self._template, 0
        values[1:3] = divmod(stamp_ns, NS_PER_S)
        for part in self._doubles:
            end = begin + part.stop - part.start
            values[part] = numbers[begin:end]
            begin = end
        return self._struct.pack(*values)


class LayoutDecoder:
    """
    Reads messages of a type of ``FIELDS``.

    ``read_other`` reads, or refuses, bytes that are not understood.
    """

    def __init__(self, type_name: str, read_other: Callable[[bytes], Any]) -> None:
        self._type, self._read_other = type_name, read_other
        self._layouts: dict[int, list[MessageLayout]] = {}  # by size of the message

    def __call__(self, data: bytes) -> Any:
        """
        Return the message in ``data``, valid until the next call.

        Raises MessageError for more bytes than a message with the most names has.
        """
        if len(data) > MAX_SIZE:
            raise MessageError(f'{self._type}: {len(data)} bytes, expected at most {MAX_SIZE}')
        for layout in self._layouts.get(len(data), ()):
            if (msg := layout.read(data)) is not None:
                return msg
        try:
            layout = self._layout_of(data)
        except (MessageError, struct.error, UnicodeDecodeError):
            return self._read_other(data)
        if sum(map(len, self._layouts.values())) >= LAYOUT_CACHE_SIZE:
            self._layouts.clear()
        self._layouts.setdefault(len(data), []).append(layout)
        msg = layout.read(data)
        return self._read_other(data) if msg is None else msg

    def columns(self, data: Sequence[bytes]) -> Iterator[tuple[Any, Instants, Columns]]:
        """
        Yield the messages in ``data`` with a layout that was called before, by layout.

        Each with a message that has its strings, the indices (n,) of its messages, and their
        numbers. Others are left out.
        """
        import numpy as np
        sizes: dict[int, list[int]] = {}
        for i, one in enumerate(data):
            if len(one) in self._layouts:
                sizes.setdefault(len(one), []).append(i)
        for size, indices in sizes.items():
            left = np.array(indices)
            rows = np.frombuffer(b''.join([data[i] for i in indices]), np.uint8).reshape(-1, size)
            for layout in self._layouts[size]:
                same = layout.rows_in(rows)
                yield layout.msg, left[same], layout.columns(rows[same])
                left, rows = left[~same], rows[~same]

    def _layout_of(self, data: bytes) -> MessageLayout:
        reader = CdrReader(data, self._type)
        shape: list[Any] = []
        for _, kind in FIELDS[self._type]:
            if kind == TIME:
                reader.numbers('iI', 4)
            elif kind == STRING:
                shape.append(reader.string())
            elif kind == STRINGS:
                shape.append(tuple([reader.string() for _ in range(reader.count())]))
            elif kind == DOUBLES:
                if count := reader.count():
                    reader.numbers(f'{count}d', 8)
                shape.append(count)
            else:
                count = 1 if kind == DOUBLE else kind if isinstance(kind, int) else len(kind)
                reader.numbers(f'{count}d', 8)
        layout = MessageLayout(self._type, tuple(shape), reader.order)
        if layout.size > len(data):
            raise struct.error('a string has no zero byte at its end')
        return layout


class LayoutEncoder:
    """Writes messages of a type of ``FIELDS``; ``msg`` is one with zeros, to be filled."""

    def __init__(self, type_name: str) -> None:
        self._type = type_name
        self._variable = [(attrgetter(path), VARIABLE[kind])
                          for path, kind in FIELDS[type_name] if kind in VARIABLE]
        self._layouts: dict[Shape, MessageLayout] = {}
        self.msg = MessageLayout(type_name, tuple(
            '' if kind is str else kind(()) for _, kind in self._variable)).msg

    def __call__(self, msg: Any) -> bytes:
        """Return ``msg`` as CDR."""
        return self.layout(msg).write(msg)

    def layout(self, msg: Any) -> MessageLayout:
        """Return the layout of ``msg``."""
        shape = tuple([kind(value(msg)) for value, kind in self._variable])
        layout = self._layouts.get(shape)
        if layout is None:
            if len(self._layouts) >= LAYOUT_CACHE_SIZE:
                self._layouts.clear()
            layout = self._layouts[shape] = MessageLayout(self._type, shape)
        return layout


def stamp_in(data: bytes) -> int:
    """Return the stamp [ns] in the header of a serialized message; 0 if it is truncated."""
    if len(data) < HEADER_SIZE + 8:
        return 0
    sec, nanosec = STAMPS[data[1] & 1].unpack_from(data)
    stamp_ns: int = sec * NS_PER_S + nanosec
    return stamp_ns


def _owner(msg: Any, path: str) -> tuple[Any, str]:
    """Return the part of ``msg``, made where missing, that has the last name of ``path``."""
    *parts, name = path.split('.')
    for part in parts:
        if not hasattr(msg, part):
            setattr(msg, part, SimpleNamespace())
        msg = getattr(msg, part)
    return msg, name
