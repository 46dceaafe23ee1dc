# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Samples are collected into arrays, sorted by timestamp."""

import math
import pickle
import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest

from smart_tire.errors import BagError
from smart_tire.estimates import at
from smart_tire.recording import SampleArrays, seconds
from smart_tire.samples import Icr, ImuSample, Odometry, TireSample, WheelSample, WheelSlip

EPOCH = 1_700_000_000_000_000_000


def odometry(stamp_ns, yaw=0.0, twist_known=True):
    half = 0.5 * yaw
    twist_covariance = tuple(float(i) for i in range(36)) if twist_known else (-1.0,) * 36
    return Odometry(stamp_ns, (1.0, 2.0, 0.0), (0.0, 0.0, math.sin(half), math.cos(half)),
                    (0.5, 0.1, 0.0), (0.0, 0.0, 0.3), tuple(float(i) for i in range(36)),
                    twist_covariance)


def test_a_stream_orders_its_rows_and_keeps_the_last_of_equal_stamps():
    centers = SampleArrays(
        Icr(*row) for row in ((30, 3.0, 3.0), (10, 1.0, 1.0), (30, 4.0, 4.0), (20, 2.0, 2.0)))
    ordered = centers.stream(Icr).ordered
    assert ordered.stamp_ns.tolist() == [10, 20, 30]
    assert ordered['position'].tolist() == [[1.0, 1.0], [2.0, 2.0], [4.0, 4.0]]


def test_an_empty_series_has_empty_arrays():
    recording = SampleArrays()
    assert recording.poses().pose.shape == (0, 3)
    assert recording.slips().ratio.shape == (0, 4)
    assert recording.film_wheels() == []


def films(stamp_ns, count=2):
    return TireSample(stamp_ns, 'front_left', tuple(float(stamp_ns + i) for i in range(count)))


@pytest.mark.parametrize('limit', [1, 100, 1 << 20])
def test_samples_that_follow_a_stream_extend_the_next_one(limit, monkeypatch):
    monkeypatch.setattr('smart_tire.recording.MAX_IN_MEMORY', limit)  # of what is in no file
    recording = SampleArrays(map(films, range(3)))
    assert recording.stream(TireSample, 'front_left') is recording.stream(TireSample, 'front_left')
    recording.add_sample(films(3))
    recording.add_sample(films(4, 3))  # a further film
    recording.add_sample(films(5))
    found = recording.stream(TireSample, 'front_left')
    assert found.stamp_ns.tolist() == list(range(6)) == found.receive_ns.tolist()
    expected = np.arange(6.0)[:, np.newaxis] + range(3)
    expected[[0, 1, 2, 3, 5], 2] = np.nan
    np.testing.assert_array_equal(found.values, expected)
    assert recording.films('front_left')[1].shape == (5, 2)
    assert len(pickle.loads(pickle.dumps(recording)).films('front_left')[0]) == 5


def test_memory_does_not_grow_with_a_recording(monkeypatch):
    monkeypatch.setattr('smart_tire.recording.MAX_IN_MEMORY', limit := 1 << 16)
    count, row = 50_000, 8 * 4 + 2  # two timestamps and two voltages; the order of reception
    recording, streams = SampleArrays(), 0
    tracemalloc.start()
    try:
        for stamp_ns in range(count):
            recording.add_sample(films(stamp_ns))
        streams = len(recording.stream(TireSample, 'front_left'))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert streams == count
    assert peak < 6 * limit + 1.5 * 2 * count  # two blocks of three arrays; the order
    assert len(pickle.dumps(recording)) < 1.1 * row * count


def test_a_file_that_cannot_grow_is_an_error(monkeypatch):
    monkeypatch.setattr('smart_tire.recording.MAX_IN_MEMORY', 1)
    monkeypatch.setattr('smart_tire.recording.TemporaryFile', lambda **_: SimpleNamespace(
        fileno=lambda: -1, write=len, close=lambda: None))
    with pytest.raises(BagError, match='0 MB of a recording cannot be kept there'):
        SampleArrays(map(films, range(1000)))


def test_planar_covariances_are_extracted_from_those_of_ros():
    poses = SampleArrays([odometry(EPOCH)]).poses()
    assert poses.covariance[0].tolist() == [[0, 1, 5], [6, 7, 11], [30, 31, 35]]
    assert poses.twist_sigma[0].tolist() == np.sqrt([0, 7, 35]).tolist()
    assert poses.twist[0].tolist() == [0.5, 0.1, 0.3]


def test_a_missing_twist_is_nan():
    poses = SampleArrays([odometry(EPOCH, twist_known=False)]).poses()
    assert np.isnan(poses.twist).all() and np.isfinite(poses.pose).all()


def test_yaw_is_unwrapped():
    turns = np.arange(0.0, 30.0, 0.5)
    recording = SampleArrays(odometry(EPOCH + i, yaw) for i, yaw in enumerate(turns))
    assert recording.poses().pose[:, 2] == pytest.approx(turns)


def test_films_are_stored_per_wheel_without_samples_of_fewer_films():
    recording = SampleArrays([
        *(TireSample(EPOCH + i, 'front_left', (1.0, 2.0)) for i in range(3)),
        TireSample(EPOCH + 3, 'front_left', (1.0,)), TireSample(EPOCH, 'front_right', (3.0, 4.0)),
        ImuSample(EPOCH, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0))])
    assert recording.film_wheels() == ['front_left', 'front_right']
    assert recording.films('front_left')[1].shape == (3, 2)
    assert recording.films('front_right')[1].tolist() == [[3.0, 4.0]]


def test_speeds_and_slips_are_returned_as_rows():
    recording = SampleArrays([WheelSample(EPOCH, (1.0, 2.0, 3.0, 4.0)), WheelSlip(
        EPOCH, (0.1, 0.2, 0.3, math.nan), (0.0,) * 4, (0.01, 0.02, 0.03, 1.0))])
    assert recording.speeds()[1].tolist() == [[1.0, 2.0, 3.0, 4.0]]
    assert recording.slips().ratio[0, :3].tolist() == [0.1, 0.2, 0.3]
    assert recording.slips().sigma[0].tolist() == [0.01, 0.02, 0.03, 1.0]


def test_seconds_have_nanosecond_resolution():
    stamps = np.array([EPOCH + 1, EPOCH + 2], np.int64)
    assert seconds(stamps, EPOCH).tolist() == [1e-9, 2e-9]


def test_interpolation_is_exact_on_lines_far_from_the_epoch():
    stamps = EPOCH + np.array([0, 100, 300], np.int64)
    values = np.array([[0.0, 1.0], [100.0, 2.0], [300.0, 4.0]])
    found = at(EPOCH + np.array([50, 200, 300], np.int64), stamps, values)
    assert found.tolist() == [[50.0, 1.5], [200.0, 3.0], [300.0, 4.0]]


def test_interpolation_is_nan_outside_in_gaps_and_next_to_a_nan():
    second = 1_000_000_000
    stamps = EPOCH + np.array([0, 1, 2, 3, 10], np.int64) * (second // 10)
    values = np.array([0.0, 1.0, math.nan, 3.0, 10.0])
    wanted = EPOCH + np.array([-5, 5, 15, 25, 65, 101], np.int64) * (second // 100)
    assert np.isnan(at(wanted, stamps, values)).tolist() == [True, False, True, True, True, True]
    assert not np.isnan(at(wanted, stamps, values, max_gap=1.0))[4]


def test_all_quantities_of_a_series_are_interpolated():
    poses = SampleArrays(odometry(EPOCH + k * 100_000_000, 0.2 * k) for k in range(3)).poses()
    found = poses.at(EPOCH + np.array([50_000_000, 100_000_000, 300_000_000], np.int64))
    assert type(found) is type(poses) and len(found) == 3
    assert found.pose[:, 2] == pytest.approx([0.1, 0.2, math.nan], nan_ok=True)
    assert found.covariance[:2].tolist() == poses.covariance[:2].tolist()
    assert found.twist_sigma[0].tolist() == poses.twist_sigma[0].tolist()
    assert np.isnan(found.columns()['v_x_sigma']).tolist() == [False, False, True]
