# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Evaluation of a demo run: radio batches and timestamp errors."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from smart_tire.analysis.drive_report import (
    camera_errors, demo_lines, host_lines, radio_counts, read_conversions, read_run, stamp_errors)
from smart_tire.analysis.result import Result
from smart_tire.host_load import HostLoad
from smart_tire.recording import SampleArrays
from smart_tire.rotation import quaternion
from smart_tire.samples import NS_PER_S, Odometry, TireSample, WheelSlip
from support.ideal_robot import odometry
from support.recordings import write_bag

PERIOD = 2_500_000  # ns
START = 1_700_000_000_000_000_000


@pytest.fixture
def log(tmp_path):
    """Return the log of 20 batches of 16 conversions, of which two were dropped."""
    rows = ['wheel,sequence,dropped,stamps_ns']
    for k in range(20):
        stamps = ' '.join(str(START + (16 * k + i) * PERIOD) for i in range(16))
        rows.append(f'front_left,{k},{int(k in (5, 11))},{stamps}')
    path = tmp_path / 'log.csv'
    path.write_text('\n'.join(rows) + '\nfront_left,20,0')  # truncated
    return path


def received(log, offset_ns=0, lost=()):
    series = SampleArrays()
    for k, batch in enumerate(read_conversions(log)):
        if not batch.dropped and k not in lost:
            for stamp in batch.stamp_ns:
                series.add_sample(TireSample(int(stamp) + offset_ns, 'front_left', (1.65, 1.65)))
    return series


@pytest.mark.parametrize('lost', [(), (7, 8)])
def test_batches_are_missing_if_lost_but_not_by_the_radio(log, lost):
    counts = radio_counts(received(log, lost=lost), read_conversions(log))
    assert counts == {'sent': 20, 'dropped': 2, 'missing': len(lost)}


def test_timestamp_errors_are_relative_to_the_true_conversion_times(log):
    score = stamp_errors(received(log, 300_000), read_conversions(log))['front_left']
    assert score.mean == pytest.approx(0.3e-3)
    assert score.rms == pytest.approx(0.3e-3)
    assert np.isclose(score.within_one, 1.0)


TREE = {'against_truth': None, 'duration_s': 60.0, 'messages': {'odom': 10}, 'stamps': {},
        'radio': {'sent': 9, 'dropped': 0, 'missing': 2}, 'tracking': {}, 'simulated': [],
        'host': None}


@pytest.mark.parametrize('typical, late', [(0.019, False), (0.031, True)])
def test_late_timers_of_a_real_robot_are_one_line_with_the_load(typical, late):
    host = HostLoad(typical, 0.4, 36.0, 2)
    said = 'host late: timers late by 31 ms (99%), load 36.0 on 2 cores: end other programs'
    tree = {**TREE, 'host': {'late': late, **asdict(host)}}
    assert list(host_lines(tree)) == late * [said]
    assert not list(host_lines(TREE))
    assert list(host_lines({**tree, 'simulated': ['slow']})) == ['slow']


def test_a_busy_host_comes_before_all_results():
    lines = demo_lines({**TREE, 'simulated': ['0.5 x real time', 'starved']})
    assert [line.partition(' ')[0] for line in lines] == ['recorded', '0.5', 'starved', 'radio']


def motion(stamp_ns, x=0.0, yaw=0.0, ratio=0.1, sigma=0.01):
    """Return a pose with standard deviations of 2 mm and 0.02 rad, and a slip."""
    covariance = np.diag([2e-3, 2e-3, 1.0, 1.0, 1.0, 0.02]).ravel() ** 2
    time = (stamp_ns - START) / NS_PER_S
    return (Odometry(stamp_ns, (time + x, 0.0, 0.0), quaternion(0.0, 0.0, 3.1 + time + yaw),
                     (0.0,) * 3, (0.0,) * 3, tuple(covariance), tuple(covariance)),
            WheelSlip(stamp_ns, (ratio,) * 4, (0.0,) * 4, (sigma,) * 4))


def test_the_camera_of_a_demo_is_compared_at_its_own_stamps():
    truth = SampleArrays(one for k in range(101) for one in motion(START + k * 10_000_000))
    camera = SampleArrays(one for k, sigma in (
        (3, 0.01), (55, 0.01), (80, 0.5), (900, 0.01))  # the last without truth
        for one in motion(START + k * 10_000_000 + 3_000_000, 0.004, 0.01,
                          0.1 if sigma > 0.1 else 0.12, sigma))
    found = camera_errors(Result(SampleArrays(), truth=truth, camera=camera))
    assert (found['position']['count'], found['yaw']['count'], found['slip']['count']) == (6, 3, 8)
    assert found['position']['rms'] == pytest.approx(0.004 / np.sqrt(2.0))  # of x and y
    assert found['yaw']['rms'] == pytest.approx(0.01)
    assert found['slip']['rms'] == pytest.approx(0.02)
    assert found['slip']['normalized_rms'] == pytest.approx(2.0)
    tree = {**TREE, 'camera': found}
    assert list(demo_lines(tree))[-3:] == [
        'position error of the overhead camera: 0.0028 m rms per axis, 1.41 of its '
        'standard deviation',
        'yaw error of the overhead camera: 0.5730 deg rms, 0.50 of its standard deviation',
        'slip error of the overhead camera: 0.0200 rms where its sigma is below 0.02, 2.00 of its '
        'standard deviation']
    assert len(list(demo_lines({**tree, 'camera': None}))) == len(list(demo_lines(tree))) - 3


def test_poses_without_slip_or_truth_are_no_error():
    camera = SampleArrays(motion(START)[:1])
    truth = SampleArrays(one for k in range(-1, 2) for one in motion(START + k * 10_000_000))
    found = camera_errors(Result(SampleArrays(), truth=truth, camera=camera))
    assert (found['yaw']['count'], found['slip']['count']) == (1, 0)
    assert camera_errors(Result(SampleArrays(), camera=camera))['yaw']['count'] == 0


def test_without_poses_of_a_camera_there_are_no_errors_of_it():
    assert camera_errors(Result(SampleArrays())) is None


def test_the_camera_of_a_recorded_drive_is_the_reference(tmp_path):
    events = []
    for i in range(20):
        stamp_ns = NS_PER_S + i * NS_PER_S // 20
        slip = WheelSlip(stamp_ns, (0.1,) * 4, (0.0,) * 4, (0.02,) * 4)
        events += [(stamp_ns, 'odom', odometry(stamp_ns, 0.02 * i, v_x=0.4, variance=0.01)),
                   (stamp_ns, 'wheel_slip', slip), (stamp_ns, 'overhead/wheel_slip', slip),
                   (stamp_ns, 'overhead/odom', odometry(stamp_ns, 5.0, v_x=0.5))]
    run = read_run(write_bag(tmp_path / 'drive', events))
    assert run.tree['against_truth'] is None
    assert run.tree['against_camera']['pose']['twist']['v_x']['mean'] == pytest.approx(-0.1)
    assert len(run.result.estimates.poses().stamp_ns) == 20
