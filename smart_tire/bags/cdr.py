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
Messages without ROS: definitions, hashes, empty messages, CDR, and samples from and to it.

The decoder caches the byte layout per topic, five times as fast as rosbags. Consecutive messages
of a topic differ in their numbers only: strings and array lengths repeat. rosbags decodes the
first message, which gives the position of every number. Messages of the same layout are then
decoded by one ``struct``, which also checks that strings and lengths are equal.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from functools import cache, partial
from operator import itemgetter
import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import get_typestore, Stores, TypesysError
from rosbags.typesys.store import Typestore

from smart_tire.errors import MessageError
from smart_tire.messages import OtherJointsError, Topic, TOPICS, wheels_from_msg
from smart_tire.parameters import JointParams, STANDARD_JOINTS
from smart_tire.recording import Faults
from smart_tire.samples import Sample, WheelSample

SCALARS: dict[str, Any] = {'string': '', 'bool': False, 'float32': 0.0, 'float64': 0.0}
STRUCT_CODES = {
    'bool': '?', 'byte': 'B', 'char': 'B', 'octet': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h',
    'uint16': 'H', 'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float32': 'f',
    'float64': 'd'}
BIG_ENDIAN, LITTLE_ENDIAN = b'\x00\x00', b'\x00\x01'  # representation identifiers of plain CDR
HEADER_SIZE = 4   # bytes of the encapsulation header; alignment counts from its end
MAX_LAYOUTS = 64  # cached layouts; a topic needs one per wheel


@cache
def typestore() -> Typestore:
    """Return the types of ROS 2 Jazzy; those used here are equal in all distributions."""
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def definition(type_name: str) -> tuple[str, str]:
    """Return the full definition of a message type and its hash; two empty strings if unknown."""
    if type_name not in typestore().fielddefs:
        return '', ''
    try:
        text, _ = typestore().generate_msgdef(type_name, ros_version=2)
        return text, typestore().hash_rihs01(type_name)
    except TypesysError:
        return '', ''


def empty(type_name: str) -> Any:
    """Return a message of a type as a namespace in which every field is zero or empty."""
    return SimpleNamespace(**{name: _zero(kind) for name, kind in _fields(type_name)})


def _fields(type_name: str) -> Any:
    return typestore().fielddefs[type_name][1]


def _zero(kind: Any) -> Any:
    node, detail = kind
    if node == Nodetype.NAME:
        return empty(detail)
    if node == Nodetype.BASE:
        return SCALARS.get(detail[0], 0)
    if node == Nodetype.ARRAY:
        return [_zero(detail[0]) for _ in range(detail[1])]
    return []


class Encoder:
    """Encodes messages of one type as CDR."""

    def __init__(self, type_name: str) -> None:
        self._type = type_name
        self._numbers = list(_number_fields(type_name, lambda msg: msg))

    def __call__(self, msg: Any) -> bytes:
        """Return ``msg`` as CDR; number lists become arrays in place, as rosbags requires."""
        for owner, name, dtype in self._numbers:
            part = owner(msg)
            setattr(part, name, np.asarray(getattr(part, name), dtype))
        return bytes(typestore().serialize_cdr(msg, self._type))


Getter = Callable[[Any], Any]


def _number_fields(type_name: str, owner: Getter) -> Any:
    """Yield the getter of its owner, name and dtype of each number list in a message type."""
    for name, (node, detail) in _fields(type_name):
        if node == Nodetype.NAME:
            yield from _number_fields(detail, _nested(owner, name))
        elif node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            inner, _ = detail
            if inner[0] == Nodetype.BASE and inner[1][0] != 'string':
                yield owner, name, np.dtype(inner[1][0])


def _nested(owner: Getter, name: str) -> Getter:
    return lambda msg: getattr(owner(msg), name)


class Decoder:
    """Decodes messages of one type."""

    def __init__(self, type_name: str) -> None:
        self._type = type_name
        self._msgdef = typestore().get_msgdef(type_name)
        self._layouts: dict[int, list[_Layout]] = {}
        self._count = 0

    def __call__(self, data: bytes) -> Any:
        """
        Return the message in ``data``, valid until the next call.

        Trailing bytes, which rmw_fastrtps may append, are ignored. Raises MessageError if ``data``
        is not a message of this type.
        """
        for layout in self._layouts.get(len(data), ()):
            if (msg := layout.read(data)) is not None:
                return msg
        return self._add_layout(data)

    def _add_layout(self, data: bytes) -> Any:
        if data[:2] not in (BIG_ENDIAN, LITTLE_ENDIAN):
            raise MessageError(f'{self._type}: begins with {data[:4].hex(" ")}, '
                               'expected 00 00 or 00 01 (plain CDR)')
        read = (self._msgdef.deserialize_cdr_le if data[:2] == LITTLE_ENDIAN
                else self._msgdef.deserialize_cdr_be)
        try:
            msg, _ = read(data[HEADER_SIZE:], 0, self._msgdef.cls, typestore())
        except (SerdeError, struct.error, ValueError, IndexError) as error:
            raise MessageError(f'{self._type}: {len(data)} bytes cannot be decoded '
                               f'({error})') from error
        if self._count == MAX_LAYOUTS:
            self._layouts.clear()
            self._count = 0
        layout = _Layout(self._msgdef.fields, msg, data)
        self._layouts.setdefault(len(data), []).append(layout)
        self._count += 1
        return layout.read(data)


class _Layout:
    """Positions of the numbers in messages with the same strings and array lengths."""

    def __init__(self, fields: Iterable[Any], msg: Any, data: bytes) -> None:
        self._msg = msg
        self._format = ['<' if data[:2] == LITTLE_ENDIAN else '>', '2s2x']
        self._offset = HEADER_SIZE
        self._value_count = 1         # values in the format so far
        self._constant_indices = [0]  # of the values that must not change
        # Object, attribute and index of each value that may change.
        self._assignments: list[tuple[Any, str, int | slice]] = []
        self._add_fields(fields, msg)
        self._unpack = struct.Struct(''.join(self._format)).unpack_from
        self._pick_constants = itemgetter(*self._constant_indices)
        self._expected = self._pick_constants(self._unpack(data))

    def read(self, data: bytes) -> Any:
        """Return the message in ``data``; None if it has another layout."""
        values = self._unpack(data)
        if self._pick_constants(values) != self._expected:
            return None
        for owner, name, index in self._assignments:
            setattr(owner, name, values[index])
        return self._msg

    def _add_fields(self, fields: Iterable[Any], owner: Any) -> None:
        for name, (node, detail) in fields:
            value = getattr(owner, name)
            if node == Nodetype.NAME:
                self._add_fields(typestore().get_msgdef(detail).fields, value)
            elif node == Nodetype.BASE and detail[0] == 'string':
                self._add_string(value)
            elif node == Nodetype.BASE:
                self._add_numbers(detail[0], 1)
                self._assignments.append((owner, name, self._value_count - 1))
            else:
                self._add_list(owner, name, detail[0], fixed=node == Nodetype.ARRAY)

    def _add_list(self, owner: Any, name: str, item: Any, *, fixed: bool) -> None:
        values = getattr(owner, name)
        if not fixed:
            self._add_constant('I', 4)
        if item[0] == Nodetype.NAME:
            for value in values:
                self._add_fields(typestore().get_msgdef(item[1]).fields, value)
        elif item[1][0] == 'string':
            for value in values:
                self._add_string(value)
        elif len(values):
            self._add_numbers(item[1][0], len(values))
            end = self._value_count
            self._assignments.append((owner, name, slice(end - len(values), end)))

    def _add_string(self, value: str) -> None:
        self._add_constant('I', 4)
        size = len(value.encode()) + 1  # with the terminating zero
        self._add_constant(f'{size}s', 1, size)

    def _add_constant(self, code: str, align: int, size: int = 0) -> None:
        self._pad(align)
        self._constant_indices.append(self._value_count)
        self._format.append(code)
        self._value_count += 1
        self._offset += size or align

    def _add_numbers(self, kind: str, count: int) -> None:
        size = struct.calcsize('<' + STRUCT_CODES[kind])
        self._pad(size)
        self._format.append(f'{count}{STRUCT_CODES[kind]}')
        self._value_count += count
        self._offset += count * size

    def _pad(self, align: int) -> None:
        pad = (HEADER_SIZE - self._offset) % align
        self._format.append(f'{pad}x')
        self._offset += pad


class SampleDecoder:
    """
    Messages of a standard topic to samples; ``faults`` counts the invalid ones and the frames.

    ``joints`` are the wheels in ``wheel_states``. With ``other_joints``, messages of that topic
    with other joints are no fault.
    """

    def __init__(self, topic: str, faults: Faults, joints: JointParams = STANDARD_JOINTS,
                 other_joints: bool = False) -> None:
        self._topic, self._faults = topic, faults
        self._frames = faults.frames.setdefault(topic, Counter())
        self._ignored = (OtherJointsError,) if other_joints else ()
        self._read, self._from_msg = Decoder(TOPICS[topic].type), TOPICS[topic].from_msg
        if TOPICS[topic].sample is WheelSample:
            self._from_msg = partial(wheels_from_msg, joints=joints)

    def __call__(self, data: bytes) -> Sample | None:
        """Return the sample in a message; None if there is none."""
        try:
            msg = self._read(data)
            self._frames[msg.header.frame_id] += 1
            return self._from_msg(msg)
        except MessageError as error:
            if not isinstance(error, self._ignored):
                self._faults.reject(self._topic, error)
            return None


class SampleEncoder:
    """Samples of a standard topic to messages; reuses one message object."""

    def __init__(self, topic: Topic) -> None:
        self._fill = topic.to_msg
        self._msg: Any = empty(topic.type)
        self._encode = Encoder(topic.type)

    def __call__(self, sample: Sample) -> bytes:
        """Return the message of a sample."""
        return self._encode(self._fill(self._msg, sample))
