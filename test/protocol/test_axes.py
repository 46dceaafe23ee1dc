# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Conversion of vectors and attitudes between device axes and REP-103 axes."""

import math

from hypothesis import given, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol.axes import (
    checked_sample, flip_quaternion, flip_vector, sample_from_flipped)
from smart_tire.rotation import quaternion
from support.rotations import rotate

H = math.sqrt(0.5)
angles = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))


@pytest.mark.parametrize('ned, enu', [
    ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, H, H)),   # heading north: yaw 90 degrees in ENU
    ((0.0, 0.0, H, H), (0.0, 0.0, 0.0, 1.0)),   # heading east: yaw 0 in ENU
])
def test_yaw_is_zero_towards_east_in_enu(ned, enu):
    assert flip_quaternion(ned) == pytest.approx(enu, abs=1e-15)


@given(angles, st.tuples(*[st.floats(-10.0, 10.0)] * 3))
def test_a_vector_has_the_same_world_direction_in_both_conventions(euler, vector):
    """Body to NED, then to ENU, equals forward-left-up body to ENU."""
    attitude = quaternion(*euler)
    north, east, down = rotate(attitude, vector)
    converted = rotate(flip_quaternion(attitude), flip_vector(vector))
    assert converted == pytest.approx((east, north, -down), abs=1e-12)
    assert flip_quaternion(flip_quaternion(attitude)) == pytest.approx(attitude, abs=1e-15)


def test_specific_force_at_rest_is_positive_on_z_in_rep_103():
    sample = sample_from_flipped(7, (0.0, 0.0, -9.81), (0.1, 0.2, 0.3), None)
    assert sample.stamp_ns == 7
    assert sample.acceleration == pytest.approx((0.0, 0.0, 9.81))
    assert sample.rate == pytest.approx((0.1, -0.2, -0.3))
    assert sample.orientation is None


@pytest.mark.parametrize('name, bad', [('acceleration', 0), ('angular rate', 1),
                                       ('orientation', 2)])
@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_a_value_that_is_not_finite_is_refused_by_name(name, bad, value):
    parts = [(0.0, 0.0, 9.8), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)]
    parts[bad] = (value, *parts[bad][1:])
    with pytest.raises(FrameError, match=name):
        checked_sample(0, *parts)


@pytest.mark.parametrize('name, bad, limit', [
    ('acceleration', 0, 1000.0), ('angular rate', 1, 100.0), ('orientation', 2, 1.1)])
@pytest.mark.parametrize('index', [0, 2])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_value_that_no_sensor_measures_is_refused_by_name(name, bad, limit, index, sign):
    parts = [[0.0, 0.0, 9.8], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    parts[bad][index] = sign * limit
    assert checked_sample(0, *map(tuple, parts)).stamp_ns == 0
    parts[bad][index] = sign * math.nextafter(limit, math.inf)
    with pytest.raises(FrameError, match=f'{name} is .* expected magnitudes up to {limit:g}'):
        checked_sample(0, *map(tuple, parts))
