"""Passes of the films through the whole patch, from the wheel's angle alone."""

from __future__ import annotations

import pytest

from smart_tire.estimation.contact.prediction import MOST_PASSES, MountPosition

ROUND, REACH = 0.5466, 0.048
PLACE = 0.30


def learned(path, place=PLACE, times=2):
    films = MountPosition(ROUND, REACH)
    for _ in range(times):
        films.sight(place, path)
    return films


def run(films, *distances):
    return [(round((p.place - PLACE) / ROUND), p.direction)
            for i, distance in enumerate(distances) for p in films.advance((i, distance))]


def test_each_turn_of_the_wheel_is_one_pass_in_either_direction():
    films = learned([(0, 0.0), (1, 0.27)])
    assert run(films, 0.36, 0.80, 0.95, 1.7) == [(0, 1), (1, 1), (2, 1)]
    assert run(films, 1.3, 0.7, 0.0) == [(2, -1), (1, -1), (0, -1)]


def test_a_long_step_passes_several_times():
    films = learned([(0, 0.0)])
    assert run(films, 3.3 * ROUND + PLACE) == [(0, 1), (1, 1), (2, 1), (3, 1)]


@pytest.mark.parametrize('direction', [1, -1])
def test_of_a_million_turns_only_the_latest_are_told(direction):
    films = learned([(0, 0.1)])
    films.advance((0, 0.1))
    told = run(films, direction * (10**6 + 0.1) * ROUND)
    assert len(told) == MOST_PASSES
    assert told == [(told[0][0] + direction * i, direction) for i in range(MOST_PASSES)]
    assert abs(told[-1][0]) == pytest.approx(10**6, abs=2)


@pytest.mark.parametrize('inside', [0.26, 0.30, 0.34])
def test_stopping_inside_and_rolling_back_is_no_pass(inside):
    films = learned([(0, 0.0)])
    assert run(films, inside, 0.0, inside, 0.1) == []
    assert run(films, 0.30, 0.27, 0.40) == [(0, 1)]


def test_a_start_inside_the_patch_is_no_pass():
    films = learned([(0, 0.30)])
    assert run(films, 0.29, 0.40) == []
    assert run(films, 0.9) == [(1, 1)]


def test_a_start_inside_is_left_behind_even_if_the_next_point_is_inside_again():
    films = learned([(0, 0.30), (1, 0.30 - ROUND)], place=0.30 - ROUND)
    assert run(films, -0.30) == [(-1, -1)]


def test_the_first_sighting_tells_of_the_passes_just_before():
    films = MountPosition(ROUND, REACH)
    moved, passes = films.sight(PLACE + ROUND, [(0, 0.0), (9, PLACE + ROUND - 0.03)])
    assert not moved
    assert [round((p.place - PLACE) / ROUND) for p in passes] == [0]
    assert films.sight(PLACE + ROUND, []) == (False, [])


def test_one_strange_sighting_moves_nothing_two_do():
    films = learned([(0, 0.0)], times=5)
    assert films.sight(PLACE + 0.1, [(0, 0.0)]) == (False, [])
    assert films.expected(PLACE) == pytest.approx(PLACE)
    assert films.sight(PLACE + 0.1, [(0, 0.0)]) == (True, [])
    assert films.expected(PLACE) == pytest.approx(PLACE + 0.1)


def test_the_place_is_that_nearest_to_where_the_wheel_is():
    films = learned([(0, 0.0)])
    assert films.expected(7.2 * ROUND) == pytest.approx(PLACE + 7 * ROUND, abs=0.5 * ROUND)
    assert films.trusted
    assert not MountPosition(ROUND, REACH).trusted
