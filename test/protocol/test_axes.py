"""Axes: what a turn in one frame is in the other."""

import math

from hypothesis import given, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol.axes import (
    checked_sample, flip_quaternion, flip_vector, sample_from_flipped)
from smart_tire.rotation import quaternion

H = math.sqrt(0.5)
angles = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))


def rotate(quaternion, vector):
    """Return ``vector`` turned from body to world axes."""
    x, y, z, w = quaternion
    a, b, c = vector
    t = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (a + w * t[0] + y * t[2] - z * t[1], b + w * t[1] + z * t[0] - x * t[2],
            c + w * t[2] + x * t[1] - y * t[0])


@pytest.mark.parametrize('ned, enu', [
    ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, H, H)),   # level, to the north: 90 degrees from east
    ((0.0, 0.0, H, H), (0.0, 0.0, 0.0, 1.0)),   # to the east: no turn at all
])
def test_headings_are_counted_from_east_in_enu(ned, enu):
    assert flip_quaternion(ned) == pytest.approx(enu, abs=1e-15)


@given(angles, st.tuples(*[st.floats(-10.0, 10.0)] * 3))
def test_a_vector_takes_the_same_way_in_both_frames(euler, vector):
    """Body to world in NED, then to ENU, is the same as first to the left-up body."""
    attitude = quaternion(*euler)
    north, east, down = rotate(attitude, vector)
    turned = rotate(flip_quaternion(attitude), flip_vector(vector))
    assert turned == pytest.approx((east, north, -down), abs=1e-12)
    assert flip_quaternion(flip_quaternion(attitude)) == pytest.approx(attitude, abs=1e-15)


def test_yaw_to_the_right_turns_the_nose_from_north_to_east():
    attitude = quaternion(0.0, 0.0, math.pi / 2.0)
    assert rotate(attitude, (1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0), abs=1e-15)


def test_gravity_reads_upwards_after_the_flip():
    sample = sample_from_flipped(7, (0.0, 0.0, -9.81), (0.1, 0.2, 0.3), None)
    assert sample.stamp_ns == 7
    assert sample.acceleration == pytest.approx((0.0, 0.0, 9.81))
    assert sample.rate == pytest.approx((0.1, -0.2, -0.3))
    assert sample.orientation is None


@pytest.mark.parametrize('name, bad', [('acceleration', 0), ('angular rate', 1),
                                       ('orientation', 2)])
@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_what_is_not_finite_is_refused_by_name(name, bad, value):
    parts = [(0.0, 0.0, 9.8), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)]
    parts[bad] = (value, *parts[bad][1:])
    with pytest.raises(FrameError, match=name):
        checked_sample(0, *parts)


@pytest.mark.parametrize('name, bad, limit', [
    ('acceleration', 0, 1000.0), ('angular rate', 1, 100.0), ('orientation', 2, 1.1)])
@pytest.mark.parametrize('place', [0, 2])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_what_no_sensor_measures_is_refused_by_name(name, bad, limit, place, sign):
    parts = [[0.0, 0.0, 9.8], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    parts[bad][place] = sign * limit
    assert checked_sample(0, *map(tuple, parts)).stamp_ns == 0
    parts[bad][place] = sign * math.nextafter(limit, math.inf)
    with pytest.raises(FrameError, match=f'{name} is .* expected at most {limit:g}'):
        checked_sample(0, *map(tuple, parts))
