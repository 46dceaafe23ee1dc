# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Prediction of patch crossings from the wheel angle, and their association with detections."""

import numpy as np
import pytest

from smart_tire.estimation.contact.constants import POSITION_GATE, REMEMBERED
from smart_tire.estimation.contact.prediction import (
    CrossingAssociator, MountPosition, PredictedCrossing)
from smart_tire.estimation.contact.records import (
    ActiveSegment, Detection, FilmCrossing, FilmGroup)
from smart_tire.parameters import build, RobotParams

GROUP = FilmGroup.of(RobotParams(), 'front_right', (0, 1))
GATE = POSITION_GATE * GROUP.film_length  # m
CIRCUMFERENCE = 0.5466
POSITION = 0.30  # m, of the films' common center
PREDICTED = PredictedCrossing(POSITION, 1, 10)


def film_crossing(film, *, error=0.0, direction=1, coverage=1.0, begin_ns=5):
    segment = ActiveSegment(film, begin_ns, begin_ns + 1, np.empty(0, np.int64), np.empty(0), 1.65)
    return FilmCrossing(POSITION + GROUP.offsets[film] + error, begin_ns, direction, 0.27,
                        Detection(0.0, 0.8, 0.1, 0.15, coverage), segment)


def associator(*crossings):
    found = CrossingAssociator(GROUP, CIRCUMFERENCE)
    for crossing in crossings:
        found.add_crossing(crossing, [(0, 0.0)])
    return found


@pytest.mark.parametrize('direction', [1, -1])
def test_the_best_detection_of_each_film_near_the_predicted_position_is_associated(direction):
    first, second = (film_crossing(film, error=error, coverage=0.9, direction=direction)
                     for film, error in ((0, 0.0), (1, 0.9 * GATE)))
    others = [film_crossing(0, coverage=0.5, direction=direction),
              film_crossing(0, direction=-direction),
              film_crossing(1, error=1.1 * GATE, direction=direction)]
    predicted = PredictedCrossing(POSITION, direction, 10)
    for order in ([first, second, *others], [*others, second, first]):
        found = associator(*order)
        assert found.detections(predicted) == {0: first, 1: second}
        assert found.complete(predicted)
    assert not associator(*others).complete(predicted)


def test_taken_and_dropped_detections_are_not_associated_again():
    both = associator(film_crossing(0, begin_ns=5), film_crossing(1, begin_ns=8))
    both.drop_before(6)
    assert set(both.take(PREDICTED)) == {1}
    assert both.detections(PREDICTED) == {}


def test_predicted_crossings_are_released_once():
    both = associator(film_crossing(0), film_crossing(1))
    both.predict([(20, 0.0), (30, 0.5)])
    released = both.release(lambda predicted: True)
    assert [predicted.direction for predicted in released] == [1]
    assert released[0].position == pytest.approx(POSITION)
    assert both.pending == []


def learned(path, position=POSITION, times=2):
    mount = MountPosition(GROUP, CIRCUMFERENCE)
    for _ in range(times):
        mount.correct(position, path)
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


@pytest.mark.parametrize('direction', [1, -1])
def test_of_a_million_revolutions_only_the_latest_are_reported(direction):
    mount = learned([(0, 0.1)])
    mount.advance((0, 0.1))
    found = crossings(mount, direction * (10**6 + 0.1) * CIRCUMFERENCE)
    assert len(found) == REMEMBERED
    assert found == [(found[0][0] + direction * i, direction)
                     for i in range(REMEMBERED)]
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
    mount = MountPosition(GROUP, CIRCUMFERENCE)
    replaced, found = mount.correct(
        POSITION + CIRCUMFERENCE, [(0, 0.0), (9, POSITION + CIRCUMFERENCE - 0.03)])
    assert not replaced
    assert [round((crossing.position - POSITION) / CIRCUMFERENCE) for crossing in found] == [0]
    assert mount.correct(POSITION + CIRCUMFERENCE, []) == (False, [])


def test_one_contradicting_detection_is_ignored_and_two_replace_the_position():
    mount = learned([(0, 0.0)], times=5)
    assert mount.correct(POSITION + 0.1, [(0, 0.0)]) == (False, [])
    assert mount.expected(POSITION) == pytest.approx(POSITION)
    assert mount.correct(POSITION + 0.1, [(0, 0.0)]) == (True, [])
    assert mount.expected(POSITION) == pytest.approx(POSITION + 0.1)


def test_the_expected_position_is_the_nearest_one():
    mount = learned([(0, 0.0)])
    assert mount.expected(7.2 * CIRCUMFERENCE) == pytest.approx(
        POSITION + 7 * CIRCUMFERENCE, abs=0.5 * CIRCUMFERENCE)
    assert mount.trusted
    assert not MountPosition(GROUP, CIRCUMFERENCE).trusted


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
