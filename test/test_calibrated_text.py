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

"""Parameter files of a calibration: rounding, comments, and that the nodes read them."""

from __future__ import annotations

import pytest

from smart_tire.errors import ParameterError
from smart_tire.parameters import (
    build, known_names, load_files, load_robot, NODE_PARAMS, SlipEstimatorParams, specs,
    TrajectoryControllerParams, WheelControllerParams)
from smart_tire.parameters.calibrated_text import Calibrated, calibrated_text, rounded
from smart_tire.parameters.calibration_file import Identified


@pytest.mark.parametrize('value, sigma, expected', [
    (0.571975, 0.001705, (0.572, 0.0017)), (52.7499, 3.26, (52.7, 3.3)),
    (-0.0123456, 0.00099, (-0.01235, 0.00099)), (1234.5, 56.7, (1234.0, 57.0)),
    (0.12345, 0.0996, (0.12, 0.1)), (0.12345, 0.00996, (0.123, 0.01)),
    (0.0563, None, (0.056, None)), (5.0, 0.0, (5.0, 0.0)),
    ((298.04, 235.21), (4.23, 0.333), ((298.0, 235.21), (4.2, 0.33)))])
def test_values_have_the_places_of_two_digits_of_their_error(value, sigma, expected):
    assert rounded(value, sigma) == expected


def text():
    items = [Calibrated(Identified('tire.longitudinal_stiffness', 55.0486, 3.2967, 'on concrete'),
                        ('straight',)),
             Calibrated(Identified('encoder.stamp_jitter', 0.00005012, 0.0000031), ('a', 'b')),
             Calibrated(Identified('effective_track', 0.572477, 0.0017365), ('turns',)),
             Calibrated(Identified('icr_x', 0.0041, 0.0056), ('turns',))]
    return calibrated_text('2026-11-22', items, {'wheel_radius': (0.087, 'no reference')})


def test_each_value_has_date_standard_error_and_recordings():
    lines = text().splitlines()
    assert lines[0] == '# Calibrated on 2026-11-22 by smart_tire calibrate.'
    assert '# kept: wheel_radius: 0.087  (no reference)' in lines
    assert ('      longitudinal_stiffness: 55.0  # standard error 3.3 N, 2026-11-22, '
            'from straight, on concrete') in lines
    assert any('2026-11-22, from a and b' in line for line in lines)
    assert not any(line.lstrip().startswith('wheel_radius') for line in lines)


def test_the_nodes_read_the_values_back(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(text(), encoding='utf-8')
    robot = load_robot([path])
    assert robot.tire.longitudinal_stiffness == 55.0
    assert robot.encoder.stamp_jitter == 5.01e-05 and robot.wheel_radius == 0.087
    known = known_names(NODE_PARAMS.values())
    for node, cls, name, value in (
            ('wheel_controller', WheelControllerParams, 'effective_track', 0.5725),
            ('trajectory_controller', TrajectoryControllerParams, 'effective_track', 0.5725),
            ('slip_estimator', SlipEstimatorParams, 'icr_x', 0.0041)):
        assert getattr(build(cls, load_files([path], node, known, specs(cls))), name) == value


def test_a_calibration_without_values_is_a_comment():
    assert calibrated_text('2026-11-22', [], {}).count('\n') == 1


@pytest.mark.parametrize('item', [Identified('no_such', 1.0, 0.1),
                                  Identified('wheel_radius', -1.0, 0.1)])
def test_unknown_names_and_impossible_values_are_refused(item):
    with pytest.raises(ParameterError, match=item.name):
        calibrated_text('2026-11-22', [Calibrated(item, ('bag',))], {})
