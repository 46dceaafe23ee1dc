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

"""The text report of a summary."""

from smart_tire.analysis.report import (
    estimate_lines, lines, number, percent, table_lines, truth_lines)

SCORE = {'count': 3, 'mean': 0.01, 'rms': 0.02, 'normalized_rms': 1.1, 'within_one': 0.7,
         'within_two': 0.95}
SLIP = {'estimated_mean': 0.11, 'true_mean': 0.1, 'error': SCORE}
FRICTION = {'crossings': 10, 'found': 9, 'informative': 8, 'informative_share': 0.8,
            'median_relative_error': 0.07, 'median_bias': -0.02,
            'fused_median_relative_error': 0.05, 'within_one': None, 'within_two': 0.9}
POSE = {'position_rms_m': 0.5, 'position_end_m': 0.75, 'end_percent_of_distance': 3.0,
        'distance_m': 25.0, 'position_normalized_rms': None, 'yaw': SCORE, 'yaw_end_rad': -0.1,
        'twist': None}
ESTIMATES = {
    'odom': {'distance_m': 25.1, 'end': {'x_m': 1.0, 'y_m': -2.0, 'yaw_rad': 0.5},
             'end_sigma': {'x_m': 0.1, 'y_m': 0.2, 'yaw_rad': 0.03}},
    'wheel_slip': {side: {'mean': 0.1, 'mean_sigma': None} for side in ('left', 'right')},
    'tire_friction': {'front_left': {'crossings': 20, 'informative': 15, 'median_single': 0.45,
                                     'last_fused': 0.46, 'last_fused_sigma': 0.03}}}


def test_unknown_values_are_dashes():
    assert (number(None, 2), percent(None)) == ('-', '-')
    assert (number(0.126, 2), percent(0.126)) == ('0.13', '13%')


def test_the_report_covers_inputs_estimates_and_errors():
    text = '\n'.join(lines({
        'bag': 'field/run_3', 'duration_s': 80.04,
        'inputs': {'imu/data': {'messages': 8000, 'rate_hz': 100.0, 'gaps': 2, 'late': 1}},
        'left_out': ['tire_samples is not in the bag'], 'estimates': ESTIMATES,
        'against_truth': {'pose': POSE}}))
    assert text.startswith('field/run_3: 80.0 s\n')
    assert 'imu/data: 8000 messages at 100.0 Hz, 2 gaps, 1 late' in text
    assert 'skipped: tire_samples is not in the bag' in text
    assert 'position error: 0.50 m rms, 0.75 m at the end (3.0 % of 25.0 m), - sigma' in text


def test_estimates_are_printed_with_their_sigmas():
    printed = list(estimate_lines(ESTIMATES))
    assert printed[0] == ('  odom: 25.1 m, ends at x 1.00 ± 0.10 m, y -2.00 ± 0.20 m, '
                          'yaw 0.50 ± 0.03 rad')
    assert printed[1] == '  slip left: mean 0.100, mean sigma -'
    assert printed[-1].endswith(
        '20 crossings, 15 informative: median 0.45, last fused 0.46 ± 0.03')


def test_an_empty_tree_gives_no_lines():
    assert list(estimate_lines({'tire_friction': {}})) == []
    assert list(truth_lines(None)) == []


def test_slip_and_friction_tables_have_a_row_for_each_interval():
    nothing = {**SLIP, 'error': {**SCORE, 'count': 0}}
    printed = list(table_lines({
        'slip': {'whole recording': {'left': SLIP, 'right': SLIP},
                 'mu 0.30': {'left': SLIP, 'right': nothing}},
        'friction': {'false_crossings': 2, 'stamp': {'mean_s': 0.0, 'sigma_s': 0.0},
                     'whole recording': {'traction': FRICTION, 'braking': FRICTION}}}))
    assert [line.split() for line in printed] == [
        [], ['mean', 'slip', 'side', 'estimate', 'truth', 'error', 'rms', 'in', '2', 'sigma'],
        ['whole', 'recording', 'left', '0.110', '0.100', '+0.010', '0.020', '95%'],
        ['whole', 'recording', 'right', '0.110', '0.100', '+0.010', '0.020', '95%'],
        ['mu', '0.30', 'left', '0.110', '0.100', '+0.010', '0.020', '95%'],
        [], ['friction', 'kind', 'crossings', 'found', 'informative', '|error|', 'bias', '1',
             'sigma', '2', 'sigma', 'fused'],
        ['whole', 'recording', 'traction', '10', '9', '80%', '7%', '-2%', '-', '90%', '5%'],
        ['whole', 'recording', 'braking', '10', '9', '80%', '7%', '-2%', '-', '90%', '5%'],
        ['false', 'crossings:', '2']]
    assert len({len(line) for line in printed[6:9]}) == 1  # columns are aligned


def test_speed_errors_are_printed_if_the_truth_has_a_twist():
    twist = dict.fromkeys(('v_x', 'v_y', 'yaw_rate'), SCORE)
    printed = list(truth_lines({'pose': {**POSE, 'twist': twist}}))
    assert '  yaw_rate error: mean 0.0100, rms 0.0200 rad/s, 1.10 sigma' in printed
