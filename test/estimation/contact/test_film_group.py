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

"""Geometry of a group of films."""

from __future__ import annotations

import pytest

from smart_tire.estimation.contact.film_group import FilmGroup
from smart_tire.parameters import build, RobotParams


def test_offsets_are_from_the_common_center_and_reach_includes_all_films():
    robot = build(RobotParams, {
        'film.positions': (0.0, 0.03, 0.3, 0.34), 'film.stretch_gain': (1.0, 2.0, 3.0, 4.0),
        'film.bending_peak': (0.5,) * 4})
    group = FilmGroup.of(robot, 'front_right', (2, 3))
    assert group.gains == (3.0, 4.0)
    assert group.offsets == pytest.approx((-0.02, 0.02))
    assert group.half_crossing == pytest.approx(
        0.5 * (robot.tire.contact_length + robot.film.length))
    assert group.reach == pytest.approx(group.half_crossing + 0.02)


def test_a_film_as_long_as_the_patch_is_inside_for_a_small_distance():
    robot = RobotParams()
    robot = build(RobotParams, {'film.length': robot.tire.contact_length})
    assert FilmGroup.of(robot, 'front_right', (0,)).half_inside > 0.0
