# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tables of a summary, and the text report made of them."""

import pytest

from smart_tire.analysis.tables import (
    error_tables, estimate_tables, friction_error_table, GROUND as GROUND_COLUMNS, lines, ROBOT,
    slip_error_table, Table, text)
from smart_tire.samples import GROUND_ESTIMATES

SCORE = {'count': 3, 'mean': 0.01, 'rms': 0.02, 'normalized_rms': 1.1, 'within_one': 0.7,
         'within_two': 0.95}
SLIP = {'estimated_mean': 0.11, 'true_mean': 0.1, 'error': SCORE}
FRICTION = {'crossings': 10, 'found': 9, 'informative': 8, 'informative_share': 0.8,
            'median_relative_error': 0.07, 'median_bias': -0.02,
            'fused_median_relative_error': 0.05, 'within_one': None, 'within_two': 0.9}
POSE = {'position_rms_m': 0.5, 'position_end_m': 0.75, 'position_max_m': 0.8,
        'end_percent_of_distance': 3.0, 'distance_m': 25.0, 'position_normalized_rms': None,
        'position_within_two': 0.9, 'drift_per_meter_m': 0.02,
        'yaw': SCORE, 'yaw_end_rad': -0.1, 'relative_position_rms_m': 0.01,
        'relative_yaw_rms_rad': 0.02, 'twist': dict.fromkeys(('v_x', 'v_y', 'yaw_rate'), SCORE)}
GROUND = {name: {'median': 0.5, 'median_sigma': None} for name in GROUND_ESTIMATES}
ESTIMATES = {
    'odom': {'distance_m': 25.1, 'end': {'x_m': 1.0, 'y_m': -2.0, 'yaw_rad': 0.5},
             'end_sigma': {'x_m': 0.1, 'y_m': 0.2, 'yaw_rad': 0.03}},
    'wheel_slip': {side: {'mean': 0.1, 'mean_sigma': None} for side in ('left', 'right')},
    'tire_friction': {'front_left': {'crossings': 20, 'informative': 15, 'median_single': 0.45,
                                     'last_fused': 0.46, 'last_fused_sigma': 0.03,
                                     'last_fused_s': 71.5}},
    'ground_state': {'grounds': [{'begin_s': begin, 'end_s': begin + 4.0, **GROUND}
                                 for begin in (1.0, 6.0)], **GROUND}}
SUMMARY = {
    'bag': 'field/run_3', 'duration_s': 80.04, 'host': None,
    'left_out': ['tire_samples is not in the bag'],
    'inputs': {'imu/data': {'messages': 8000, 'rate_hz': 100.0, 'gaps': 2, 'missing': 3,
                            'longest_gap_s': 0.5, 'late': 1, 'rejected': 0}},
    'estimates': ESTIMATES, 'against_truth': {'pose': POSE, 'baselines': {
        'wheels only': {**POSE, 'position_rms_m': 9.5, 'position_within_two': None}}}}


def test_an_unknown_value_is_a_dash():
    assert (text(None, '.2f'), text(0.126, '.2f'), text(0.126, '.0%')) == ('-', '0.13', '13%')


def test_columns_are_aligned_and_a_table_without_rows_has_no_text():
    table = Table('Title', ['name', 'kind', 'value'], [['a', 'xyz', '1.0'], ['bcd', 'x', '10']], 2)
    assert list(table.lines()) == [
        '\nTitle', '  name  kind  value', '  a     xyz     1.0', '  bcd   x        10']
    assert list(Table('Title', ['name'], []).lines()) == []


@pytest.mark.parametrize('expected', [
    ['imu/data', '8000', '100.0', '2', '3', '0.500', '1', '0'],
    ['skipped:', 'tire_samples', 'is', 'not', 'in', 'the', 'bag'],
    ['distance', 'traveled', '[m]', '25.10', '-'], ['y', 'at', 'the', 'end', '[m]', '-2.000',
                                                    '0.200'],
    ['yaw', 'at', 'the', 'end', '[rad]', '0.500', '0.030'], ['left', '0.1000', '-'],
    ['front', 'left', '20', '15', '0.450', '0.460', '0.030', '71.5'],
    ['1.0', '5.0', '0.5', '-', '0.500', '-', '0.5000', '-', '0.50', '-', '0.50', '-'],
    ['6.0', '10.0', '0.5', '-', '0.500', '-', '0.5000', '-', '0.50', '-', '0.50', '-'],
    ['true', 'over', 'measured', 'motor', 'torque', '[-]', '0.500', '-'],
    ['error', 'estimate', 'wheels', 'only'],
    ['position', 'error,', 'rms', '[m]', '0.500', '9.500'],
    ['position', 'error,', 'in', '2', 'σ', '90%', '-'],
    ['position', 'error', 'at', 'the', 'end', '[%', 'of', 'distance]', '3.00', '3.00'],
    ['heading', 'error,', 'rms', '[rad]', '0.0200', '0.0200'],
    ['yaw', 'rate', '[rad/s]', '+0.0100', '0.0200', '1.10', '70%', '95%']], ids=' '.join)
def test_the_text_has_inputs_estimates_and_errors(expected):
    assert next(lines(SUMMARY)) == 'field/run_3: 80.0 s'
    assert expected in [line.split() for line in lines(SUMMARY)]


def test_a_late_host_comes_before_gaps_and_late_messages():
    first, second, *rest = lines({**SUMMARY, 'host': 'host: late'})
    assert (first, second) == ('field/run_3: 80.0 s', 'host: late')
    assert list(lines(SUMMARY)) == [first, *rest]


def test_of_smoothed_estimates_only_what_differs_is_repeated():
    smoothed = {'estimates': {**ESTIMATES, 'odom': {**ESTIMATES['odom'], 'distance_m': 26.0}},
                'against_truth': SUMMARY['against_truth']}
    filtered, repeated = '\n'.join(lines({**SUMMARY, 'smoothed': smoothed})).split('RTS smoother')
    assert '26.00' in repeated and '25.10' in filtered
    assert 'Friction' not in repeated and 'Errors' not in repeated


def test_every_quantity_of_the_ground_is_in_one_of_its_tables():
    assert [key for _, key, _ in (*GROUND_COLUMNS, *ROBOT)] == list(GROUND_ESTIMATES)


def test_nothing_known_gives_no_tables():
    assert estimate_tables({'tire_friction': {}}) == error_tables({}) == []
    assert error_tables({'against_truth': {'pose': {**POSE, 'twist': None}}})[1].rows == []


def test_slip_and_friction_errors_have_a_row_for_each_interval():
    nothing = {**SLIP, 'error': {**SCORE, 'count': 0}}
    slips = slip_error_table({'whole recording': {'left': SLIP, 'front_left': SLIP},
                              'mu 0.30': {'left': SLIP, 'right': nothing}}, ('left', 'right'))
    assert slips.rows == [
        [surface, 'left', '0.1100', '0.1000', '+0.0100', '0.0200', '1.10', '70%', '95%']
        for surface in ('whole recording', 'mu 0.30')]
    friction = friction_error_table({
        'false_crossings': 2, 'stamp': {'mean_s': 0.0, 'sigma_s': 0.0},
        'whole recording': {'traction': FRICTION, 'braking': FRICTION}})
    assert friction.rows == [['whole recording', kind, '10', '9', '8', '7%', '-2%', '-', '90%',
                              '5%'] for kind in ('traction', 'braking')]
    assert '2 false crossings' in friction.title
