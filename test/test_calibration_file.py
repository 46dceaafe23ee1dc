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

"""Calibration files: values are read back, standard errors are comments."""

from __future__ import annotations

import pytest

from smart_tire.errors import ParameterError
from smart_tire.parameters import build, known_names, load_files, NODE_PARAMS, RobotParams
from smart_tire.parameters.calibration_file import Identified, identified_text, write_text

IDENTIFIED = [Identified('encoder.latency', 0.07833513, 0.0024, 'from turns'),
              Identified('wheel_radius', 0.28993, 0.0023),
              Identified('imu.rotation', (0.01, -0.02, 0.0), (0.006, 0.006, 0.0)),
              Identified('imu.gyro_noise', 0.0062), Identified('effective_track', 1.816, 0.016)]


def test_nodes_read_a_calibration_file(tmp_path):
    path = tmp_path / 'calibrated.yaml'
    write_text(path, identified_text(['from a test'], IDENTIFIED))
    known = known_names(NODE_PARAMS.values())
    robot = build(RobotParams, load_files(
        [path], 'slip_estimator', known, known_names([RobotParams])))
    assert robot.encoder.latency == 0.07833513
    assert robot.imu.rotation == (0.01, -0.02, 0.0)
    assert robot.wheel_radius == 0.28993 and robot.imu.gyro_noise == 0.0062
    track = load_files([path], 'wheel_controller', known, ['effective_track'])
    assert track == {'effective_track': 1.816}


def test_each_value_has_standard_error_and_unit():
    lines = identified_text(['from a test'], IDENTIFIED).splitlines()
    assert lines[:3] == ['# from a test', '/**:', '  ros__parameters:']
    assert '    wheel_radius: 0.28993  # standard error 0.0023 m' in lines
    assert '      latency: 0.07833513  # standard error 0.0024 s, from turns' in lines
    assert '      gyro_noise: 0.0062  # rad/s' in lines


@pytest.mark.parametrize('item, message', [
    (Identified('wheel_raduis', 0.1), 'unknown parameter wheel_raduis'),
    (Identified('wheel_radius', -0.1), 'parameter wheel_radius: -0.1, expected 0.001 to 2 m'),
    (Identified('imu.rotation', (0.1, 0.2)), 'expected 3 numbers')])
def test_unknown_and_invalid_parameters_are_not_written(item, message):
    with pytest.raises(ParameterError, match=message):
        identified_text([], [item])


def test_an_unwritable_path_is_named(tmp_path):
    with pytest.raises(ParameterError, match='nowhere.*cannot be written'):
        write_text(tmp_path / 'nowhere' / 'calibrated.yaml', '')
