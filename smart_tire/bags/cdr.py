# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages without ROS: definitions, hashes, empty messages, CDR, samples from and to it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import cache, cached_property, partial
from itertools import compress
import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_msg, get_typestore, Stores, TypesysError
from rosbags.typesys.store import Typestore

from smart_tire.errors import MessageError
from smart_tire.messages import (
    cdr, definitions, forms_of, icr_numbers, imu_from_msg, imus_from_columns, odometry_numbers,
    OtherJointsError, stamp_of, tire_from_msg, tires_from_columns, Topic, wheel_slip_numbers)
from smart_tire.messages.wheel_reader import WheelReader
from smart_tire.parameters import JointParams, STANDARD_JOINTS
from smart_tire.recording import Faults
from smart_tire.samples import (
    Icr, NS_PER_S, Odometry, Sample, TireSamples, WheelSample, WheelSlip)

SCALARS: dict[str, Any] = {'string': '', 'bool': False, 'float32': 0.0, 'float64': 0.0}
FROM_COLUMNS = {tire_from_msg: tires_from_columns, imu_from_msg: imus_from_columns}
# of messages that all have the same strings, and so one layout
NUMBERS: dict[type, Callable[[Any], Sequence[float]]] = {
    Odometry: odometry_numbers, WheelSlip: wheel_slip_numbers, Icr: icr_numbers}


@cache
def typestore() -> Typestore:
    """
    Return the types of ROS 2 Jazzy and of smart_tire_msgs.

    Those of ROS that are used here are equal in all distributions.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in definitions().items():
        store.register(get_types_from_msg(text, name))
    return store


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

    @cached_property
    def _msgdef(self) -> Any:
        return typestore().get_msgdef(self._type)  # at first use: loading it takes 0.1 s

    def __call__(self, data: bytes) -> Any:
        """
        Return the message in ``data``; raise MessageError if it is not one of this type.

        Trailing bytes, which rmw_fastrtps may append, are ignored: the functions of rosbags for
        whole messages do not.
        """
        if data[:2] not in cdr.BYTE_ORDERS:
            raise MessageError(f'{self._type}: begins with {data[:4].hex(" ")}, '
                               'expected 00 00 or 00 01 (plain CDR)')
        read = (self._msgdef.deserialize_cdr_be if cdr.BYTE_ORDERS[data[:2]] == '>'
                else self._msgdef.deserialize_cdr_le)
        try:
            msg, _ = read(data[cdr.HEADER_SIZE:], 0, self._msgdef.cls, typestore())
        except (SerdeError, struct.error, ValueError, IndexError) as error:
            raise MessageError(f'{self._type}: {len(data)} bytes cannot be decoded '
                               f'({error})') from error
        return msg


def decoder(type_name: str) -> Decoder | cdr.LayoutDecoder:
    """Return what decodes messages of a type, by their layout if it is a frequent one."""
    read = Decoder(type_name)
    return cdr.LayoutDecoder(type_name, read) if type_name in cdr.FIELDS else read


class SampleDecoder:
    """
    Messages of a standard topic to samples; ``faults`` counts the invalid ones and the frames.

    The messages have the type ``type_name``, by default that in ``TOPICS``. ``joints`` are the
    wheels in ``wheel_states``. With ``other_joints``, messages of that topic with other joints are
    no fault.
    """

    def __init__(self, topic: str, faults: Faults, joints: JointParams = STANDARD_JOINTS,
                 other_joints: bool = False, type_name: str = '') -> None:
        self._topic, self._faults = topic, faults
        self._frames = faults.frames.setdefault(topic, Counter())
        self._ignored = (OtherJointsError,) if other_joints else ()
        forms = forms_of(topic)
        form = forms[type_name] if type_name else next(iter(forms.values()))
        self._from_msg: Callable[[Any], Any] = form.from_msg
        self._from_columns: Callable[[Any, Any], Any] | None = FROM_COLUMNS.get(form.from_msg)
        self._read: Any = decoder(form.type)
        if form.sample is WheelSample:
            reader = WheelReader(joints)
            self._from_msg, faults.completed = reader, reader.completed
        elif form.from_msg is imu_from_msg:
            faults.contradictions = Counter()
            self._from_msg = partial(imu_from_msg, contradictions=faults.contradictions)

    def __call__(self, data: bytes, ahead_ns: int = 0) -> Sequence[Sample]:
        """Return the samples in a message, whose stamp is ``ahead_ns`` ahead of time."""
        try:
            msg = self._read(data)
            if ahead_ns:
                stamp = msg.header.stamp
                stamp.sec, stamp.nanosec = divmod(stamp_of(msg) - ahead_ns, NS_PER_S)
            self._frames[msg.header.frame_id] += 1
            sample = self._from_msg(msg)
        except MessageError as error:
            if not isinstance(error, self._ignored):
                self._faults.reject(self._topic, error)
            return ()
        if sample is None:
            return ()
        return sample.samples if isinstance(sample, TireSamples) else (sample,)

    def block(self, messages: Sequence[bytes]) -> list[Sample | None]:
        """
        Return the sample in each of ``messages``, decoded together.

        None are messages to be read one by one: what is invalid, unusual or rare.
        """
        found: list[Sample | None] = [None] * len(messages)
        if self._from_columns is None:
            return found
        for msg, indices, columns in self._read.columns(messages):
            try:
                samples, valid = self._from_columns(msg, columns)
            except MessageError:
                continue
            self._frames[msg.header.frame_id] += int(valid.sum())
            for i, sample in compress(zip(indices.tolist(), samples), valid.tolist()):
                found[i] = sample
        return found


class SampleEncoder:
    """Samples of a standard topic to messages; reuses one message object."""

    def __init__(self, topic: Topic) -> None:
        self._fill = topic.to_msg
        self._msg = empty(topic.type)
        self._encode = (cdr.LayoutEncoder if topic.type in cdr.FIELDS else Encoder)(topic.type)
        self._numbers = NUMBERS.get(topic.sample)
        self._layout: cdr.MessageLayout | None = None  # of all messages, once known

    def __call__(self, sample: Sample) -> bytes:
        """Return the message of a sample."""
        if self._layout is not None and self._numbers is not None:
            return self._layout.write_numbers(sample.stamp_ns, self._numbers(sample))
        msg = self._fill(self._msg, sample)
        if self._numbers is not None and isinstance(self._encode, cdr.LayoutEncoder):
            self._layout = self._encode.layout(msg)
        return self._encode(msg)
