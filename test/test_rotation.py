# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rotations: three forms of one thing agree, and turn the right way."""

from __future__ import annotations

import math

from hypothesis import given, strategies as st
import numpy as np
import pytest

from smart_tire.rotation import angles as angles_of, euler, matrix, quaternion

angles = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))


@given(angles)
def test_euler_angles_survive_the_round_trip(rpy):
    assert euler(quaternion(*rpy)) == pytest.approx(rpy, abs=1e-6)


@given(angles)
def test_matrix_and_quaternion_turn_alike(rpy):
    x, y, z, w = quaternion(*rpy)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross  # Rodrigues
    assert matrix(*rpy) == pytest.approx(turned, abs=1e-12)


@pytest.mark.parametrize('rpy, vector, turned', [
    ((0.0, 0.0, math.pi / 2), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),  # yaw: forward to the left
    ((0.0, math.pi / 2, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),  # pitch: nose down
    ((math.pi / 2, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),  # roll: left side up
])
def test_positive_angles_are_those_of_rep_103(rpy, vector, turned):
    assert matrix(*rpy) @ vector == pytest.approx(np.array(turned), abs=1e-15)


@given(angles)
def test_a_matrix_gives_its_angles_back(rpy):
    assert angles_of(matrix(*rpy)) == pytest.approx(rpy, abs=1e-6)
