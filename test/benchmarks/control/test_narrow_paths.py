# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Narrow paths in closed loop, on the plant of the models and on another one."""

from benchmarks.control.scenarios import OTHER, OURS, OWN, SHORT, TrackingCase, TRUE
from benchmarks.control.tracking import run_tracking
from benchmarks.scoring import combined, part_of
import pytest

pytestmark = pytest.mark.slow
SEED = 31  # not tuned on


@pytest.mark.parametrize(('path', 'plant'), [
    ('u_turn_30', OWN), *(pytest.param(*case, marks=pytest.mark.long) for case in (
        ('u_turn_30', OTHER), ('spiral', OWN), ('spiral', OTHER), ('reverse_parking', OWN),
        ('reverse_parking', OTHER)))])
def test_narrow_paths_are_tracked_better_than_by_ideal_kinematics(path, plant):
    ours, ideal = (part_of(combined([run_tracking(
        TrackingCase(path, 'concrete', TRUE, plant, kinematics), SEED)]), kinematics)
        for kinematics in (OURS, SHORT))
    assert ours['arrived']
    assert ours['control.rms'] < ideal['control.rms']
    assert ours['duration'] < 1.05 * ideal['duration']
    assert ours['yaw.rms'] < 1.2
    if plant == OWN:
        assert ours['control.rms'] < 0.012 and ours['control.max'] < 0.03
