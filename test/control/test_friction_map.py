# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Speed limits by the friction of a map ahead."""

from __future__ import annotations

from dataclasses import replace
import math

from hypothesis import given, strategies as st
import numpy as np
import pytest
from smart_tire.control.constants import LATERAL_SHARE
from smart_tire.control.ground_knowledge import allowed_acceleration, MappedGround
from smart_tire.control.motion_limits import motion_limits, MotionLimits
from smart_tire.control.path_geometry import REVERSE, Segment
from smart_tire.parameters import RobotParams
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.parameters.path_following import FrictionLimitParams

PARAMS = FrictionLimitParams()
ROBOT = RobotParams()
LIMITS = MotionLimits(speed=1.0, acceleration=0.5, deceleration=0.4, lateral=0.6, yaw_rate=5.0,
                      yaw_acceleration=50.0)
ICE = 0.06


def ice_from(begin, end=math.inf, mu=ICE, elsewhere=math.nan):
    """Return the ground with ice between ``begin`` and ``end`` [m] along x."""
    return MappedGround(lambda x, y, sigmas: np.where((x >= begin) & (x < end), mu, elsewhere),
                        PARAMS, ROBOT)


def line_and_circle(radius):
    """Return 3 m straight, then a half circle."""
    angle = np.linspace(0.0, math.pi, 500)
    return Segment(np.concatenate([np.linspace(0.0, 2.99, 300), 3.0 + radius * np.sin(angle)]),
                   np.concatenate([np.zeros(300), radius - radius * np.cos(angle)]))


CURVE = line_and_circle(0.8)
LINE = Segment(np.array([0.0, 6.0]), np.array([0.0, 0.0]))


def speeds(limits, segment):
    """Return the planned speeds [m/s] along ``segment``."""
    return np.array([limits.path_speed(segment, s) for s in segment.distance])


def test_a_curve_on_ice_is_driven_at_the_speed_that_its_friction_permits():
    found = speeds(replace(LIMITS, mapped=ice_from(2.5)), CURVE)
    allowed = LATERAL_SHARE * PARAMS.share * ICE * 9.80665
    in_curve = (CURVE.distance > 3.3) & (CURVE.distance < 5.0)
    assert (found[in_curve] ** 2 / 0.8).max() <= 1.03 * allowed
    assert found[in_curve].max() > 0.9 * math.sqrt(0.8 * allowed)
    assert found[0] == 1.0


def test_the_robot_slows_down_before_the_ice_with_what_the_ground_there_permits():
    # unknown ground until 2 m, ice from there on, and the curve begins at 3 m
    found = speeds(replace(LIMITS, mapped=ice_from(2.0)), CURVE)
    front = 2.0 - 0.5 * ROBOT.wheelbase
    drops = -np.diff(found ** 2) / np.diff(CURVE.distance)
    before = CURVE.distance[1:] < front - 0.02
    on_ice = (CURVE.distance[:-1] > 2.0) & (CURVE.distance[1:] < 3.0)
    braking = math.sqrt(1.0 - LATERAL_SHARE ** 2) * PARAMS.share * ICE * 9.80665
    assert drops[on_ice].max() <= 2.0 * 0.85 * braking * 1.01
    assert drops[on_ice].min() > 0.0
    assert 2.0 * 0.85 * braking * 1.5 < drops[before].max() <= 2.0 * 0.85 * 0.4 * 1.01


def test_the_end_of_a_path_on_ice_is_reached_with_its_friction():
    found = speeds(replace(LIMITS, mapped=ice_from(4.0)), LINE)
    braking = math.sqrt(1.0 - LATERAL_SHARE ** 2) * PARAMS.share * ICE * 9.80665
    left = 6.0 - LINE.distance
    on_ice = LINE.distance > 4.1
    np.testing.assert_allclose(found[on_ice], np.sqrt(2.0 * 0.85 * braking * left[on_ice]),
                               atol=0.02)
    assert found[-1] == 0.0 and found[0] == 1.0


def test_a_straight_over_a_patch_of_ice_is_driven_at_full_speed():
    assert (speeds(replace(LIMITS, mapped=ice_from(1.0, 2.0)), LINE)[:150] == 1.0).all()


@pytest.mark.parametrize('segment', [CURVE, LINE])
def test_an_unknown_cell_changes_nothing(segment):
    unknown = replace(LIMITS, mapped=ice_from(0.0, 0.0))
    np.testing.assert_allclose(speeds(unknown, segment), speeds(LIMITS, segment), rtol=1e-12)


@given(st.floats(-1.0, 5.0), st.floats(-2.0, 50.0), st.floats(-2.0, 50.0),
       st.floats(0.0, 5.5))
def test_a_map_never_raises_a_limit(begin, mu, elsewhere, distance):
    mapped = replace(LIMITS, mapped=ice_from(begin, begin + 1.0, mu, elsewhere))
    for segment in (CURVE, LINE):
        assert mapped.path_speed(segment, distance) <= LIMITS.path_speed(segment, distance)


@given(st.floats(-1e3, 1e3) | st.just(math.nan))
def test_the_allowed_acceleration_is_within_its_bounds(mu):
    found = ice_from(-1.0, 1.0, mu).acceleration(*np.zeros((3, 1)))[0]
    least = PARAMS.share * PARAMS.minimum * 9.80665
    assert found == math.inf if math.isnan(mu) else found >= least
    assert allowed_acceleration(0.0, PARAMS) == pytest.approx(least)


@pytest.mark.parametrize('yaw', [0.0, 0.5, math.pi, -2.0])
def test_the_wheel_with_the_least_friction_counts(yaw):
    half = 0.5 * np.array([ROBOT.wheelbase, ROBOT.track_width])
    for place in (half, -half, half * [1, -1], half * [-1, 1]):
        cos, sin = math.cos(yaw), math.sin(yaw)
        wheel = np.array([1.0 + cos * place[0] - sin * place[1],
                          2.0 + sin * place[0] + cos * place[1]])

        def bound(x, y, sigmas, wheel=wheel):
            assert sigmas == PARAMS.sigmas
            return np.where(np.hypot(x - wheel[0], y - wheel[1]) < 1e-9, ICE, np.nan)

        found = MappedGround(bound, PARAMS, ROBOT).acceleration(
            *(np.array([one]) for one in (1.0, 2.0, yaw)))
        assert found[0] == pytest.approx(PARAMS.share * ICE * 9.80665)


def test_a_path_in_reverse_is_limited_in_the_same_way():
    back = Segment(np.array([0.0, -6.0]), np.array([0.0, 0.0]), REVERSE)
    mapped = replace(LIMITS, mapped=MappedGround(
        lambda x, y, sigmas: np.where(x < -4.0, ICE, np.nan), PARAMS, ROBOT))
    np.testing.assert_allclose(speeds(mapped, back),
                               speeds(replace(LIMITS, mapped=ice_from(4.0)), LINE), atol=1e-6)


def test_limits_of_the_present_ground_are_those_without_a_map():
    params = TrajectoryControllerParams()
    assert motion_limits(params, 1.0).mapped is None
