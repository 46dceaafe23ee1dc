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
