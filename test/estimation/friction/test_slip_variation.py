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

import pytest

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.slip_variation import slip_variation, UNKNOWN_CHANGE_SIGMA

PATCH = 0.046  # m


def variation(speed_change):
    return slip_variation(
        PatchCrossing(0, 1, 0.5, 0.001, speed_change, 0.1, 0, 1, None), PATCH)


def test_in_steady_motion_the_variation_is_small():
    assert variation(0.0).change == (0.0, UNKNOWN_CHANGE_SIGMA)
    assert variation(0.0).residual == 0.0


def test_a_change_of_wheel_speed_increases_both_sigmas():
    steady, changing = variation(0.01), variation(0.21)
    assert changing.change.sigma > steady.change.sigma
    assert changing.residual == pytest.approx(0.05 * 0.2)
    assert steady.residual == 0.0
