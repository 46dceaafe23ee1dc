"""Offline analysis: the same estimates as live, from whatever inputs a bag holds."""

from collections import Counter
from dataclasses import replace
import json
import math

import numpy as np
import pytest

from smart_tire.analysis.offline import analyze
from smart_tire.analysis.pipeline import ESTIMATES, EstimatorParams, INPUTS, Pipeline, TRUTHS
from smart_tire.analysis.series import Series
from smart_tire.analysis.summary import WHOLE
from smart_tire.bags import Bag
from smart_tire.errors import BagError, ParameterError
from smart_tire.messages import topic_of
from smart_tire.samples import NS_PER_S, Odometry, WheelSlip

pytestmark = pytest.mark.slow

GRID_NS = 8_000_000


@pytest.fixture(scope='module')
def params(tmp_path_factory):
    path = tmp_path_factory.mktemp('params') / 'robot.yaml'
    path.write_text('/**: {ros__parameters: {film: {wheels: [front_left, front_right]}}}')
    return EstimatorParams.load([path])


@pytest.fixture(scope='module')
def analyzed(drive_bag, params, tmp_path_factory):
    """Return folder and run of the whole drive."""
    out = tmp_path_factory.mktemp('analyzed') / 'deep' / 'out'
    return out, analyze(drive_bag, out, params)


@pytest.fixture(scope='module')
def smoothed(drive_bag, params, tmp_path_factory):
    """Return folder and run of the whole drive with the smoother, and the shares of progress."""
    out, shares = tmp_path_factory.mktemp('smoothed') / 'out', []
    return out, analyze(drive_bag, out, params, shares.append, smooth=True), shares


def of_topics(events, *topics):
    return [event for event in events if event[1] in topics]


def left_out(run):
    return '\n'.join(run.intake.left_out)


def test_the_estimates_in_the_bag_are_those_of_the_estimators(analyzed, drive, params):
    pipeline = Pipeline(params)
    expected = [(receive_ns, topic_of(estimate), estimate) for receive_ns, topic, sample in drive
                if topic in INPUTS for estimate in pipeline.update(sample)]
    with Bag(analyzed[0] / 'estimates') as bag:
        written = list(bag.samples(ESTIMATES))
    assert Counter(topic for _, topic, _ in written) == Counter(t for _, t, _ in expected)
    assert {topic for _, topic, _ in written} == set(ESTIMATES)
    for (receive_ns, topic, sample), (wanted_ns, _, wanted) in zip(
            sorted(written, key=lambda event: (event[0], event[1], event[2].stamp_ns)),
            sorted(expected, key=lambda event: (event[0], event[1], event[2].stamp_ns))):
        assert receive_ns == wanted_ns
        assert repr(sample) == repr(wanted), topic  # NaN equals NaN there


def test_films_that_aid_the_slip_are_heard_alike_offline(bag_of, drive, params, tmp_path):
    aided = EstimatorParams(*(replace(part, robot=replace(part.robot, slip=replace(
        part.robot.slip, film_aided=True))) for part in (params.slip, params.friction)))
    some = [event for event in drive if event[0] < drive[0][0] + 12 * NS_PER_S]
    run = analyze(bag_of(tmp_path / 'bag', some), tmp_path / 'out', aided)
    with_films, without = (slips_of(some, which) for which in (aided, params))
    assert np.array_equal(run.estimates.slips().ratio, with_films, equal_nan=True)
    assert np.nanmax(np.abs(with_films - without)) > 1e-4


def slips_of(events, params):
    """Return the slips that the estimators, one feeding the other, make of ``events``."""
    pipeline, series = Pipeline(params), Series()
    for _, topic, sample in events:
        if topic in INPUTS:
            for estimate in pipeline.update(sample):
                series.add(estimate)
    return series.slips().ratio


def test_estimates_stand_on_the_grid_with_nothing_left_out(analyzed):
    stamps = analyzed[1].estimates.poses().stamp_ns
    assert (stamps % GRID_NS == 0).all()
    assert set((stamps[1:] - stamps[:-1]).tolist()) == {GRID_NS}


def test_the_summary_has_the_form_of_the_contract(analyzed, drive, drive_bag):
    out, run = analyzed
    summary = json.loads((out / 'summary.json').read_text())
    assert summary == run.summary
    assert list(summary) == [
        'bag', 'duration_s', 'inputs', 'left_out', 'estimates', 'against_truth']
    assert summary['bag'] == str(drive_bag)
    assert summary['duration_s'] == pytest.approx(12.0, abs=0.1)
    counts = Counter(topic for _, topic, _ in drive)
    assert {topic: inputs['messages'] for topic, inputs in summary['inputs'].items()} == {
        topic: counts[topic] for topic in INPUTS}
    for topic, rate in zip(INPUTS, (100.0, 16.0, 400.0)):
        inputs = summary['inputs'][topic]
        assert inputs['rate_hz'] == pytest.approx(rate, rel=0.05)
        assert (inputs['late'], inputs['rejected']) == (0, 0)
    assert summary['left_out'] == []


def test_lost_batches_are_gaps_of_the_inputs(analyzed, drive):
    samples = of_topics(drive, 'tire_samples')
    ideal = 2 * round(12.0 * 400)
    inputs = analyzed[1].summary['inputs']['tire_samples']
    assert inputs['missing'] % 16 == 0
    assert 0 <= ideal - len(samples) - inputs['missing'] <= 2 * 32  # the ends may miss batches


def test_slip_and_friction_come_near_the_truth(analyzed):
    truth = analyzed[1].summary['against_truth']
    assert truth['pose']['distance_m'] > 5.0
    assert truth['pose']['position_rms_m'] < 0.2
    for side in ('left', 'right'):
        slip = truth['slip'][WHOLE][side]
        assert slip['estimated_mean'] == pytest.approx(slip['true_mean'], abs=0.05)
    traction = truth['friction'][WHOLE]['traction']
    assert traction['found'] >= 0.8 * traction['passages'] > 5
    assert truth['friction']['false_passages'] <= 1


def test_without_tire_samples_there_is_slip_but_no_friction(bag_of, drive, params, tmp_path):
    events = [event for event in drive if event[1] != 'tire_samples']
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert 'tire_samples is not in the bag: no tire_friction' in run.intake.left_out
    assert run.summary['estimates']['tire_friction'] == {}
    assert run.summary['against_truth']['slip'][WHOLE]['left']['error']['count'] > 100
    with Bag(tmp_path / 'out' / 'estimates') as bag:
        assert set(bag.topics) == {'/odom', '/wheel_slip', '/icr'}


def test_films_of_a_wheel_that_the_parameters_do_not_know_are_left_out(drive_bag, tmp_path):
    run = analyze(drive_bag, tmp_path / 'out', EstimatorParams.load([]))
    assert run.intake.left_out == ['tire_samples of front_left: it is not among film.wheels']
    assert list(run.summary['estimates']['tire_friction']) == ['front_right']


def test_without_positions_the_velocities_serve(bag_of, drive, params, tmp_path):
    events = [(ns, topic, replace(sample, position=None, effort=None)
               if topic == 'wheel_states' else sample)
              for ns, topic, sample in of_topics(drive, 'imu/data', 'wheel_states', *TRUTHS)]
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert 'positions of wheel_states' in left_out(run)
    assert run.summary['against_truth']['pose']['position_rms_m'] < 0.3


def test_an_imu_at_twenty_hertz_serves(bag_of, drive, params, tmp_path):
    imu = of_topics(drive, 'imu/data')[::5]
    events = sorted(imu + of_topics(drive, 'wheel_states', *TRUTHS), key=lambda event: event[0])
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert run.summary['inputs']['imu/data']['rate_hz'] == pytest.approx(20.0)
    assert run.summary['estimates']['odom']['messages'] > 1400
    assert run.summary['against_truth']['pose']['position_rms_m'] < 0.3


@pytest.mark.parametrize('name', ['{}', '/{}', '/robot_7/{}'])
def test_names_may_carry_a_slash_or_a_namespace(bag_of, drive, params, tmp_path, name):
    events = [event for event in drive if event[1] != 'tire_samples'][:600]
    run = analyze(bag_of(tmp_path / 'bag', events, name.format), tmp_path / 'out', params)
    assert set(run.summary['inputs']) == {'imu/data', 'wheel_states'}
    assert run.summary['estimates']['odom']['messages'] > 100
    assert run.summary['against_truth']['pose'] is not None


def test_a_second_robot_in_the_bag_is_said_to_be_passed_over(bag_of, drive, params, tmp_path):
    both = [event for event in drive if event[1] != 'tire_samples'][:900]
    other = [(ns, topic, sample, '/zwei/') for ns, topic, sample in of_topics(both, 'imu/data')]
    names = iter(['/eins/'] * len(both) + ['/zwei/'] * len(other))
    run = analyze(bag_of(tmp_path / 'bag', both + [event[:3] for event in other],
                         lambda topic: next(names) + topic), tmp_path / 'out', params)
    assert '/zwei/imu/data: is not read beside /eins/imu/data' in run.intake.left_out
    assert run.summary['inputs']['imu/data']['messages'] == len(other)


def test_without_truth_nothing_is_compared(bag_of, drive, params, tmp_path):
    events = of_topics(drive, *INPUTS)
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert run.summary['against_truth'] is None
    assert run.intake.left_out == ['ground truth is not in the bag: nothing is compared']


def test_a_truth_of_poses_alone_says_nothing_of_speeds(bag_of, drive, params, tmp_path):
    unknown = (-1.0,) + (0.0,) * 35
    events = [(ns, topic, replace(sample, twist_covariance=unknown)
               if isinstance(sample, Odometry) else sample)
              for ns, topic, sample in of_topics(drive, 'imu/data', 'wheel_states', TRUTHS[0])]
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert run.summary['against_truth']['pose']['twist'] is None
    assert list(run.summary['against_truth']) == ['pose']
    assert 'twist of ground_truth/odom is not given' in left_out(run)
    assert 'ground_truth/wheel_slip is not in the bag: slips are not compared' in left_out(run)


def test_old_estimates_in_the_bag_change_nothing(bag_of, drive, params, analyzed, tmp_path):
    wrong = [(ns, 'wheel_slip', WheelSlip(sample.stamp_ns, (0.9,) * 4, (0.0,) * 4, (0.01,) * 4))
             for ns, _, sample in of_topics(drive, 'imu/data')]
    events = sorted(drive + wrong, key=lambda event: event[0])
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert run.summary['estimates'] == analyzed[1].summary['estimates']
    assert left_out(run).strip('/') == 'wheel_slip: a former estimate, is not read'


def test_late_samples_are_counted(bag_of, drive, params, tmp_path):
    events = of_topics(drive, 'imu/data', 'wheel_states')
    late = [(ns + (NS_PER_S // 5 if i in (300, 500) else 0), topic, sample)
            for i, (ns, topic, sample) in enumerate(events)]
    run = analyze(bag_of(tmp_path / 'bag', sorted(late, key=lambda event: event[0])),
                  tmp_path / 'out', params)
    assert sum(inputs['late'] for inputs in run.summary['inputs'].values()) == 2


def test_messages_that_break_the_contract_are_counted_with_the_reason(bag_of, drive, params,
                                                                      tmp_path):
    events = of_topics(drive, 'imu/data', 'wheel_states')
    hit = [i for i, (_, topic, _) in enumerate(events) if topic == 'imu/data' and i % 100 == 0]
    for i in hit:
        events[i] = *events[i][:2], replace(events[i][2], rate=(math.nan,) * 3)
    broken = len(hit)
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert run.summary['inputs']['imu/data']['rejected'] == broken > 5
    assert f'{broken} messages of imu/data: refused' in left_out(run)


def test_without_an_imu_the_films_tell_alone(bag_of, drive, params, tmp_path):
    events = of_topics(drive, 'wheel_states', 'tire_samples', *TRUTHS)
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert 'imu/data is not in the bag: no odom, wheel_slip and icr' in run.intake.left_out
    assert list(run.summary['estimates']) == ['tire_friction']
    assert run.summary['against_truth']['friction'][WHOLE]['traction']['found'] > 5
    assert run.summary['against_truth']['slip'][WHOLE]['left']['error']['count'] == 0


@pytest.mark.parametrize('kept', [('imu/data',), TRUTHS, ()])
def test_where_nothing_can_be_estimated_nothing_is_written(bag_of, drive, params, tmp_path, kept):
    run = analyze(bag_of(tmp_path / 'bag', of_topics(drive, *kept)), tmp_path / 'out', params)
    assert run.summary is None
    assert 'wheel_states is not in the bag' in left_out(run)
    assert not (tmp_path / 'out').exists()


def test_a_second_analysis_replaces_the_first(bag_of, drive, params, tmp_path):
    bag = bag_of(tmp_path / 'bag', of_topics(drive, 'imu/data', 'wheel_states')[:500])
    first = analyze(bag, tmp_path / 'out', params).summary
    assert analyze(bag, tmp_path / 'out', params).summary == first
    assert sorted(path.name for path in (tmp_path / 'out' / 'estimates').iterdir()) == [
        'estimates_0.mcap', 'metadata.yaml']


def test_foreign_files_among_the_estimates_are_never_removed(bag_of, drive, params, tmp_path):
    bag = bag_of(tmp_path / 'bag', of_topics(drive, 'imu/data', 'wheel_states')[:500])
    analyze(bag, tmp_path / 'out', params)
    note = tmp_path / 'out' / 'estimates' / 'note.txt'
    note.write_text('keep me')
    with pytest.raises(BagError, match='estimates'):
        analyze(bag, tmp_path / 'out', params)
    assert note.read_text() == 'keep me'


def test_the_bag_that_is_read_is_never_written_over(bag_of, drive, params, tmp_path):
    bag = bag_of(tmp_path / 'estimates', of_topics(drive, 'imu/data', 'wheel_states')[:500])
    for path in (bag, bag / 'estimates_0.mcap'):
        with pytest.raises(BagError, match='choose another'):
            analyze(path, tmp_path, params)
    with Bag(bag) as kept:
        assert sum(topic.messages for topic in kept.topics.values()) == 500


def test_smoothing_tells_of_the_same_instants_in_a_bag_of_its_own(smoothed):
    told = []
    for folder in ('estimates', 'smoothed'):
        with Bag(smoothed[0] / folder) as bag:
            told.append([(receive_ns, topic, sample.stamp_ns)
                         for receive_ns, topic, sample in bag.samples(ESTIMATES)
                         if topic in ('odom', 'wheel_slip')])
            assert set(bag.topics) == {f'/{name}' for name in ESTIMATES}
    assert told[0] == told[1] and len(told[0]) > 2000


def test_smoothing_leaves_what_the_filter_tells_as_it_is(smoothed, analyzed):
    with_smoothed, without = smoothed[1].summary, analyzed[1].summary
    assert {**without, 'smoothed': with_smoothed['smoothed']} == with_smoothed
    assert list(with_smoothed['smoothed']) == ['estimates', 'against_truth']
    assert 'smoothed' not in without and not (analyzed[0] / 'smoothed').exists()
    assert json.loads((smoothed[0] / 'summary.json').read_text()) == with_smoothed


def test_what_is_smoothed_is_nearer_to_the_truth(smoothed):
    filtered, better = (tree['against_truth'] for tree in (
        smoothed[1].summary, smoothed[1].summary['smoothed']))
    for side in ('left', 'right'):
        errors = [tree['slip'][WHOLE][side]['error'] for tree in (filtered, better)]
        assert errors[1]['rms'] < 0.8 * errors[0]['rms']
        assert errors[1]['within_two'] > 0.9


def test_friction_is_estimated_again_from_the_smoothed_slip(smoothed):
    run = smoothed[1]
    assert [p.stamp_ns for p in run.smoothed.passages] == [
        p.stamp_ns for p in run.estimates.passages]
    used = [[p.slip.value for p in series.passages]
            for series in (run.estimates, run.smoothed)]
    assert used[0] != used[1]
    traction = run.summary['smoothed']['against_truth']['friction'][WHOLE]['traction']
    assert traction['median_relative_error'] < 0.1


def test_progress_counts_the_way_back_too(smoothed):
    shares = smoothed[2]
    assert shares == sorted(shares)
    assert shares[0] < 0.01 and 0.5 in shares and shares[-1] == 1.0


def test_smoothing_without_an_imu_changes_nothing(bag_of, drive, params, tmp_path):
    events = of_topics(drive, 'wheel_states', 'tire_samples')
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params, smooth=True)
    assert run.summary['smoothed']['estimates'] == run.summary['estimates']


@pytest.mark.parametrize('kept', [('imu/data',), ()])
def test_where_nothing_can_be_estimated_nothing_is_smoothed(bag_of, drive, params, tmp_path, kept):
    bag = bag_of(tmp_path / 'bag', of_topics(drive, *kept))
    assert analyze(bag, tmp_path / 'out', params, smooth=True).summary is None
    assert not (tmp_path / 'out').exists()


def test_a_bag_that_would_be_smoothed_over_is_left_alone(bag_of, drive, params, tmp_path):
    bag = bag_of(tmp_path / 'smoothed', of_topics(drive, 'imu/data', 'wheel_states')[:500])
    with pytest.raises(BagError, match='choose another'):
        analyze(bag, tmp_path, params, smooth=True)
    assert analyze(bag, tmp_path, params).summary is not None


def test_progress_runs_from_nothing_to_all(drive_bag, params, tmp_path):
    shares = []
    analyze(drive_bag, tmp_path, params, shares.append)
    assert shares == sorted(shares)
    assert shares[0] < 0.01 and shares[-1] == 1.0


def test_parameters_of_both_estimators_come_from_the_files(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text('/**: {ros__parameters: {wheel_radius: 0.1}}\n'
                    'friction_estimator: {ros__parameters: {reorder_window: 0.1}}\n')
    params = EstimatorParams.load([path])
    assert params.robot.wheel_radius == params.friction.robot.wheel_radius == 0.1
    assert (params.slip.reorder_window, params.friction.reorder_window) == (0.03, 0.1)


def test_a_parameter_that_is_misspelt_is_refused(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text('/**: {ros__parameters: {wheel_radios: 0.1}}')
    with pytest.raises(ParameterError, match='wheel_radios.*wheel_radius'):
        EstimatorParams.load([path])
