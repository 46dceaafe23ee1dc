# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings: arrays in, arrays out, through bags and in order of reception."""

from __future__ import annotations

from dataclasses import replace
import warnings

import numpy as np
import pytest
from smart_tire import estimate, load_params, read_bag, Recording, simulate, write_bag
from smart_tire.api import FilmData, ImuData, Params, PoseEstimate, WheelData
from smart_tire.api.recording import as_recording
from smart_tire.bags import Bag, BagWriter
from smart_tire.errors import BagError, ParameterError
from smart_tire.messages import topic_of
from smart_tire.samples import ImuSample, TireSample, WheelSample
from support.arrays import arrays, assert_same_arrays

STAMPS = np.array([10, 20, 30])


def imu(stamps=STAMPS, **others) -> ImuData:
    """Return an IMU at rest."""
    zeros = np.zeros((len(stamps), 3))
    return ImuData(stamps, zeros, zeros, **others)


def wheels(stamps=STAMPS, **others) -> WheelData:
    """Return wheels at rest."""
    return WheelData(stamps, np.zeros((len(stamps), 4)), **others)


def test_a_recording_survives_a_bag(recording, bag):
    found = read_bag(bag)
    assert found.params.estimators == recording.params.estimators
    assert_same_arrays(replace(found, params=None), replace(recording, params=None), 1e-12)
    assert len(arrays(recording)) > 50


def test_the_streams_have_their_rates_and_truth(recording):
    assert list(recording.films) == ['front_left', 'front_right']
    assert len(recording.imu) == 300 and 45 <= len(recording.wheels) <= 48
    assert recording.films['front_left'].volts.shape[1] == 2
    assert recording.duration == pytest.approx(3.0, abs=0.05)
    assert len(recording.truth.pose) == len(recording.truth.slip) == 300
    assert len(recording.truth.friction) >= 3 and recording.warnings == ()


def test_samples_are_received_in_the_recorded_order_also_at_equal_times(tmp_path):
    samples = [TireSample(5, 'rear_left', (1.0,)), ImuSample(7, (0.0,) * 3, (0.0,) * 3),
               WheelSample(6, (0.0,) * 4), ImuSample(4, (1.0,) * 3, (0.0,) * 3),
               TireSample(8, 'rear_left', (1.0, 2.0)), TireSample(8, 'front_left', (3.0,))]
    recording = as_recording((100, topic_of(sample), sample) for sample in samples)
    assert [item.sample for item in recording.received()] == samples
    write_bag(tmp_path / 'ties', recording)
    assert [item.sample for item in read_bag(tmp_path / 'ties').received()] == samples


def test_what_was_not_measured_is_nan_and_absent_again_in_samples():
    recording = Recording(imu(), wheels())
    assert np.isnan(recording.imu.orientation).all() and np.isnan(recording.wheels.effort).all()
    samples = [item.sample for item in recording.received()]
    assert samples[0].orientation is None
    assert samples[-1].position is None and samples[-1].effort is None


def test_by_default_samples_are_in_order_of_reception_and_that_is_by_timestamp():
    recording = Recording(imu(STAMPS + 5), wheels(receive_ns=STAMPS + 6))
    assert recording.order.tolist() == [0, 1, 0, 1, 0, 1]
    assert [item.receive_ns for item in recording.received()] == [15, 16, 25, 26, 35, 36]
    same = np.repeat([7, 8, 9], 100)
    assert Recording(imu(same), wheels(same)).order.tolist() == 3 * (100 * [0] + 100 * [1])


@pytest.mark.parametrize(('make', 'message'), [
    (lambda: imu(STAMPS[::-1]), 'stamp_ns decreases in row 1: sort the rows, or give receive_ns'),
    (lambda: wheels(np.array([1, 3, 2])), 'stamp_ns decreases in row 2'),
    (lambda: ImuData(STAMPS, np.full((3, 3), np.nan), np.zeros((3, 3))),
     'acceleration: NaN in all 3 rows'),
    (lambda: ImuData(STAMPS, np.zeros((3, 3)), np.full((3, 3), np.nan)), 'rate: NaN in all 3'),
    (lambda: WheelData(STAMPS, np.full((3, 4), np.nan)),
     'velocity and position: NaN in all 3 rows'),
    (lambda: FilmData(STAMPS, 'rear_left', np.full((3, 2), np.nan)), 'volts: NaN in all 3 rows'),
    (lambda: imu(STAMPS.astype(float)), r'stamp_ns has shape \(3,\) and type float64'),
    (lambda: imu(STAMPS[:, np.newaxis]), r'stamp_ns has shape \(3, 1\)'),
    (lambda: ImuData(STAMPS, np.zeros((3, 3)), np.zeros((2, 3))), r'rate has shape \(2, 3\)'),
    (lambda: imu(orientation=np.zeros((3, 3))), r'orientation has shape \(3, 3\), expected'),
    (lambda: wheels(receive_ns=STAMPS[:2]), r'receive_ns has shape \(2,\), expected \(3,\)'),
    (lambda: FilmData(STAMPS, 'left', np.zeros((3, 2))), "wheel is 'left', expected one of"),
    (lambda: FilmData(STAMPS, 'rear_left', np.zeros(3)), r'volts has shape \(3,\), expected \(n'),
    (lambda: Recording(imu(), wheels(), order=np.array([0, 1])), 'order does not have one entry'),
    (lambda: Recording(imu(), wheels(), order=np.array([-1, 0, 0, 1, 1, 1])), 'order does not'),
    (lambda: Recording(imu(), wheels(), order=np.array([0, 0, 0, 1, 1, 2])), 'order does not'),
    (lambda: Recording(imu(), wheels(), {
        'rear_left': FilmData(STAMPS, 'rear_right', np.zeros((3, 2)))}),
     r"films\['rear_left'\] are those of rear_right"),
])
def test_arrays_that_do_not_fit_are_refused(make, message):
    with pytest.raises(ParameterError, match=message):
        make()


def test_a_bag_is_not_replaced_and_a_missing_one_is_an_error(recording, bag, tmp_path):
    with pytest.raises(BagError, match='cannot be written'):
        write_bag(bag, recording)
    with pytest.raises(BagError, match='no such file'):
        read_bag(tmp_path / 'none')


def test_uncertain_truth_survives_a_bag_also_without_twist(tmp_path):
    half = np.random.default_rng(1).standard_normal((3, 3, 3))
    twist = np.array([[1.0, 2.0, 3.0], [np.nan] * 3, [4.0, 5.0, 6.0]])
    pose = PoseEstimate(STAMPS, np.ones((3, 3)), twist, half @ half.transpose(0, 2, 1),
                        0.1 * twist)
    empty = Recording(imu(), wheels())
    write_bag(tmp_path / 'bag', replace(empty, truth=replace(empty.truth, pose=pose)))
    assert_same_arrays(read_bag(tmp_path / 'bag').truth.pose, pose, 1e-12)


def test_given_parameters_and_topics_replace_those_of_the_bag(bag, tmp_path):
    with Bag(bag) as source, BagWriter(tmp_path / 'other') as writer:
        for topic in source.topics.values():
            for name in ('/a/imu', '/b/imu') if topic.channel.topic == '/imu/data' else (
                    topic.channel.topic,):
                writer.add_topic(replace(topic.channel, topic=name))
        for receive_ns, channel, data in source.raw():
            writer.write('/b/imu' if channel.topic == '/imu/data' else channel.topic, receive_ns,
                         data)
    assert_same_arrays(read_bag(tmp_path / 'other', remap={'imu/data': '/b/imu'}).imu,
                       read_bag(bag).imu, 0.0)
    given = load_params(values={'wheel_radius': 0.09})
    assert read_bag(tmp_path / 'other').params is None
    assert read_bag(bag, params=given).params is given


def test_a_wheel_or_torque_that_is_not_measured_does_not_hide_the_others():
    partly = np.array([[1.0, np.nan, 2.0, 3.0]] * 3)
    speed = np.array([[5.0, np.nan, 5.0, 5.0], [5.0] * 4, [np.nan] * 4])
    samples = [item.sample for item in WheelData(STAMPS, speed, partly, partly).received()]
    assert samples[0].position[2] == 2.0 and np.isnan(samples[0].position[1])
    assert samples[1].position is None and samples[1].effort[2:] == (2.0, 3.0)


def test_damage_and_rejected_messages_are_in_the_warnings(bag, tmp_path):
    with Bag(bag) as source, BagWriter(tmp_path / 'bad') as writer:
        for topic in source.topics.values():
            writer.add_topic(topic.channel)
        for receive_ns, channel, data in source.raw(['/imu/data']):
            writer.write(channel.topic, receive_ns, data[:40])
    read = read_bag(tmp_path / 'bad')
    assert len(read.imu) == 0
    assert [line for line in read.warnings if line.startswith('300 messages of imu/data')]


@pytest.mark.parametrize(('speeds', 'duration', 'rate', 'message'), [
    ([(0.0, 1.0)], 1.0, 16.0, r'speeds has shape \(1, 2\)'),
    ([(0.0, 1.0, np.nan)], 1.0, 16.0, 'expected finite numbers'),
    ([(0.0, 1.0, 1.0)], 0.0, 16.0, 'duration is 0.0'),
    ([(0.0, 1.0, 1.0)], np.inf, 16.0, 'duration is inf'),
    ([(0.0, 1.0, 1.0)], 1.0, -1.0, 'wheel_rate is -1.0'),
])
def test_a_simulation_refuses_impossible_arguments(speeds, duration, rate, message):
    with pytest.raises(ParameterError, match=message):
        simulate(speeds, duration, wheel_rate=rate)


def test_speeds_are_in_radians_per_second_and_the_seed_decides():
    first, same, other = (simulate([(0.0, 6.0, 3.0)], 1.0, seed=seed, torque=False)
                          for seed in (1, 1, 0))
    speed = first.wheels.velocity[-5:].mean(axis=0)
    assert speed == pytest.approx([6.0, 3.0, 6.0, 3.0], rel=0.05)
    np.testing.assert_array_equal(first.imu.rate, same.imu.rate)
    assert not np.array_equal(first.imu.rate, other.imu.rate)
    assert np.isnan(first.wheels.effort).all()


def test_rows_in_order_of_reception_may_have_decreasing_timestamps():
    late = imu(np.array([1, 3, 2]), receive_ns=np.array([4, 5, 6]))
    assert late.stamp_ns.tolist() == [1, 3, 2]
    assert len(WheelData(STAMPS, np.full((3, 4), np.nan), np.zeros((3, 4)))) == 3
    assert len(imu(STAMPS[:0])) == 0  # nothing is measured, nothing is NaN


def test_a_wheel_that_does_not_exist_is_an_error(recording):
    with pytest.raises(ParameterError, match="wheel is 'left', expected one of front_left, "):
        recording.truth.friction.of('left')
    assert len(recording.truth.friction.of('rear_left')) == 0


def test_records_are_shown_in_a_line(recording):
    found = estimate(recording)
    shown = [recording, recording.params, recording.truth, found, found.ground,
             found.friction.slip, Params(), *recording.streams, *found.tables().values()]
    for one in shown:
        assert repr(one).startswith(type(one).__name__) and len(repr(one)) < 500
        assert '\n' not in repr(one)
    assert repr(recording.imu) == 'ImuData(300 rows in 3.0 s: acceleration, rate, orientation)'
    assert repr(recording).startswith('Recording(rows of imu: 300, wheels: ')
    assert repr(Params()) == 'Params(defaults)'
    assert 'wheel_radius: 0.1' in repr(Params().with_values({'wheel_radius': 0.1}))
    assert ' known of ' in repr(found.friction.slip)


def test_all_tables_become_data_frames_with_one_time(recording):
    pytest.importorskip('pandas')
    tables = recording.to_pandas()
    assert list(tables) == ['imu', 'wheels', 'front_left', 'front_right']
    assert min(table['time'].min() for table in tables.values()) == 0.0
    found = estimate(recording).to_pandas(recording.origin_ns)
    assert list(found) == ['pose', 'slip', 'center', 'ground', 'friction']
    assert list(recording.truth.to_pandas()) == ['pose', 'slip', 'friction']
    for table in found.values():
        assert table.columns[0] == 'time'
        assert table['time'].to_numpy() == pytest.approx(
            (table.index - recording.origin_ns) / 1e9, abs=1e-9)
    assert 'time' not in recording.imu.to_pandas().columns


def test_values_are_replaced_in_all_parameters_that_have_them():
    params = load_params(values={'wheel_radius': 0.1, 'icr_x': 0.2})
    other = params.with_values({'wheel_radius': 0.2, 'film.wheels': ['rear_left'],
                                'ground.base': 'sand'})
    assert other == load_params(values={'wheel_radius': 0.2, 'icr_x': 0.2,
                                        'film.wheels': ['rear_left'], 'ground.base': 'sand'})
    assert params == load_params(values={'wheel_radius': 0.1, 'icr_x': 0.2})
    for values, message in (({'wheel_radios': 0.1}, 'did you mean wheel_radius'),
                            ({'wheel_radius': -0.1}, 'wheel_radius')):
        with pytest.raises(ParameterError, match=message):
            params.with_values(values)


def test_estimates_that_a_recording_cannot_have_are_warned_of(recording):
    nothing = replace(recording, wheels=wheels(STAMPS[:0]), films={}, order=None)
    with pytest.warns(UserWarning, match='has no wheel_states: no odom, wheel_slip, icr'):
        assert len(estimate(nothing).pose) == 0
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        estimate(recording)
