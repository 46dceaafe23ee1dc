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

"""Total force of wheels with a common slip, and its inverse."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.models.tire.brush_tire import brush_force
from smart_tire.models.tire.shared_slip import linear_tire_force, MAX_FORCE_SHARE

STIFFNESS = 52.7  # N
LOADS = np.array([18.0, 18.0, 35.0, 35.0])[:, np.newaxis]  # N, of an accelerating robot


def total_force(slip, friction, loads=LOADS):
    return brush_force(slip, 0.0, friction, loads, STIFFNESS)[0].sum(axis=0)


@pytest.mark.parametrize('friction', [0.1, 0.47, 2.0])
def test_it_is_the_inverse_of_the_brush_tire(friction):
    slip = np.linspace(-0.9, 0.9, 61) * 3.0 * friction * LOADS.min() / STIFFNESS
    found = linear_tire_force(total_force(slip, friction), friction, LOADS)
    assert found / STIFFNESS == pytest.approx(slip, rel=1e-6)


def test_front_wheels_may_slide_fully_while_rear_wheels_adhere():
    slip = np.array([1.05 * 3.0 * 0.3 * LOADS.min() / STIFFNESS])
    found = linear_tire_force(total_force(slip, 0.3), 0.3, LOADS)
    assert found / STIFFNESS == pytest.approx(slip, rel=1e-6)


def test_a_small_force_is_shared_equally_without_sliding():
    found = linear_tire_force([0.01, -0.01], 0.47, LOADS)
    assert found == pytest.approx([0.0025, -0.0025], rel=1e-3)


def test_a_force_beyond_friction_is_limited():
    limit = MAX_FORCE_SHARE * 0.47 * LOADS.sum()
    found = linear_tire_force([limit, 3.0 * limit, -1e3 * limit], 0.47, LOADS)
    assert found == pytest.approx(found[0] * np.array([1.0, 1.0, -1.0]))
    assert np.isfinite(found).all()


def test_a_lifted_wheel_has_no_force():
    lifted = np.array([0.0, 0.0, 53.0, 53.0])[:, np.newaxis]
    others = linear_tire_force([4.0], 0.47, lifted[2:])
    assert linear_tire_force([4.0], 0.47, lifted) == pytest.approx(others)


def test_zero_force_means_zero_slip():
    assert linear_tire_force(np.zeros(3), 0.47, LOADS) == pytest.approx(np.zeros(3))
