# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Calibration files: nodes read the values back; errors and sources are comments."""

from __future__ import annotations

import pytest
from smart_tire.errors import ParameterError
from smart_tire.parameters import build, known_names, load_files, NODE_PARAMS
from smart_tire.parameters.calibration_file import Identified, identified_text
from smart_tire.paths import write_text

IDENTIFIED = [Identified('encoder.latency', 0.07833513, 0.0024, 'from turns'),
              Identified('encoder.stamp_jitter', 0.0000501, 0.0000031, '2026-11-22, from a'),
              Identified('wheel_radius', 0.28993, 0.0023),
              Identified('imu.rotation', (0.01, -0.02, 0.0), (0.006, 0.006, 0.0)),
              Identified('imu.gyro_noise', 0.0062), Identified('effective_track', 1.816, 0.016),
              Identified('icr_x', 0.0041)]
GIVEN_TO = {  # node -> parameters that it reads
    'slip_estimator': {'encoder.latency': 0.07833513, 'encoder.stamp_jitter': 5.01e-05,
                       'wheel_radius': 0.28993, 'imu.rotation': (0.01, -0.02, 0.0),
                       'imu.gyro_noise': 0.0062, 'icr_x': 0.0041},
    'wheel_controller': {'wheel_radius': 0.28993, 'effective_track': 1.816},
    'trajectory_controller': {'effective_track': 1.816}}


@pytest.mark.parametrize('node, expected', GIVEN_TO.items())
def test_nodes_read_a_calibration_file(node, expected, tmp_path):
    path = tmp_path / 'calibrated.yaml'
    write_text(path, identified_text(['from a test'], IDENTIFIED))
    cls = NODE_PARAMS[node]
    params = build(cls, load_files([path], node, known_names(NODE_PARAMS.values()),
                                   known_names([cls])))
    for name, value in expected.items():
        found = params if hasattr(params, name) else params.robot
        for part in name.split('.'):
            found = getattr(found, part)
        assert found == value


def test_each_value_has_standard_error_unit_and_note():
    lines = identified_text(['from a test'], IDENTIFIED).splitlines()
    assert lines[:3] == ['# from a test', '/**:', '  ros__parameters:']
    assert {'    wheel_radius: 0.28993  # standard error 0.0023 m',
            '      latency: 0.07833513  # standard error 0.0024 s, from turns',
            '      stamp_jitter: 0.0000501  # standard error 0.0000031 s, 2026-11-22, from a',
            '      gyro_noise: 0.0062  # rad/s',
            '      rotation: [0.01, -0.02, 0.0]  # standard error [0.006, 0.006, 0.0] rad'
            } <= set(lines)


def test_a_file_without_values_is_a_comment():
    assert identified_text(['nothing'], []) == '# nothing\n'


@pytest.mark.parametrize('value, sigma, expected', [
    (0.571975, 0.001705, (0.572, 0.0017)), (52.7499, 3.26, (52.7, 3.3)),
    (-0.0123456, 0.00099, (-0.01235, 0.00099)), (1234.5, 56.7, (1234.0, 57.0)),
    (0.12345, 0.0996, (0.12, 0.1)), (0.12345, 0.00996, (0.123, 0.01)),
    (0.0563, None, (0.056, None)), (5.0, 0.0, (5.0, 0.0)), (0.0, None, (0.0, None)),
    ((298.04, 235.21), (4.23, 0.333), ((298.0, 235.21), (4.2, 0.33)))])
def test_values_have_the_places_of_two_digits_of_their_error(value, sigma, expected):
    one = Identified('any', value, sigma, 'note').rounded()
    assert (one.value, one.sigma) == expected and one.note == 'note'


@pytest.mark.parametrize('item, message', [
    (Identified('wheel_raduis', 0.1), 'unknown parameter wheel_raduis'),
    (Identified('wheel_radius', -0.1), 'parameter wheel_radius: -0.1, expected 0.001 to 2 m'),
    (Identified('imu.rotation', (0.1, 0.2)), 'expected 3 numbers')])
def test_unknown_and_invalid_parameters_are_not_written(item, message):
    with pytest.raises(ParameterError, match=message):
        identified_text([], [item])


def test_an_unwritable_path_is_named(tmp_path):
    (tmp_path / 'file').touch()
    with pytest.raises(ParameterError, match='file/calibrated.*cannot be written'):
        write_text(tmp_path / 'file' / 'calibrated.yaml', '')
