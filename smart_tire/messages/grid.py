# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages of friction maps: OccupancyGrid with 100 times the friction coefficient."""

from __future__ import annotations

from array import array
from math import isfinite
from typing import Any

from smart_tire.errors import MessageError
from smart_tire.messages.header import bounded, checked_frame, finite, set_header, stamp_of
from smart_tire.samples import FrictionGrid, MAX_POSITION, NS_PER_S

TOPIC = 'friction_map'
MAX_VALUE, UNKNOWN = 100, 255  # of a byte; 255 is -1 in the message


def grid_from_msg(msg: Any) -> FrictionGrid:
    """Return the map in an OccupancyGrid; raise MessageError if it is rotated or inconsistent."""
    info, data = msg.info, msg.data  # of int8
    values: bytes = data.tobytes() if hasattr(data, 'tobytes') else bytes(
        value & UNKNOWN for value in data)
    if info.width * info.height != len(values):
        raise MessageError(f'{TOPIC}: data has {len(values)} numbers, expected '
                           f'{info.width} x {info.height}')
    if max({*values} - {UNKNOWN}, default=0) > MAX_VALUE:
        raise MessageError(f'{TOPIC}: data has numbers out of range, expected -1 to {MAX_VALUE}')
    resolution, turn = float(info.resolution), info.origin.orientation
    if not (isfinite(resolution) and resolution > 0.0) or turn.x or turn.y or turn.z:
        raise MessageError(f'{TOPIC}: info.resolution is {resolution:g}, expected a positive '
                           'number, and an origin that is not rotated')
    place = info.origin.position
    x, y = bounded(TOPIC, 'info.origin.position', finite(
        TOPIC, 'info.origin.position', (place.x, place.y)), MAX_POSITION, 'm')
    return FrictionGrid(stamp_of(msg), checked_frame(msg.header.frame_id, TOPIC), resolution,
                        (x, y), int(info.width), values)


def grid_to_msg(msg: Any, sample: FrictionGrid) -> Any:
    """Write ``sample`` into an OccupancyGrid and return it."""
    set_header(msg, sample.stamp_ns, sample.frame)
    info = msg.info
    info.map_load_time.sec, info.map_load_time.nanosec = divmod(sample.stamp_ns, NS_PER_S)
    info.resolution, info.width = sample.resolution, sample.columns
    info.height = len(sample.values) // max(sample.columns, 1)
    place, turn = info.origin.position, info.origin.orientation
    (place.x, place.y), place.z = sample.origin, 0.0
    turn.x, turn.y, turn.z, turn.w = 0.0, 0.0, 0.0, 1.0
    msg.data = array('b', sample.values)
    return msg
