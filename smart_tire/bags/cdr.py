"""
Bytes of messages to messages, five times as fast as in general.

The messages of one topic differ in their numbers only: names, frames and lengths stay. So the
first one is taken apart by rosbags, which shows where the numbers are, and those that follow
in the same layout by one ``struct`` that also proves that the rest is as it was.
"""

from __future__ import annotations

from collections.abc import Iterable
from operator import itemgetter
import struct
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError

from smart_tire.bags.definitions import typestore
from smart_tire.errors import MessageError

CODES = {
    'bool': '?', 'byte': 'B', 'char': 'B', 'octet': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h',
    'uint16': 'H', 'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float32': 'f',
    'float64': 'd'}
BIG, LITTLE = b'\x00\x00', b'\x00\x01'  # representations of plain CDR
ORIGIN = 4     # bytes of encapsulation, before which nothing is aligned
LAYOUTS = 64   # that are remembered; a topic has one per wheel


class Decoder:
    """Turns the bytes of messages of one type into messages."""

    def __init__(self, type_name: str) -> None:
        self._type = type_name
        self._msgdef = typestore().get_msgdef(type_name)
        self._layouts: dict[int, list[_Layout]] = {}
        self._count = 0

    def __call__(self, data: bytes) -> Any:
        """
        Return the message in ``data``, valid until the next call.

        What follows the message is ignored: rmw_fastrtps leaves some bytes there. Raises
        MessageError if ``data`` is none of this type.
        """
        for layout in self._layouts.get(len(data), ()):
            if (msg := layout.read(data)) is not None:
                return msg
        return self._learn(data)

    def _learn(self, data: bytes) -> Any:
        if data[:2] not in (BIG, LITTLE):
            raise MessageError(f'{self._type}: begins with {data[:4].hex(" ")}, '
                               'expected 00 00 or 00 01 (plain CDR)')
        read = (self._msgdef.deserialize_cdr_le if data[:2] == LITTLE
                else self._msgdef.deserialize_cdr_be)
        try:
            msg, _ = read(data[ORIGIN:], 0, self._msgdef.cls, typestore())
        except (SerdeError, struct.error, ValueError, IndexError) as error:
            raise MessageError(f'{self._type}: {len(data)} bytes are no such message '
                               f'({error})') from error
        if self._count == LAYOUTS:
            self._layouts.clear()
            self._count = 0
        layout = _Layout(self._msgdef.fields, msg, data)
        self._layouts.setdefault(len(data), []).append(layout)
        self._count += 1
        return layout.read(data)


class _Layout:
    """Where the numbers are in messages that are like one that was taken apart."""

    def __init__(self, fields: Iterable[Any], msg: Any, data: bytes) -> None:
        self._msg = msg
        self._format = ['<' if data[:2] == LITTLE else '>', '2s2x']
        self._offset = ORIGIN
        self._places = 1                      # values that the format has so far
        self._same = [0]                      # those that must be as they were
        self._moves: list[tuple[Any, str, int | slice]] = []  # where the others go
        self._add_fields(fields, msg)
        self._unpack = struct.Struct(''.join(self._format)).unpack_from
        self._constants = itemgetter(*self._same)
        self._expected = self._constants(self._unpack(data))

    def read(self, data: bytes) -> Any:
        """Return the message in ``data``; None if its layout is another."""
        values = self._unpack(data)
        if self._constants(values) != self._expected:
            return None
        for owner, name, place in self._moves:
            setattr(owner, name, values[place])
        return self._msg

    def _add_fields(self, fields: Iterable[Any], owner: Any) -> None:
        for name, (node, what) in fields:
            value = getattr(owner, name)
            if node == Nodetype.NAME:
                self._add_fields(typestore().get_msgdef(what).fields, value)
            elif node == Nodetype.BASE and what[0] == 'string':
                self._add_string(value)
            elif node == Nodetype.BASE:
                self._add_numbers(what[0], 1)
                self._moves.append((owner, name, self._places - 1))
            else:
                self._add_list(owner, name, what[0], fixed=node == Nodetype.ARRAY)

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
            self._moves.append((owner, name, slice(self._places - len(values), self._places)))

    def _add_string(self, value: str) -> None:
        self._add_constant('I', 4)
        size = len(value.encode()) + 1  # with its zero
        self._add_constant(f'{size}s', 1, size)

    def _add_constant(self, code: str, align: int, size: int = 0) -> None:
        self._pad(align)
        self._same.append(self._places)
        self._format.append(code)
        self._places += 1
        self._offset += size or align

    def _add_numbers(self, kind: str, count: int) -> None:
        size = struct.calcsize('<' + CODES[kind])
        self._pad(size)
        self._format.append(f'{count}{CODES[kind]}')
        self._places += count
        self._offset += count * size

    def _pad(self, align: int) -> None:
        pad = (ORIGIN - self._offset) % align
        self._format.append(f'{pad}x')
        self._offset += pad
