# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Odometry buffer: means between any two times."""

from __future__ import annotations

import pytest

from smart_tire.estimation.slip.odometry_buffer import HISTORY_LENGTH, Motion, OdometryBuffer


def filled():
    buffer = OdometryBuffer()
    buffer.restart(1.0)
    for k in range(1, 11):
        buffer.append(1.0 + 0.01 * k, Motion(float(k), 0.5, 0.9 * k, 1.1 * k))
    return buffer


def test_mean_over_whole_steps_is_the_mean_of_their_speeds():
    assert filled().mean(1.0, 1.1) == pytest.approx((5.5, 0.5, 4.95, 6.05))
    assert filled().mean(1.02, 1.04) == pytest.approx((3.5, 0.5, 3.15, 3.85))


def test_partial_steps_are_weighted_by_their_duration():
    assert filled().mean(1.025, 1.03).v_x == pytest.approx(3.0)
    assert filled().mean(1.015, 1.025).v_x == pytest.approx(2.5)


def test_the_last_step_is_extrapolated():
    assert filled().mean(1.1, 1.105).v_x == pytest.approx(10.0)


def test_there_is_no_mean_before_the_history_or_of_an_empty_interval():
    assert filled().mean(0.9, 1.05) is None
    assert filled().mean(1.05, 1.05) is None
    buffer = filled()
    for k in range(1000):
        buffer.append(1.11 + 0.01 * k, Motion(1.0, 0.0, 0.9, 1.1))
    assert buffer.mean(1.0, 1.1) is None
    assert buffer.mean(11.1 - HISTORY_LENGTH + 0.02, 11.1) == pytest.approx(
        (1.0, 0.0, 0.9, 1.1))
