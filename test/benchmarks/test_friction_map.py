# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction maps in the benchmark: a drive that slows down before ice which an earlier one met."""

from __future__ import annotations

from benchmarks.friction_map import bound_of, ICE_BEGIN, ice_scores, on_ice, true_friction
import numpy as np
import pytest
from smart_tire.control.constants import LATERAL_SHARE
from smart_tire.mapping.grid import friction_map

ICE = 0.08  # mu


@pytest.fixture(scope='module')
def first():
    """Return the drive that meets the ice, and its track."""
    return on_ice(1)


def test_the_ice_is_in_the_map_of_the_first_drive_and_nothing_else(first):
    cells = friction_map([first[1]]).cells
    assert len(cells) > 30
    assert np.mean(np.abs(cells.friction - ICE) < 2.0 * cells.sigma) > 0.95
    # before, straight on at one speed, nothing shows the friction: it is unknown, not that of ice
    assert ICE_BEGIN - 0.2 < cells.x.min() < ICE_BEGIN + 0.1


def test_a_drive_slows_down_before_ice_that_an_earlier_one_met(first):
    rows, track = first
    later, _ = on_ice(1, bound_of(track))  # with the noise of the first
    (before, bend, off), (slow, slow_bend, less) = ice_scores(rows), ice_scores(later)
    assert before > 0.78 and bend > 0.78  # at the largest speed, 0.8 m/s
    assert slow < 0.65 and slow_bend < 0.65 and less < off
    assert slow_bend ** 2 / 1.2 > 0.5 * LATERAL_SHARE * 0.7 * ICE * 9.81  # not needlessly slow
    assert later[-1, 2] == pytest.approx(1.2, abs=0.1)  # m, the end of the path


def test_the_truth_of_the_fields():
    mu, away = true_friction(np.array([7.9, 8.5, 16.0, 23.0]))
    assert mu.tolist() == [0.47, 0.25, 0.55, 0.47]
    assert away == pytest.approx([0.1, 0.5, 1.0, 1.0])
