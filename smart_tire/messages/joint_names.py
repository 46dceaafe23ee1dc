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
Which joints of a JointState message are the wheels.

The joints have the names in the parameters ``joints.*``. With the defaults of these, names that
differ from the standard ones are recognized, but only if no other reading is possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
import re
from typing import Any

from smart_tire.errors import MessageError
from smart_tire.parameters.robot import JointParams, STANDARD_JOINTS
from smart_tire.samples import Four, four, WHEELS

LAYOUT_CACHE_SIZE = 64  # lists of names; a robot has about ten
TOKEN = re.compile(r'[A-Z]?[a-z]+|[A-Z]+(?![a-z])')  # also splits camelCase
PLACES = {'front': 'front', 'rear': 'rear', 'back': 'rear'}
SIDES = {'left': 'left', 'right': 'right', 'l': 'left', 'r': 'right'}
CORNERS = {'fl': 'front_left', 'fr': 'front_right', 'rl': 'rear_left', 'rr': 'rear_right',
           'bl': 'rear_left', 'br': 'rear_right'}
# A name with no other words than these, and those of the place, is a wheel.
WHEEL_WORDS = {'wheel', 'wheels', 'drivewhl', 'drive', 'motor', 'joint', 'link', 'base', 'hub',
               'encoder', 'axle'}
NO_WHEEL_WORDS = {'caster', 'castor', 'steer', 'steering', 'suspension', 'arm', 'hand', 'finger',
                  'gripper', 'camera', 'bogie', 'rocker', 'pivot', 'swivel'}


class OtherJointsError(MessageError):
    """A JointState message of other joints than the wheels, for example of an arm."""


@dataclass(frozen=True)
class WheelLayout:
    """Positions of the wheels in the fields of a message; one value per wheel."""

    indices: tuple[int | None, ...]  # None: not measured
    signs: Four                      # -1 for an inverted joint
    # -, times the torque of the joint: the sign, halved if the joint drives both wheels of a side
    torque_factors: Four


def recognized_joints(names: Sequence[str]) -> JointParams | None:
    """
    Return the joints of the wheels among ``names``, recognized by their names.

    None unless each wheel, or each side of a two-wheel drive, has exactly one candidate and no
    candidate is left over.
    """
    if _is_standard(names):
        return STANDARD_JOINTS
    found: dict[str, list[str]] = {}
    for name in names:
        if (place := _place(name)) is not None:
            found.setdefault(place, []).append(name)
    if any(len(joints) > 1 for joints in found.values()) or (
            found.keys() not in (set(WHEELS), set(SIDES.values()))):
        return None
    given: dict[str, Any] = {place: joints[0] for place, joints in found.items()}
    return JointParams(**given)


def _place(name: str) -> str | None:
    """Return the wheel or the side of a joint, '' for another wheel; None if it is no wheel."""
    words = [word.lower() for word in TOKEN.findall(name)]
    corners = [CORNERS[word] for word in words if word in CORNERS]
    ends, sides = ([names[word] for word in words if word in names] for names in (PLACES, SIDES))
    others = set(words) - CORNERS.keys() - PLACES.keys() - SIDES.keys()
    is_wheel = any('wheel' in word for word in words) or others <= WHEEL_WORDS
    if not is_wheel or others & NO_WHEEL_WORDS or not (corners or ends or sides):
        return None
    parts = corners or ['_'.join((*ends, *sides))]
    return parts[0] if len(parts) == 1 and parts[0] in (*WHEELS, *SIDES.values()) else ''


@lru_cache(LAYOUT_CACHE_SIZE)
def wheel_layout(names: tuple[str, ...], joints: JointParams, topic: str, *,
                 recognize: bool = True) -> WheelLayout:
    """
    Return where the wheels are in a message with ``names``.

    Raises OtherJointsError if it contains none of the wheels, MessageError if it contains some of
    them only, or one twice. Without ``recognize`` only the names in ``joints`` are accepted.
    """
    resolved = resolved_joints(names, joints) if recognize or _is_standard(names) else joints
    wanted = [name for name in resolved.names if name]
    if not set(wanted) & set(names):
        raise OtherJointsError(_message(names, resolved, topic))
    if any(names.count(name) != 1 for name in wanted) or not set(resolved.inverted) <= set(wanted):
        raise MessageError(_message(names, resolved, topic))
    indices = tuple(names.index(name) if name else None for name in resolved.names)
    signs = [-1.0 if name in resolved.inverted else 1.0 for name in resolved.names]
    torques = [sign / max(wanted.count(name), 1) for sign, name in zip(signs, resolved.names)]
    return WheelLayout(indices, four(signs), four(torques))


def resolved_joints(names: Sequence[str], joints: JointParams) -> JointParams:
    """
    Return the joints of the wheels in a message with ``names``.

    These are ``joints``, or if these are the defaults those that are recognized by their names.
    A message with all standard names is always understood.
    """
    if not joints.is_standard:
        return _standard(joints) if _is_standard(names) else joints
    found = recognized_joints(names)
    if found is None or not set(joints.inverted) <= set(found.names):
        return joints
    return replace(found, inverted=joints.inverted)


def _is_standard(names: Sequence[str]) -> bool:
    return all(names.count(wheel) == 1 for wheel in WHEELS)


def _standard(joints: JointParams) -> JointParams:
    """Return ``joints`` in a message of the drivers of this package, which has standard names."""
    given: dict[str, Any] = {wheel: wheel if measured else ''
                             for wheel, measured in zip(WHEELS, joints.measured)}
    return JointParams(**given)


def _message(names: Sequence[str], joints: JointParams, topic: str) -> str:
    wanted = ', '.join(dict.fromkeys(filter(None, joints.names)))
    return (f'{topic}: name is {list(names)}, expected each of {wanted} once'
            + (' (or other names in the parameters joints.*)' if joints.is_standard else ''))
