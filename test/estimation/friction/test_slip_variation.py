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

"""Variation of slip within a crossing."""

from __future__ import annotations

import math

import pytest

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.motion_history import WheelMotion
from smart_tire.estimation.friction.slip_variation import (
    estimated_variation, MIN_CHANGE_SIGMA, UNKNOWN_CHANGE_SIGMA, unknown_variation)

PATCH, SPEED, DISTANCE = 0.046, 0.5, 0.1


def crossing(speed_change):
    return PatchCrossing(0, 1, SPEED, 0.001, speed_change, DISTANCE, 0, 1, None)


def test_in_steady_motion_the_variation_is_small():
    variation = estimated_variation(crossing(0.0), WheelMotion(), PATCH)
    assert variation.change == (0.0, MIN_CHANGE_SIGMA)
    assert variation.residual == 0.0
    assert unknown_variation(crossing(0.0), PATCH).change == (0.0, UNKNOWN_CHANGE_SIGMA)


def test_the_change_is_the_slip_rate_over_a_contact_length():
    variation = estimated_variation(
        crossing(0.0), WheelMotion(slip_rate=0.2, slip_residual=0.003), PATCH)
    assert variation.change.value == pytest.approx(0.2 * PATCH / SPEED)
    assert variation.change.sigma == pytest.approx(
        math.hypot(MIN_CHANGE_SIGMA, 0.5 * variation.change.value))
    assert variation.residual == 0.003


@pytest.mark.parametrize('variation', [
    lambda one: estimated_variation(one, WheelMotion(), PATCH),
    lambda one: unknown_variation(one, PATCH)])
def test_a_change_of_wheel_speed_increases_both_sigmas(variation):
    steady, changing = variation(crossing(0.01)), variation(crossing(0.21))
    assert changing.change.sigma > steady.change.sigma
    assert changing.residual == pytest.approx(0.05 * 0.2)
    assert steady.residual == 0.0
