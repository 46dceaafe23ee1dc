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

"""Message types without ROS: definitions, hashes, empty messages and CDR encoding."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_typestore, Stores, TypesysError
from rosbags.typesys.store import Typestore

SCALARS: dict[str, Any] = {'string': '', 'bool': False, 'float32': 0.0, 'float64': 0.0}


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
