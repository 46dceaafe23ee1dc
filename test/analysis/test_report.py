"""The report says in words what the summary holds, and a dash for what is unknown."""

from smart_tire.analysis.report import (
    estimate_lines, lines, number, percent, table_lines, truth_lines)

SCORE = {'count': 3, 'mean': 0.01, 'rms': 0.02, 'normalised_rms': 1.1, 'within_one': 0.7,
         'within_two': 0.95}
SLIP = {'estimated_mean': 0.11, 'true_mean': 0.1, 'error': SCORE}
FRICTION = {'passages': 10, 'found': 9, 'telling': 8, 'telling_share': 0.8,
            'median_relative_error': 0.07, 'median_bias': -0.02,
            'fused_median_relative_error': 0.05, 'within_one': None, 'within_two': 0.9}
POSE = {'position_rms_m': 0.5, 'position_end_m': 0.75, 'end_percent_of_distance': 3.0,
        'distance_m': 25.0, 'position_normalised_rms': None, 'yaw': SCORE, 'yaw_end_rad': -0.1,
        'twist': None}
ESTIMATES = {
    'odom': {'distance_m': 25.1, 'end': {'x_m': 1.0, 'y_m': -2.0, 'yaw_rad': 0.5},
             'end_sigma': {'x_m': 0.1, 'y_m': 0.2, 'yaw_rad': 0.03}},
    'wheel_slip': {side: {'mean': 0.1, 'mean_sigma': None} for side in ('left', 'right')},
    'tire_friction': {'front_left': {'passages': 20, 'telling': 15, 'median_single': 0.45,
                                     'last_fused': 0.46, 'last_fused_sigma': 0.03}}}


def test_what_is_not_known_is_a_dash():
    assert (number(None, 2), percent(None)) == ('-', '-')
    assert (number(0.126, 2), percent(0.126)) == ('0.13', '13%')


def test_a_whole_summary_is_told_from_inputs_to_truth():
    text = '\n'.join(lines({
        'bag': 'field/run_3', 'duration_s': 80.04,
        'inputs': {'imu/data': {'messages': 8000, 'rate_hz': 100.0, 'gaps': 2, 'late': 1}},
        'left_out': ['tire_samples is not in the bag'], 'estimates': ESTIMATES,
        'against_truth': {'pose': POSE}}))
    assert text.startswith('field/run_3: 80.0 s\n')
    assert 'imu/data: 8000 messages at 100.0 Hz, 2 gaps, 1 late' in text
    assert 'left out: tire_samples is not in the bag' in text
    assert 'position error: 0.50 m rms, 0.75 m at the end (3.0 % of 25.0 m), - sigma' in text


def test_estimates_carry_their_sigmas():
    told = list(estimate_lines(ESTIMATES))
    assert told[0] == ('  odom: 25.1 m, ends at x 1.00 ± 0.10 m, y -2.00 ± 0.20 m, '
                       'yaw 0.50 ± 0.03 rad')
    assert told[1] == '  slip left: mean 0.100, mean sigma -'
    assert told[-1].endswith('20 passages, 15 tell it: median 0.45, last fused 0.46 ± 0.03')


def test_an_empty_tree_is_told_in_no_words():
    assert list(estimate_lines({'tire_friction': {}})) == []
    assert list(truth_lines(None)) == []


def test_slip_and_friction_stand_in_tables_with_a_row_for_each_span():
    nothing = {**SLIP, 'error': {**SCORE, 'count': 0}}
    told = list(table_lines({
        'slip': {'whole run': {'left': SLIP, 'right': SLIP},
                 'mu 0.30': {'left': SLIP, 'right': nothing}},
        'friction': {'false_passages': 2, 'stamp': {'mean_s': 0.0, 'sigma_s': 0.0},
                     'whole run': {'traction': FRICTION, 'braking': FRICTION}}}))
    assert [line.split() for line in told] == [
        [], ['mean', 'slip', 'side', 'estimate', 'truth', 'error', 'rms', 'in', '2', 'sigma'],
        ['whole', 'run', 'left', '0.110', '0.100', '+0.010', '0.020', '95%'],
        ['whole', 'run', 'right', '0.110', '0.100', '+0.010', '0.020', '95%'],
        ['mu', '0.30', 'left', '0.110', '0.100', '+0.010', '0.020', '95%'],
        [], ['friction', 'kind', 'passages', 'found', 'telling', '|error|', 'bias', '1', 'sigma',
             '2', 'sigma', 'fused'],
        ['whole', 'run', 'traction', '10', '9', '80%', '7%', '-2%', '-', '90%', '5%'],
        ['whole', 'run', 'braking', '10', '9', '80%', '7%', '-2%', '-', '90%', '5%'],
        ['false', 'passages:', '2']]
    assert len({len(line) for line in told[6:9]}) == 1  # columns stand under each other


def test_speed_errors_are_told_where_the_truth_has_a_twist():
    twist = dict.fromkeys(('v_x', 'v_y', 'yaw_rate'), SCORE)
    told = list(truth_lines({'pose': {**POSE, 'twist': twist}}))
    assert '  yaw_rate error: mean 0.0100, rms 0.0200 rad/s, 1.10 sigma' in told
