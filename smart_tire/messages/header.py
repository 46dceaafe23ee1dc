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

"""Header of messages, and checks of their numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, cast

from smart_tire.errors import MessageError
from smart_tire.samples import NS_PER_S, WHEELS


def stamp_of(msg: Any) -> int:
    """Return the stamp [ns] of the header of ``msg``."""
    stamp = msg.header.stamp
    return cast(int, stamp.sec * NS_PER_S + stamp.nanosec)


def set_header(msg: Any, stamp_ns: int, frame: str) -> None:
    """Write stamp [ns] and frame into the header of ``msg``."""
    header = msg.header
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
    header.frame_id = frame


def wheel_of(msg: Any, topic: str) -> str:
    wheel = msg.header.frame_id
    if wheel not in WHEELS:
        raise MessageError(f'{topic}: header.frame_id is {wheel!r}, '
                           f'expected one of {", ".join(WHEELS)}')
    return cast(str, wheel)


def not_finite_error(topic: str, field: str, values: Iterable[float]) -> MessageError:
    return MessageError(f'{topic}: {field} is {list(values)}, expected finite numbers')


def check_magnitude(topic: str, field: str, values: Sequence[float], limit: float,
                    unit: str) -> None:
    if any(abs(value) > limit for value in values):  # NaN: not measured
        raise MessageError(f'{topic}: {field} is {list(values)}, '
                           f'expected magnitudes of at most {limit:g} {unit}')
