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
