# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parts that messages have in common: header, checked numbers, names of a JointState, status."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, cast, TYPE_CHECKING, TypeAlias, TypeVar

from smart_tire.errors import MessageError
from smart_tire.samples import NS_PER_S, WHEELS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from smart_tire.arrays import Array, Instants

MAX_NAMES = 64         # of a JointState: a humanoid robot has some 40 joints
MAX_NAME_LENGTH = 255  # characters, as of the names of ROS
NANOSEC = 'header.stamp.nanosec'
Columns: TypeAlias = 'Mapping[str, Array]'  # path -> numbers (n, k) of n messages of a layout
Numbers = TypeVar('Numbers', bound=Sequence[float])


def stamp_of(msg: Any) -> int:
    """Return the stamp [ns] of the header of ``msg``; raise MessageError if it is invalid."""
    stamp = msg.header.stamp
    if stamp.nanosec >= NS_PER_S:
        raise MessageError(f'{NANOSEC} is 1e9 or more, expected the nanoseconds of a second')
    return cast(int, stamp.sec * NS_PER_S + stamp.nanosec)


def stamps_of(columns: Columns) -> tuple[Instants, NDArray[np.bool_]]:
    """Return the stamps (n,) [ns] of the headers of n messages, and which are valid."""
    sec, nanosec = (columns[f'header.stamp.{part}'][:, 0].astype('int64')
                    for part in ('sec', 'nanosec'))
    return sec * NS_PER_S + nanosec, nanosec < NS_PER_S


def set_header(msg: Any, stamp_ns: int, frame: str) -> None:
    """Write stamp [ns] and frame into the header of ``msg``."""
    header = msg.header
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
    header.frame_id = frame


def set_joints(msg: Any, stamp_ns: int, frame: str, names: Sequence[str],
               **fields: Sequence[float]) -> Any:
    """Write header, names and ``fields`` (position, velocity, effort) into a JointState."""
    set_header(msg, stamp_ns, frame)
    msg.name = names
    for field, numbers in fields.items():
        setattr(msg, field, numbers)
    return msg


def checked_frame(frame: str, topic: str) -> str:
    """Return the name of a frame; raise MessageError if it is too long to be kept."""
    if len(frame) > MAX_NAME_LENGTH:
        raise MessageError(f'{topic}: a frame_id of {len(frame)} characters, expected at most '
                           f'{MAX_NAME_LENGTH}')
    return frame


def names_of(msg: Any, topic: str) -> tuple[str, ...]:
    """Return the names in a JointState; raise MessageError if they are too many or too long."""
    names = tuple(msg.name)
    if len(names) > MAX_NAMES:
        raise MessageError(f'{topic}: {len(names)} names, expected at most {MAX_NAMES}')
    if names and (longest := max(map(len, names))) > MAX_NAME_LENGTH:
        raise MessageError(f'{topic}: a name of {longest} characters, expected at most '
                           f'{MAX_NAME_LENGTH}')
    return names


def wheel_of(msg: Any, topic: str) -> str:
    """Return the wheel that the frame of ``msg`` names."""
    wheel = msg.header.frame_id
    if wheel not in WHEELS:
        raise MessageError(f'{topic}: header.frame_id is {wheel!r}, '
                           f'expected one of {", ".join(WHEELS)}')
    return cast(str, wheel)


def finite(topic: str, field: str, values: Numbers) -> Numbers:
    """Return ``values``; raise MessageError unless all are finite."""
    if not all(map(isfinite, values)):
        raise not_finite_error(topic, field, values)
    return values


def not_finite_error(topic: str, field: str, values: Sequence[float]) -> MessageError:
    """Return the error for ``values`` that are not finite."""
    return MessageError(f'{topic}: {field} is {list(values)}, expected finite numbers')


def bounded(topic: str, field: str, values: Numbers, limit: float, unit: str) -> Numbers:
    """Return ``values``; raise MessageError if the magnitude of one exceeds ``limit``."""
    for value in values:
        if abs(value) > limit:  # NaN: not measured
            raise MessageError(f'{topic}: {field} is {list(values)}, '
                               f'expected magnitudes of at most {limit:g} {unit}')
    return values


@dataclass(frozen=True)
class NodeStatus:
    """Diagnostic status of a node."""

    name: str               # fully qualified, without the leading slash
    level: int              # DiagnosticStatus: 0 OK, 1 warning, 2 error, 3 stale
    message: str
    values: dict[str, str]


def statuses_from_msg(msg: Any) -> list[NodeStatus]:
    """Return the statuses in a DiagnosticArray."""
    return [NodeStatus(status.name, _level(status.level), status.message,
                       {item.key: item.value for item in status.values})
            for status in msg.status]


def _level(level: bytes | int) -> int:
    return level[0] if isinstance(level, bytes) else int(level)  # rclpy has a byte
