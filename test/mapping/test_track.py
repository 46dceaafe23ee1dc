# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction on the tracks of a drive, from its estimates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from smart_tire.estimation.ground.unknowns import TIME_ERROR
from smart_tire.mapping.track import (
    CHANGE_SIGMA, friction_track, FrictionTrack, ground_changes, SPACING, WALK)
from smart_tire.parameters import RobotParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import Friction, GroundState, NS_PER_S
from smart_tire.uncertain import Uncertain, UNKNOWN
from support.ideal_robot import odometry

ROBOT = RobotParams()
SPEED = 0.5  # m/s, along x
VARIANCE = 1e-4  # m2, rad2


def estimates(grounds=(), crossings=(), *, seconds=8.0):
    """Return the estimates of a straight drive."""
    found = SampleArrays(odometry(round(t * NS_PER_S), SPEED * t, v_x=SPEED, variance=VARIANCE)
                         for t in np.arange(0.0, seconds, 0.008))
    for one in (*grounds, *crossings):
        found.add_sample(one)
    return found


def ground(t, mu=0.4, *, sigma=0.05, common=0.03, left=math.inf, right=math.inf):
    """Return the state of the ground at ``t`` [s], which changed at ``left`` and ``right`` [s]."""
    ages = {f'change_age_{side}': t - at if at < t else math.inf
            for side, at in (('left', left), ('right', right))}
    friction = UNKNOWN if math.isnan(mu) else Uncertain(mu, sigma * mu)
    return GroundState(round(t * NS_PER_S), Uncertain(50.0, 2.0), friction,
                       friction_common_sigma=common, **ages)


def crossing(t, mu, wheel='front_right', sigma=0.05):
    """Return a patch crossing at ``t`` [s]."""
    value = UNKNOWN if math.isnan(mu) else Uncertain(mu, sigma * mu)
    return Friction(round(t * NS_PER_S), wheel, friction_coefficient=value)


def made(found) -> FrictionTrack:
    """Return the track of ``found``."""
    return friction_track(found.poses(), found.grounds(), found.frictions(), ROBOT)


def at(track, side, x):
    """Return the rows of a side of which the position is nearest to each of ``x`` [m]."""
    rows = np.flatnonzero(track.side == side)
    return rows[[np.argmin(np.abs(track.position[rows, 0] - one)) for one in np.atleast_1d(x)]]


def test_each_side_has_a_track_midway_between_its_wheels():
    track = made(estimates([ground(t) for t in np.arange(1.0, 8.0, 0.5)]))
    for side, y in ((0, 0.5 * ROBOT.track_width), (1, -0.5 * ROBOT.track_width)):
        own = track.position[track.side == side]
        np.testing.assert_allclose(own[:, 1], y)
        np.testing.assert_allclose(np.diff(own[:, 0]), SPACING, atol=0.005)
        # unknown before the first estimate and after the last one
        assert own[[0, -1], 0] == pytest.approx([0.5, 3.75], abs=SPACING)
    # x: an error of yaw moves the wheels forward and back
    np.testing.assert_allclose(track.covariance[:, 0], VARIANCE * (
        1.0 + (0.5 * ROBOT.track_width) ** 2))
    np.testing.assert_allclose(track.covariance[:, 2], VARIANCE)


def test_the_left_track_is_to_the_left_of_a_robot_in_any_direction():
    found = SampleArrays(odometry(round(t * NS_PER_S), 0.0, SPEED * t, 0.5 * math.pi, v_x=SPEED,
                                  variance=VARIANCE) for t in np.arange(0.0, 4.0, 0.008))
    for t in (1.0, 2.0, 3.0):
        found.add_sample(ground(t))
    track = made(found)
    half = 0.5 * ROBOT.track_width
    np.testing.assert_allclose(track.position[:, 0], np.where(track.side == 0, -half, half),
                               atol=1e-9)
    np.testing.assert_allclose(track.covariance[:, 0], VARIANCE)
    np.testing.assert_allclose(track.covariance[:, 2], VARIANCE * (1.0 + half ** 2))


def test_a_change_that_is_reported_again_is_one():
    grounds = [ground(t, 0.45 if t < 4.6 else 0.2, left=4.0 + 0.05 * (t > 5.2) if t >= 4.6
                      else math.inf) for t in np.arange(1.0, 7.0, 0.5)]
    grounds += [ground(7.0, 0.3, left=6.0)]
    changes, reported = ground_changes(estimates(grounds).grounds(), 0)
    assert (changes / NS_PER_S).tolist() == pytest.approx([4.0, 6.0])
    assert (reported / NS_PER_S).tolist() == pytest.approx([5.0, 7.0])
    assert not len(ground_changes(estimates(grounds).grounds(), 1)[0])


def test_between_changes_the_last_estimate_holds_until_the_next_ground():
    grounds = [ground(t, mu, left=at, right=at) for t, mu, at in (
        (1.0, 0.45, math.inf), (1.5, 0.45, math.inf), (2.0, math.nan, math.inf),
        (3.0, math.nan, 2.5), (3.5, 0.2, 2.5), (4.0, math.nan, 2.5), (5.0, 0.3, 4.5))]
    track = made(estimates(grounds, seconds=6.0))
    own = np.flatnonzero(track.side == 0)
    first, last = SPEED * (1.0 + np.array([0.0, 4.0]))
    assert track.position[own[[0, -1]], 0] == pytest.approx([first, last], abs=SPACING)
    assert np.diff(track.position[own, 0]).max() < 1.5 * SPACING
    for t, mu in ((2.1, 0.45), (2.9, 0.2), (4.1, 0.2), (4.9, 0.3)):
        assert track.friction[at(track, 0, SPEED * t)] == pytest.approx(mu)


def test_the_friction_is_that_of_the_crossings_and_without_films_that_of_the_ground():
    track = made(estimates([ground(t, 0.3) for t in np.arange(1.0, 8.0, 0.5)],
                           [crossing(t, 0.4 + 0.01 * t) for t in np.arange(1.0, 8.0)]))
    right, left = at(track, 1, 1.75), at(track, 0, 1.75)
    np.testing.assert_allclose(track.friction[right], 0.435, atol=0.0051)  # at 3.5 s
    np.testing.assert_allclose(track.friction[left], 0.3)
    np.testing.assert_allclose(track.sigma[right], 0.05 * track.friction[right])
    np.testing.assert_allclose(track.common[right], 0.03 * track.friction[right])


def test_a_border_is_where_the_ground_has_changed_although_this_was_known_later():
    change, known = 4.06, 5.5  # s; until then, estimates are those of the old ground
    grounds = [ground(t, 0.45 if t < known else 0.2, left=change if t >= known else math.inf,
                      right=change if t >= known else math.inf) for t in np.arange(1.0, 8.0, 0.5)]
    crossings = [crossing(t, 0.45 if t < known else 0.2) for t in np.arange(0.6, 8.0, 0.55)]
    track = made(estimates(grounds, crossings))
    for side in (0, 1):
        rows = at(track, side, SPEED * (change + 3.5 * np.array([-CHANGE_SIGMA, CHANGE_SIGMA])))
        np.testing.assert_allclose(track.friction[rows], [0.45, 0.2], rtol=1e-6)
        np.testing.assert_allclose(track.sigma[rows], 0.05 * track.friction[rows])
        assert track.block[rows[0]] != track.block[rows[1]]


def test_at_a_border_the_ground_is_either_of_both():
    change = 4.0
    track = made(estimates([ground(t, 0.45 if t < 4.6 else 0.2, **dict.fromkeys(
        ('left', 'right'), change if t >= 4.6 else math.inf)) for t in np.arange(1.0, 8.0, 0.5)]))
    apart = math.log(0.45 / 0.2)
    for sigmas, share in ((0.0, 0.5), (-1.0, 0.159), (1.0, 0.841), (2.0, 0.977)):
        (row,) = at(track, 0, SPEED * (change + sigmas * CHANGE_SIGMA))
        # 0.025 m between rows are half a standard deviation
        assert math.log(0.45 / track.friction[row]) == pytest.approx(share * apart, abs=0.09)
        expected = math.hypot(0.05, math.sqrt(share * (1.0 - share)) * apart)
        assert track.sigma[row] / track.friction[row] == pytest.approx(expected, abs=0.06)
    rows = np.flatnonzero(track.side == 0)
    rows = rows[np.abs(track.position[rows, 0] - SPEED * change) < 0.3]
    assert (np.diff(track.friction[rows]) < 1e-9).all()
    middle = track.sigma[rows] / track.friction[rows]
    assert middle[np.argmin(np.abs(track.friction[rows] - 0.3))] == pytest.approx(
        math.hypot(0.05, 0.5 * apart), abs=0.005)


def test_a_border_to_an_unknown_ground_is_unknown():
    change = 4.0
    track = made(estimates([ground(t, math.nan if t < 4.6 else 0.1, **dict.fromkeys(
        ('left', 'right'), change if t >= 4.6 else math.inf)) for t in np.arange(1.0, 8.0, 0.5)]))
    own = track.position[track.side == 0, 0]
    assert own.min() == pytest.approx(SPEED * (change + TIME_ERROR), abs=SPACING)
    np.testing.assert_allclose(track.friction, 0.1)


def test_a_change_under_one_side_is_none_under_the_other():
    change = 4.0
    grounds = [ground(t, 0.45 if t < 4.5 else 0.32, left=change if t >= 4.5 else math.inf)
               for t in np.arange(1.0, 7.0, 0.5)]
    crossings = [crossing(t, 0.45) for t in np.arange(0.6, 8.0, 0.55)] + [
        crossing(t, 0.45 if t < 4.5 else 0.2, 'rear_left') for t in np.arange(0.7, 8.0, 0.55)]
    track = made(estimates(grounds, crossings))
    left, right = at(track, 0, [1.8, 2.2]), at(track, 1, [1.8, 2.2])
    np.testing.assert_allclose(track.friction[left], [0.45, 0.2])
    np.testing.assert_allclose(track.friction[right], 0.45)
    # without films, the mean of two grounds is the friction of neither
    track = made(estimates(grounds))
    assert set(np.round(track.friction[track.side == 1], 6)) == {0.45}


def test_unknown_estimates_are_left_out_and_without_any_there_is_no_track():
    known = [crossing(t, 0.4) for t in (1.0, 1.5, 2.5, 3.0, 6.5, 7.0)]
    track = made(estimates([], [*known, crossing(2.0, math.nan)]))
    assert (track.side == 1).all()
    gaps = [(one, other) for one, other in zip(track.position[:, 0], track.position[1:, 0])
            if other - one > 2.0 * SPACING]
    np.testing.assert_allclose(gaps, [(0.75, 1.25), (1.5, 3.25)], atol=SPACING)  # 3 s: the window
    assert track.position[[0, -1], 0] == pytest.approx([0.5, 3.5], abs=SPACING)
    assert not len(made(estimates([], [crossing(1.0, math.nan)])))
    assert not len(made(SampleArrays()))


def test_errors_are_common_if_the_estimator_does_not_say_otherwise():
    states = [GroundState(round(t * NS_PER_S), Uncertain(50.0, 2.0), Uncertain(0.4, 0.02))
              for t in (1.0, 2.0)]
    track = made(estimates(states))
    np.testing.assert_allclose(track.common, 0.05 * 0.4)
    assert (track.sigma >= track.common).all()


def test_errors_are_independent_after_twice_their_correlation_length():
    own = math.sqrt(0.05 ** 2 - 0.045 ** 2)
    length = 2.0 * own ** 2 / WALK
    assert 1.0 < length < 3.0  # m, of 4
    track = made(estimates([ground(t, common=0.045) for t in np.arange(1.0, 8.0, 0.5)]))
    side = track.side == 0
    border = track.position[side, 0][np.flatnonzero(np.diff(track.block[side]))]
    np.testing.assert_allclose(border, np.arange(1, len(border) + 1) * length, atol=2 * SPACING)
    assert len(border) == int(3.75 / length)
