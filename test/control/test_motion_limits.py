# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Limits of speed and yaw rate."""

from __future__ import annotations

from dataclasses import replace
import math

from hypothesis import given, strategies as st
import numpy as np
import pytest

from smart_tire.control.constants import LATERAL_SHARE, PLANNED_SHARE
from smart_tire.control.motion_limits import motion_limits, MotionLimits
from smart_tire.control.path_geometry import Segment
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.parameters.path_following import MotionLimitParams

LIMITS = MotionLimits(speed=1.0, acceleration=0.5, deceleration=0.4, lateral=0.6, yaw_rate=1.5,
                      yaw_acceleration=4.0)
PLANNED = PLANNED_SHARE * LIMITS.deceleration
LINE = Segment(np.array([0.0, 5.0]), np.array([0.0, 0.0]))


def line_and_circle(radius):
    """Return 3 m straight, then a half circle."""
    angle = np.linspace(0.0, math.pi, 500)
    return Segment(np.concatenate([np.linspace(0.0, 2.99, 300), 3.0 + radius * np.sin(angle)]),
                   np.concatenate([np.zeros(300), radius - radius * np.cos(angle)]))


@pytest.mark.parametrize(('curvature', 'speed'), [
    (0.0, 1.0), (0.5, 1.0), (1.0, math.sqrt(0.6)), (-1.0, math.sqrt(0.6)), (10.0, 0.15)])
def test_a_curve_is_limited_by_lateral_acceleration_and_yaw_rate(curvature, speed):
    assert LIMITS.curve_speed(curvature) == pytest.approx(speed)


@pytest.mark.parametrize('remaining', [0.0, 0.1, 0.5, 1.4])
def test_the_stop_at_the_end_is_reached_with_the_planned_deceleration(remaining):
    assert LIMITS.path_speed(LINE, 5.0 - remaining) == pytest.approx(
        math.sqrt(2.0 * PLANNED * remaining), abs=1e-6)


def test_the_speed_far_from_the_end_is_the_maximum():
    assert LIMITS.path_speed(LINE, 0.0) == LIMITS.path_speed(LINE, 3.4) == 1.0


def test_the_robot_slows_down_before_a_curve():
    segment, in_curve = line_and_circle(0.3), math.sqrt(0.6 * 0.3)
    assert LIMITS.path_speed(segment, 3.3) == pytest.approx(in_curve, rel=0.03)
    speeds = [LIMITS.path_speed(segment, s) for s in np.arange(1.0, 3.0, 0.02)]
    assert speeds[0] == 1.0
    drops = -np.diff(np.square(speeds)) / 0.02
    assert drops.max() <= 2.0 * PLANNED * 1.01
    assert speeds[-1] < 1.1 * in_curve


def test_a_sudden_curvature_is_limited_by_the_yaw_acceleration():
    segment = line_and_circle(0.5)
    slow = replace(LIMITS, yaw_acceleration=0.5, lateral=10.0, yaw_rate=10.0)
    rate = segment.curvature_rate.max()
    speeds = [slow.path_speed(segment, s) for s in segment.distance]
    assert min(speeds[:170]) == pytest.approx(math.sqrt(PLANNED_SHARE * 0.5 / rate), rel=1e-6)


@given(st.floats(0.0, 2.0), st.floats(0.0, 1.0), st.floats(0.001, 0.5))
def test_the_speed_changes_by_no_more_than_the_accelerations(wanted, last, dt):
    speed = LIMITS.next_speed(wanted, last, dt)
    assert last - 0.4 * dt - 1e-9 <= speed <= last + 0.5 * dt + 1e-9
    assert 0.0 <= speed <= 1.0
    if last - 0.4 * dt <= wanted <= min(last + 0.5 * dt, 1.0):
        assert speed == pytest.approx(wanted)


def test_a_lower_maximum_is_approached_with_the_deceleration():
    assert LIMITS.next_speed(2.0, 1.5, 0.1) == pytest.approx(1.46)


@given(st.floats(-5.0, 5.0), st.floats(-1.5, 1.5), st.floats(0.0, 1.0), st.floats(0.001, 0.5))
def test_the_yaw_rate_keeps_its_limits(wanted, last, speed, dt):
    rate = LIMITS.next_yaw_rate(wanted, last, speed, dt)
    assert abs(rate) <= 1.5
    assert abs(rate) * speed <= 0.6 + 1e-9
    if abs(last) * speed <= 0.6:
        assert abs(rate - last) <= 4.0 * dt + 1e-9


def test_in_reverse_the_lateral_acceleration_is_limited_too():
    assert LIMITS.next_yaw_rate(1.4, 1.4, -1.0, 0.1) == pytest.approx(0.6)


def test_friction_is_shared_by_lateral_and_longitudinal_acceleration():
    params = TrajectoryControllerParams(max_speed=0.7)
    limits = motion_limits(params, 0.3)
    assert math.hypot(limits.lateral, limits.deceleration) == pytest.approx(0.3)
    assert math.hypot(limits.lateral, limits.acceleration) == pytest.approx(0.3)
    assert limits.deceleration / limits.lateral == pytest.approx(
        math.sqrt(1.0 - LATERAL_SHARE ** 2) / LATERAL_SHARE)
    assert limits.speed == 0.7


def test_the_configured_limits_hold_on_good_ground():
    params = TrajectoryControllerParams(limits=MotionLimitParams(
        acceleration=0.1, deceleration=0.2, lateral_acceleration=0.3, yaw_rate=0.4,
        yaw_acceleration=0.5))
    assert motion_limits(params, 9.0) == MotionLimits(0.6, 0.1, 0.2, 0.3, 0.4, 0.5)
