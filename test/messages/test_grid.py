# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction maps as OccupancyGrid: what is refused."""

from __future__ import annotations

import pytest
from smart_tire.bags.cdr import empty
from smart_tire.errors import MessageError
from smart_tire.messages.grid import grid_from_msg, grid_to_msg
from smart_tire.samples import FrictionGrid

GRID = FrictionGrid(5, 'map', 0.5, (-1.0, 2.0), 2, bytes([0, 47, 100, 255]))


def message():
    """Return the message of ``GRID``."""
    return grid_to_msg(empty('nav_msgs/msg/OccupancyGrid'), GRID)


def test_a_map_is_read_as_it_was_written_and_unknown_is_minus_one():
    assert list(message().data) == [0, 47, 100, -1]
    assert grid_from_msg(message()) == GRID


@pytest.mark.parametrize(('change', 'named'), [
    (lambda msg: setattr(msg.info, 'width', 3), 'expected 3 x 2'),
    (lambda msg: setattr(msg, 'data', [0, 101, 1, 2]), 'expected -1 to 100'),
    (lambda msg: setattr(msg, 'data', [0, -2, 1, 2]), 'expected -1 to 100'),
    (lambda msg: setattr(msg.info, 'resolution', float('nan')), 'info.resolution is nan'),
    (lambda msg: setattr(msg.info, 'resolution', 0.0), 'info.resolution is 0'),
    (lambda msg: setattr(msg.info.origin.orientation, 'z', 0.1), 'not rotated'),
    (lambda msg: setattr(msg.info.origin.position, 'x', float('inf')), 'finite')])
def test_a_map_that_is_inconsistent_or_rotated_is_refused(change, named):
    msg = message()
    change(msg)
    with pytest.raises(MessageError, match=named):
        grid_from_msg(msg)
