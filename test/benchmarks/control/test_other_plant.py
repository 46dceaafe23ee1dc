# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tests of the plant that contradicts the models of the software."""

from benchmarks.control.other_plant import other_robot, OtherPlant, peak_slip
import numpy as np
import pytest
from smart_tire.parameters import RobotParams, SimulatorParams
from smart_tire.simulation.plant import SurfaceMap

CONCRETE = 0.47, 26.7, 52.7  # mu, F_z [N], C_x [N]


def test_the_force_rises_with_the_stiffness_and_falls_beyond_its_peak():
    slip = np.linspace(1e-3, 3.0, 3000)
    force = np.array([one * OtherPlant.tire_slope(one, *CONCRETE) for one in slip])
    assert OtherPlant.tire_slope(1e-6, *CONCRETE) == pytest.approx(52.7, rel=1e-3)
    assert force.max() == pytest.approx(0.47 * 26.7, rel=1e-4)
    assert slip[force.argmax()] == pytest.approx(peak_slip(*CONCRETE), abs=2e-3)
    assert force[-1] < 0.75 * force.max()


def test_a_wheel_without_load_has_no_force():
    assert OtherPlant.tire_slope(0.1, 0.47, 0.0, 52.7) == 0.0


def test_a_robot_that_coasts_sideways_slows_down_less_than_one_on_isotropic_tires():
    params = SimulatorParams()
    lost = []
    for kind in (OtherPlant, OtherPlant.__base__):
        plant = kind(other_robot(RobotParams()), params.drive, SurfaceMap(params.ground))
        plant.v_y = 0.3
        for _ in range(20):
            plant.step((0.0,) * 4)
        assert abs(plant.v_y) < 0.3
        lost.append(0.3 - plant.v_y)
    assert lost[0] == pytest.approx(0.6 * lost[1], rel=0.2)
