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

"""Paths as bytes: the same as from the message, bounded, and any other bytes are refused."""

from __future__ import annotations

import math
import random
import struct

import pytest
from smart_tire.errors import MessageError
from smart_tire.messages import path_from_bytes
from smart_tire.samples import NAN, PlannedPath

LIMIT = 100
POSES = ((1.0, 2.0, 0.5), (3.0, -4.0, -3.0), (0.0, 0.0, NAN))


def serialized(poses=POSES, frame='odom', order='<', count=None):
    """Return a Path as CDR, written from the specification."""
    body = b''

    def align(size):
        return bytes(-len(body) % size)

    def header(text):
        data = text.encode() + b'\0'
        return align(4) + struct.pack(order + 'iII', 1, 5, len(data)) + data

    body += header(frame)
    body += align(4) + struct.pack(order + 'I', len(poses) if count is None else count)
    for x, y, yaw in poses:
        body += header(frame)
        turn = (0.0, 0.0) if math.isnan(yaw) else (math.sin(0.5 * yaw), math.cos(0.5 * yaw))
        body += align(8) + struct.pack(order + '7d', x, y, 0.0, 0.0, 0.0, *turn)
    return {'<': b'\0\1\0\0', '>': b'\0\0\0\0'}[order] + body


@pytest.mark.parametrize('order', '<>')
@pytest.mark.parametrize('frame', ['', 'odom', 'a_map', 'robot/odom'])
def test_a_path_is_read_in_both_byte_orders_with_any_alignment(order, frame):
    path = path_from_bytes(serialized(order=order, frame=frame), LIMIT)
    assert (path.stamp_ns, path.frame) == (1_000_000_005, frame)
    assert [pose[:2] for pose in path.poses] == [pose[:2] for pose in POSES]
    assert path.poses[1][2] == pytest.approx(-3.0)
    assert math.isnan(path.poses[2][2])


def test_the_bytes_of_ros_are_read():
    serialization = pytest.importorskip('rclpy.serialization')
    from smart_tire.messages.path import path_to_msg
    from smart_tire.nodes.compat import message_class
    message = path_to_msg(message_class('nav_msgs/msg/Path')(), PlannedPath(
        1_000_000_005, 'odom', POSES))
    data = serialization.serialize_message(message)
    assert repr(path_from_bytes(data, 3)) == repr(path_from_bytes(serialized(), 3))


@pytest.mark.parametrize('count', [LIMIT + 1, 20_000, 2**32 - 1])
def test_too_many_poses_are_refused_by_their_number_before_they_are_read(count):
    with pytest.raises(MessageError, match=rf'path: {count} poses, expected at most 100 '):
        path_from_bytes(serialized(count=count), LIMIT)


def test_a_field_that_is_not_allowed_is_named():
    with pytest.raises(MessageError, match=r'poses\[1\].pose.position is \[nan'):
        path_from_bytes(serialized(((0.0, 0.0, 0.0), (NAN, 0.0, 0.0))), LIMIT)


def test_every_truncation_is_refused():
    data = serialized()
    for size in range(len(data)):
        with pytest.raises(MessageError, match='path: '):
            path_from_bytes(data[:size], LIMIT)


def test_damaged_bytes_give_a_path_or_are_refused():
    data, rng = serialized(), random.Random(3)
    refused = 0
    for _ in range(3000):
        damaged = bytearray(data)
        for _ in range(rng.randint(1, 4)):
            damaged[rng.randrange(len(data))] = rng.randrange(256)
        try:
            path_from_bytes(bytes(damaged), LIMIT)
        except MessageError:
            refused += 1
    assert 500 < refused < 3000


@pytest.mark.parametrize('data', [b'', b'\0', b'\0\7\0\0' + bytes(100), b'garbage' * 100])
def test_other_encapsulations_are_refused(data):
    with pytest.raises(MessageError, match='encapsulation is .*, expected 0000 or 0001'):
        path_from_bytes(data, LIMIT)
