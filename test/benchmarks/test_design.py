# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The bound of ``smart_tire design`` next to the estimator: one robot of a point."""

import math

from benchmarks.design import AWAY, bound, DESIGN, drawn, is_counted, POINTS, QUANTITIES, run_point
from benchmarks.scoring import combined
import numpy as np
from smart_tire.design.drive import DRIVES, Ground
from smart_tire.simulation.offline import EPOCH_NS

CONCRETE = Ground('concrete', 52.7, 0.47, 0.015)


def test_the_points_contain_the_layout_of_the_paper_and_are_ten():
    layout = POINTS['paper'].layout
    assert (layout.wheels, layout.films, layout.length, layout.spacing, layout.rate) == (
        1, 2, 0.020, 0.030, 400.0)
    assert len(POINTS) == 10


def test_errors_of_a_robot_are_of_the_size_of_the_bound():
    run, = run_point('four_wheels', 3001)
    figures = combined([run])
    least = bound(POINTS['four_wheels'], drawn(3001, AWAY)[1])
    for name, value in least._asdict().items():
        assert figures[f'bound.{name}'] == value
        assert 0.0 < figures[f'{name}.nees'] < 9.0
        assert figures[f'{name}.finite'] == 1.0
    assert len(run.errors['film_slip'].error) >= 8  # 3 s, four wheels


def test_the_table_has_the_ratio_of_error_and_bound():
    figures = {f'{name}.rms': 0.02 for name in QUANTITIES}
    figures |= {f'bound.{name}': 0.04 for name in QUANTITIES}
    figures |= {f'{name}.nees': 0.25 for name in QUANTITIES}
    table, = DESIGN.tables({'paper': figures}, None)
    cells = [list(column.cells)[0] for column in table.columns]
    assert cells[:4] == [POINTS['paper'].title, '4.00', '2.00', '0.50']


def test_the_bound_without_torque_is_larger():
    least = bound(POINTS['paper'], CONCRETE)
    assert bound(POINTS['paper_no_torque'], CONCRETE).friction > 1.2 * least.friction
    assert math.isfinite(bound(POINTS['coarse'], CONCRETE).contact_length)
    assert bound(POINTS['four_wheels'], CONCRETE).slip < least.slip


def test_crossings_near_a_change_of_the_set_points_do_not_count():
    stamps = EPOCH_NS + np.array([6.5, 7.1, 7.6, 8.0, 8.3, 9.0]) * 1e9
    assert is_counted(DRIVES['s_curves'], stamps).tolist() == [
        False, False, True, True, False, True]
    assert is_counted(DRIVES['turn'], stamps).tolist() == [False, *[True] * 5]


def test_the_drawn_ground_is_that_of_the_simulator():
    robot, ground = drawn(3002, AWAY)
    surface = robot.simulator.ground
    assert (*surface.stiffness, *surface.friction, *surface.drag) == ground[1:]
    assert ground != drawn(3003, AWAY)[1]
