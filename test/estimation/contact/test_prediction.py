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

"""Prediction of patch crossings from the wheel angle."""

from __future__ import annotations

import pytest

from smart_tire.estimation.contact.prediction import MAX_CROSSINGS_PER_STEP, MountPosition

CIRCUMFERENCE, REACH = 0.5466, 0.048
POSITION = 0.30


def learned(path, position=POSITION, times=2):
    mount = MountPosition(CIRCUMFERENCE, REACH)
    for _ in range(times):
        mount.update(position, path)
    return mount


def crossings(mount, *distances):
    """Return number and direction of the crossings up to each of ``distances``."""
    return [(round((crossing.position - POSITION) / CIRCUMFERENCE), crossing.direction)
            for i, distance in enumerate(distances)
            for crossing in mount.advance((i, distance))]


def test_each_revolution_is_one_crossing_in_either_direction():
    mount = learned([(0, 0.0), (1, 0.27)])
    assert crossings(mount, 0.36, 0.80, 0.95, 1.7) == [(0, 1), (1, 1), (2, 1)]
    assert crossings(mount, 1.3, 0.7, 0.0) == [(2, -1), (1, -1), (0, -1)]


def test_a_long_step_contains_several_crossings():
    mount = learned([(0, 0.0)])
    assert crossings(mount, 3.3 * CIRCUMFERENCE + POSITION) == [(0, 1), (1, 1), (2, 1), (3, 1)]


@pytest.mark.parametrize('direction', [1, -1])
def test_of_a_million_revolutions_only_the_latest_are_reported(direction):
    mount = learned([(0, 0.1)])
    mount.advance((0, 0.1))
    found = crossings(mount, direction * (10**6 + 0.1) * CIRCUMFERENCE)
    assert len(found) == MAX_CROSSINGS_PER_STEP
    assert found == [(found[0][0] + direction * i, direction)
                     for i in range(MAX_CROSSINGS_PER_STEP)]
    assert abs(found[-1][0]) == pytest.approx(10**6, abs=2)


@pytest.mark.parametrize('inside', [0.26, 0.30, 0.34])
def test_stopping_inside_and_rolling_back_is_not_a_crossing(inside):
    mount = learned([(0, 0.0)])
    assert crossings(mount, inside, 0.0, inside, 0.1) == []
    assert crossings(mount, 0.30, 0.27, 0.40) == [(0, 1)]


def test_a_start_inside_the_patch_is_not_a_crossing():
    mount = learned([(0, 0.30)])
    assert crossings(mount, 0.29, 0.40) == []
    assert crossings(mount, 0.9) == [(1, 1)]


def test_after_a_start_inside_the_next_crossing_is_found_even_from_a_point_inside():
    mount = learned([(0, 0.30), (1, 0.30 - CIRCUMFERENCE)], position=0.30 - CIRCUMFERENCE)
    assert crossings(mount, -0.30) == [(-1, -1)]


def test_the_first_detection_yields_the_crossings_just_before():
    mount = MountPosition(CIRCUMFERENCE, REACH)
    replaced, found = mount.update(
        POSITION + CIRCUMFERENCE, [(0, 0.0), (9, POSITION + CIRCUMFERENCE - 0.03)])
    assert not replaced
    assert [round((crossing.position - POSITION) / CIRCUMFERENCE) for crossing in found] == [0]
    assert mount.update(POSITION + CIRCUMFERENCE, []) == (False, [])


def test_one_contradicting_detection_is_ignored_and_two_replace_the_position():
    mount = learned([(0, 0.0)], times=5)
    assert mount.update(POSITION + 0.1, [(0, 0.0)]) == (False, [])
    assert mount.expected(POSITION) == pytest.approx(POSITION)
    assert mount.update(POSITION + 0.1, [(0, 0.0)]) == (True, [])
    assert mount.expected(POSITION) == pytest.approx(POSITION + 0.1)


def test_the_expected_position_is_the_nearest_one():
    mount = learned([(0, 0.0)])
    assert mount.expected(7.2 * CIRCUMFERENCE) == pytest.approx(
        POSITION + 7 * CIRCUMFERENCE, abs=0.5 * CIRCUMFERENCE)
    assert mount.trusted
    assert not MountPosition(CIRCUMFERENCE, REACH).trusted
