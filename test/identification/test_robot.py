# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reading of bags for the calibration of a robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smart_tire.analysis.drawing import save_all
from smart_tire.calibration.geometry import Geometry, identify_geometry, LATENCY, RADIUS
from smart_tire.errors import BagError, EstimatorError
from smart_tire.identification.figures import geometry_figure
from smart_tire.identification.robot import ANY_REFERENCE, known, read_recording, TimeRange
from smart_tire.parameters import build, RobotParams
from support.identifying import turning_run, write_run

ROBOT = RobotParams()


@pytest.fixture(scope='module')
def run():
    return turning_run(12, 40.0, wheel_latency=0.07)


@pytest.fixture(scope='module')
def bag(run, tmp_path_factory):
    return write_run(tmp_path_factory.mktemp('identified') / 'run', run, 'ground_truth/odom')


def test_what_is_not_given_is_unknown_and_what_is_given_stays():
    robot = build(RobotParams, {'mass': 30.0, 'track_width': 0.6, 'wheelbase': 0.5})
    alone = known(robot, {'mass', 'track_width', 'wheelbase'})
    assert alone.imu.position_sigma == 1.0
    assert alone.center_of_mass_sigma == pytest.approx((0.1, 0.12))
    assert alone.yaw_inertia == pytest.approx(
        0.35 * 30.0 / 10.9 * (0.6 ** 2 + 0.5 ** 2) / (0.38 ** 2 + 0.26 ** 2))
    given = {'imu.position', 'center_of_mass', 'yaw_inertia'}
    assert known(robot, given) == robot
    assert known(robot, {'imu.position_sigma', 'center_of_mass_sigma', 'yaw_inertia'}) == robot
    default = known(RobotParams(), ())
    assert default.yaw_inertia == pytest.approx(RobotParams().yaw_inertia)


def test_only_the_given_time_range_is_read(bag):
    recording = read_recording(bag, ROBOT, TimeRange(10.0, 20.0), ANY_REFERENCE)
    for time in (recording.imu.time, recording.wheels.time, recording.reference.time):
        assert 10.0 <= time[0] < 10.1 and 19.9 < time[-1] <= 20.0
    found = identify_geometry(read_recording(bag, ROBOT, TimeRange(0.0, 2.5)), ROBOT)
    assert LATENCY in found.refused and RADIUS in found.refused
    assert found.get('gyro noise') is not None


def test_imu_samples_are_rotated_into_the_axes_of_the_robot(bag):
    turned = build(RobotParams, {'imu.rotation': [np.pi, 0.0, 0.0]})
    upright = read_recording(bag, ROBOT, TimeRange())
    upside_down = read_recording(bag, turned, TimeRange())
    assert upside_down.imu.force == pytest.approx(upright.imu.force * [1.0, -1.0, -1.0])
    assert upside_down.imu.rate == pytest.approx(upright.imu.rate * [1.0, -1.0, -1.0])


def test_the_reference_can_be_found_named_or_omitted(run, bag, tmp_path):
    assert read_recording(bag, ROBOT, TimeRange()).reference is None
    with pytest.raises(BagError, match='has no overhead/odom'):
        read_recording(bag, ROBOT, TimeRange(), 'overhead/odom')
    camera = write_run(tmp_path / 'camera', run, 'overhead/odom')
    assert read_recording(camera, ROBOT, TimeRange(), ANY_REFERENCE).reference is not None
    assert read_recording(camera, ROBOT, TimeRange(), '/overhead/odom').reference is not None


def test_a_bag_with_too_few_inputs_is_rejected(run, tmp_path):
    few = replace(run, samples=run.samples[:30])
    with pytest.raises(EstimatorError, match='messages on wheel_states, expected at least 20'):
        read_recording(write_run(tmp_path / 'short', few), ROBOT, TimeRange())


def test_a_figure_is_written_if_there_is_a_fit(bag, tmp_path):
    found = identify_geometry(read_recording(bag, ROBOT, TimeRange()), ROBOT)
    [path] = save_all([geometry_figure(found), geometry_figure(Geometry())], tmp_path / 'new')
    assert path.name == 'geometry.png' and path.read_bytes().startswith(b'\x89PNG')
