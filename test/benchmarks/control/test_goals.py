# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Goals: errors of the localization that are known, and reports that are false."""

import math

from benchmarks.control.drawn import draw_robot
from benchmarks.control.goals import GoalErrors, LOCALIZATIONS, run_goal
import pytest
from smart_tire.control import constants
from smart_tire.samples import NS_PER_S
from support.ideal_robot import odometry


def test_a_point_ahead_moves_sideways_in_a_turn_and_a_jump_lasts():
    errors = GoalErrors(draw_robot(1), 0.1, (0.03, -0.04), NS_PER_S)
    first, later = (errors.located(odometry(stamp_ns, 1.0, yaw=0.5 * math.pi, yaw_rate=2.0))
                    for stamp_ns in (5, NS_PER_S + 5))
    assert first.position == pytest.approx((1.0, 0.1, 0.0))
    assert first.linear == pytest.approx((0.0, 0.2, 0.0))
    assert later.position == pytest.approx((1.03, 0.06, 0.0))


@pytest.mark.parametrize('name', ['as drawn', 'point 4.5 cm ahead'])
def test_a_goal_is_reached_within_the_tolerances(name):
    run, = run_goal(name, 1501, 'goals')
    assert name in LOCALIZATIONS and run.row == f'goals/{name}'
    assert (run.values['arrived'], run.values['false']) == (1.0, 0.0)
    assert run.values['miss'] < 0.05 and run.values['turn'] < 0.08


def test_a_false_report_is_counted(monkeypatch):
    monkeypatch.setattr(constants, 'ARRIVED_SHARE', 5.0)
    run, = run_goal('as drawn', 1656, 'goals')
    assert run.values['false'] == 1.0 and run.values['miss'] > 0.05
