# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Offline analysis: estimates equal to live ones, with any subset of the inputs."""

from collections import Counter
from dataclasses import replace
import json
import math

from benchmarks.faults import stalled
import numpy as np
import pytest

from smart_tire.analysis.dead_reckoning import GYRO_WHEELS, WHEELS_ONLY
from smart_tire.analysis.html_report.content import report_of
from smart_tire.analysis.offline import analyze
from smart_tire.analysis.pipeline import (
    BagParams, ESTIMATES, EstimatorParams, INPUTS, Pipeline, TRUTHS)
from smart_tire.analysis.summary import WHOLE
from smart_tire.bags import Bag
from smart_tire.errors import BagError
from smart_tire.estimation.slip.filter import SlipFilter
from smart_tire.messages import topic_of
from smart_tire.samples import NS_PER_S, Odometry, WheelSlip
from support.recordings import standard, typed, write_bag

pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def params(tmp_path_factory):
    path = tmp_path_factory.mktemp('params') / 'robot.yaml'
    path.write_text('/**: {ros__parameters: {film: {wheels: [front_left, front_right]}}}')
    return EstimatorParams.load([path])


@pytest.fixture(scope='module')
def analyzed(drive_bag, params, tmp_path_factory):
    """Return folder and run of the whole drive with the smoother, and the shares of progress."""
    out, shares = tmp_path_factory.mktemp('analyzed') / 'deep' / 'out', []
    return out, analyze(drive_bag, out, params, shares.append, smooth=True), shares


def until(events, seconds):
    return [event for event in events if event[0] < events[0][0] + seconds * NS_PER_S]


def of_topics(events, *topics):
    return [event for event in events if event[1] in topics]


def skipped(run):
    return '\n'.join(run.contents.skipped)


def test_the_written_estimates_equal_those_of_the_estimators(analyzed, drive, params):
    pipeline = Pipeline(params)
    expected = [(receive_ns, topic_of(estimate), estimate) for receive_ns, topic, sample in drive
                if topic in INPUTS for estimate in pipeline.update(sample)]
    expected += [(max(receive_ns for receive_ns, topic, _ in drive if topic in INPUTS),
                  topic_of(estimate), estimate) for estimate in pipeline.finish()]
    with Bag(analyzed[0] / 'estimates') as bag:
        written = list(bag.samples(ESTIMATES))
    assert Counter(topic for _, topic, _ in written) == Counter(t for _, t, _ in expected)
    assert {topic for _, topic, _ in written} == set(ESTIMATES)
    for (receive_ns, topic, sample), (wanted_ns, _, wanted) in zip(
            sorted(written, key=lambda event: (event[0], event[1], event[2].stamp_ns)),
            sorted(expected, key=lambda event: (event[0], event[1], event[2].stamp_ns))):
        assert receive_ns == wanted_ns
        assert repr(sample) == repr(wanted), topic  # in text, NaN equals NaN


def test_the_summary_has_the_specified_form(analyzed, drive, drive_bag):
    out, run, _ = analyzed
    summary = json.loads((out / 'summary.json').read_text())
    assert summary == run.summary
    assert list(summary) == [
        'bag', 'duration_s', 'host', 'parameters', 'notes', 'findings', 'diverged', 'inputs',
        'left_out', 'estimates', 'against_truth', 'against_camera', 'smoothed', 'remap']
    assert summary['remap'] == {}
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


def test_a_late_host_is_in_the_summary_and_the_first_note_of_the_report(
        drive, params, tmp_path, analyzed):
    bag = write_bag(tmp_path / 'bag', stalled(drive, [(4.0, 4.6), (8.0, 8.5)]))
    run = analyze(bag, None, params)
    assert run.summary['host'] == (
        'host: imu/data, wheel_states, tire_samples stalled 2 times at the same time, up to '
        '0.6 s, the first at 4.0 s: the host or the recorder was late; end other programs')
    run.contents.late['imu/data'] = 5
    notes = report_of(run, BagParams(params, 'defaults'), 'late', ()).notes
    assert notes[0].startswith('Host: imu/data')
    assert not any('late messages' in note for note in notes)
    assert analyzed[1].summary['host'] is None


def test_a_bag_of_typed_messages_gives_the_same_estimates(drive, params, tmp_path):
    events = typed(until(drive, 4.0))
    plain = analyze(write_bag(tmp_path / 'plain', standard(events)), tmp_path / 'a', params)
    other = analyze(write_bag(tmp_path / 'typed', events), tmp_path / 'b', params)
    same = 'parameters', 'findings', 'inputs', 'left_out', 'estimates', 'against_truth'
    assert {key: other.summary[key] for key in same} == {key: plain.summary[key] for key in same}
    assert plain.summary['estimates']['tire_friction'] and plain.summary['against_truth']
    assert other.contents.skipped == plain.contents.skipped
    found, expected = ([repr(sample) for _, _, sample in Bag(tmp_path / name / 'estimates')
                        .samples(ESTIMATES)] for name in 'ab')
    assert sorted(found) == sorted(expected)


def test_slip_and_friction_are_near_the_truth(analyzed):
    truth = analyzed[1].summary['against_truth']
    assert truth['pose']['distance_m'] > 5.0
    assert truth['pose']['position_rms_m'] < 0.2
    gyro, wheels = (truth['baselines'][name] for name in (GYRO_WHEELS, WHEELS_ONLY))
    assert gyro['distance_m'] == truth['pose']['distance_m'] == wheels['distance_m']
    assert gyro['yaw']['rms'] < 0.1 < 1.0 < wheels['yaw']['rms']
    assert gyro['position_within_two'] is gyro['yaw']['within_two'] is None
    for side in ('left', 'right'):
        slip = truth['slip'][WHOLE][side]
        assert slip['estimated_mean'] == pytest.approx(slip['true_mean'], abs=0.05)
    traction = truth['friction'][WHOLE]['traction']
    assert traction['found'] >= 0.8 * traction['crossings'] > 5
    assert truth['friction']['false_crossings'] <= 1


def test_without_tire_samples_there_is_slip_but_no_friction(bag_of, drive, params, analyzed,
                                                            tmp_path):
    events = [event for event in drive if event[1] != 'tire_samples']
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert 'tire_samples is not in the bag: no tire_friction' in run.contents.skipped
    assert run.summary['estimates']['tire_friction'] == {}
    assert run.summary['against_truth']['slip'][WHOLE]['left']['error']['count'] > 100
    by_films = analyzed[1].estimates.slips().ratio - run.estimates.slips().ratio
    assert np.nanmax(np.abs(by_films)) > 1e-4  # by the ground that they show
    with Bag(tmp_path / 'out' / 'estimates') as bag:
        assert set(bag.topics) == {'/odom', '/wheel_slip', '/icr', '/ground_state'}  # by torques


def test_films_of_a_wheel_not_in_the_parameters_are_skipped(bag_of, drive, tmp_path):
    run = analyze(bag_of(tmp_path / 'bag', until(drive, 3.0)), tmp_path / 'out',
                  EstimatorParams.load([]))
    assert run.contents.skipped == ['tire_samples of front_left: not in film.wheels']
    assert list(run.summary['estimates']['tire_friction']) == ['front_right']


def test_without_positions_velocities_are_used(bag_of, drive, params, tmp_path):
    events = [(ns, topic, replace(sample, position=None, effort=None)
               if topic == 'wheel_states' else sample)
              for ns, topic, sample in of_topics(drive, 'imu/data', 'wheel_states', *TRUTHS)]
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert 'positions of wheel_states' in skipped(run)
    assert run.summary['against_truth']['pose']['position_rms_m'] < 0.3


def test_topics_of_a_second_robot_are_reported_as_skipped(bag_of, drive, params, tmp_path):
    both = [event for event in drive if event[1] != 'tire_samples'][:900]
    other = [(ns, topic, sample, '/zwei/') for ns, topic, sample in of_topics(both, 'imu/data')]
    names = iter(['/eins/'] * len(both) + ['/zwei/'] * len(other))
    run = analyze(bag_of(tmp_path / 'bag', both + [event[:3] for event in other],
                         lambda topic: next(names) + topic), tmp_path / 'out', params)
    assert '/zwei/imu/data: not read, /eins/imu/data is used' in run.contents.skipped
    assert run.summary['inputs']['imu/data']['messages'] == len(other)


def test_without_ground_truth_no_errors_are_computed(bag_of, drive, params, tmp_path):
    events = of_topics(drive, *INPUTS)[:2000]
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert run.summary['against_truth'] is None
    assert run.contents.skipped == ['ground truth is not in the bag: no errors are computed']


def test_ground_truth_without_twist_gives_no_errors_of_speeds(bag_of, drive, params, tmp_path):
    unknown = (-1.0,) + (0.0,) * 35
    events = [(ns, topic, replace(sample, twist_covariance=unknown)
               if isinstance(sample, Odometry) else sample)
              for ns, topic, sample in of_topics(
                  drive, 'imu/data', 'wheel_states', TRUTHS[0])[:1000]]
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert run.summary['against_truth']['pose']['twist'] is None
    assert list(run.summary['against_truth']) == ['pose', 'baselines']
    assert 'ground_truth/odom has no twist' in skipped(run)
    assert 'ground_truth/wheel_slip is missing: no errors of slips' in skipped(run)


def test_recorded_estimates_are_ignored_and_smoothing_does_not_change_the_filter_estimates(
        bag_of, drive, params, tmp_path):
    clean = until(drive, 2.0)
    wrong = [(ns, 'wheel_slip', WheelSlip(sample.stamp_ns, (0.9,) * 4, (0.0,) * 4, (0.01,) * 4))
             for ns, _, sample in of_topics(clean, 'imu/data')]
    events = sorted(clean + wrong, key=lambda event: event[0])
    spoiled, smooth = (analyze(bag_of(tmp_path / name, given), tmp_path / f'{name}_out', params,
                               smooth=name == 'smooth')
                       for name, given in (('spoiled', events), ('smooth', clean)))
    assert 'wheel_slip: recorded estimate, not read' in skipped(spoiled)
    without = {**spoiled.summary, 'bag': smooth.summary['bag'],
               'left_out': smooth.summary['left_out'], 'smoothed': smooth.summary['smoothed']}
    assert without == smooth.summary
    assert list(smooth.summary['smoothed']) == [
        'estimates', 'against_truth', 'against_camera']
    assert not (tmp_path / 'spoiled_out' / 'smoothed').exists()


def test_late_samples_are_counted(bag_of, drive, params, tmp_path):
    events = of_topics(drive, 'imu/data', 'wheel_states')[:700]
    late = [(ns + (NS_PER_S // 5 if i in (300, 500) else 0), topic, sample)
            for i, (ns, topic, sample) in enumerate(events)]
    run = analyze(bag_of(tmp_path / 'bag', sorted(late, key=lambda event: event[0])),
                  tmp_path / 'out', params)
    assert sum(inputs['late'] for inputs in run.summary['inputs'].values()) == 2


def test_invalid_messages_are_counted_with_the_reason(bag_of, drive, params,
                                                      tmp_path):
    events = of_topics(drive, 'imu/data', 'wheel_states')
    hit = [i for i, (_, topic, _) in enumerate(events) if topic == 'imu/data' and i % 100 == 0]
    for i in hit:
        events[i] = *events[i][:2], replace(events[i][2], rate=(math.nan,) * 3)
    broken = len(hit)
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert run.summary['inputs']['imu/data']['rejected'] == broken > 5
    assert f'{broken} messages of imu/data: rejected' in skipped(run)


def test_without_an_imu_friction_is_estimated_from_the_films(bag_of, drive, params, tmp_path):
    events = of_topics(drive, 'wheel_states', 'tire_samples', *TRUTHS)
    run = analyze(bag_of(tmp_path / 'bag', events), tmp_path / 'out', params)
    assert ('imu/data is not in the bag: no odom, wheel_slip, icr and ground_state'
            in run.contents.skipped)
    assert list(run.summary['estimates']) == ['tire_friction']
    assert run.summary['against_truth']['friction'][WHOLE]['traction']['found'] > 5
    assert run.summary['against_truth']['slip'][WHOLE]['left']['error']['count'] == 0


@pytest.mark.parametrize('kept', [('imu/data',), TRUTHS, ()])
def test_nothing_is_written_if_nothing_can_be_estimated(bag_of, drive, params, tmp_path, kept):
    run = analyze(bag_of(tmp_path / 'bag', of_topics(drive, *kept)), tmp_path / 'out', params)
    assert run.summary is None
    assert 'wheel_states is not in the bag' in skipped(run)
    assert not (tmp_path / 'out').exists()


def test_other_files_in_the_output_folder_are_never_deleted(bag_of, drive, params, tmp_path):
    bag = bag_of(tmp_path / 'bag', of_topics(drive, 'imu/data', 'wheel_states')[:500])
    analyze(bag, tmp_path / 'out', params)
    note = tmp_path / 'out' / 'estimates' / 'note.txt'
    note.write_text('keep me')
    with pytest.raises(BagError, match='estimates'):
        analyze(bag, tmp_path / 'out', params)
    assert note.read_text() == 'keep me'


@pytest.mark.parametrize('name', ['estimates', 'smoothed'])
def test_the_input_bag_is_never_overwritten(bag_of, drive, params, tmp_path, name):
    bag = bag_of(tmp_path / name, of_topics(drive, 'imu/data', 'wheel_states')[:500])
    for path in (bag, bag / f'{name}_0.mcap'):
        with pytest.raises(BagError, match='choose another'):
            analyze(path, tmp_path, params, smooth=name == 'smoothed')
    with Bag(bag) as kept:
        assert sum(topic.messages for topic in kept.topics.values()) == 500


def test_smoothed_estimates_have_the_same_timestamps_in_a_separate_bag(analyzed):
    received = []
    for folder in ('estimates', 'smoothed'):
        with Bag(analyzed[0] / folder) as bag:
            received.append([(receive_ns, topic, sample.stamp_ns)
                             for receive_ns, topic, sample in bag.samples(ESTIMATES)
                             if topic in ('odom', 'wheel_slip')])
            assert set(bag.topics) == {f'/{name}' for name in ESTIMATES}
    assert received[0] == received[1] and len(received[0]) > 2000


@pytest.mark.parametrize('number', [500, 501])
def test_a_restart_of_a_filter_is_named_and_both_estimates_go_on(
        drive_bag, params, tmp_path, monkeypatch, number):
    checks = iter(range(10_000))
    monkeypatch.setattr(SlipFilter, 'is_sound', property(lambda _: next(checks) != number))
    run = analyze(drive_bag, tmp_path, params, smooth=True)
    assert run.summary['diverged'] == 'the slip filter restarted from its priors 1 times'
    events = []
    for name in ('estimates', 'smoothed'):
        with Bag(tmp_path / name) as bag:
            events.append([(ns, one.stamp_ns) for ns, _, one in bag.samples(['odom'])])
    filtered, smoothed = events
    assert smoothed[-1] == filtered[-1] and set(smoothed) <= set(filtered)
    assert len(smoothed) > len(filtered) - 20 > 600


def test_smoothed_slip_is_more_accurate(analyzed):
    summary = analyzed[1].summary
    filtered, better = (tree['against_truth'] for tree in (summary, summary['smoothed']))
    for side in ('left', 'right'):
        errors = [tree['slip'][WHOLE][side]['error'] for tree in (filtered, better)]
        # a part of both, at the start, is the error of the prior of the ground
        assert errors[1]['rms'] < 0.85 * errors[0]['rms']
        assert errors[1]['within_two'] > 0.9


def test_smoothing_keeps_friction_and_ground(analyzed):
    run = analyzed[1]
    assert list(map(repr, run.smoothed.crossings)) == list(map(repr, run.estimates.crossings))
    ground, kept = run.estimates.grounds(), run.smoothed.grounds()
    for name, column in ground.columns().items():
        assert np.array_equal(column, kept.columns()[name], equal_nan=True)
    assert len(ground) > 10
    traction = run.summary['smoothed']['against_truth']['friction'][WHOLE]['traction']
    assert traction['median_relative_error'] < 0.1


def test_progress_includes_the_smoother(analyzed):
    shares = analyzed[2]
    assert shares == sorted(shares)
    assert shares[0] < 0.01 and 0.5 in shares and shares[-1] == 1.0
