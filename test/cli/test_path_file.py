# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Paths from CSV files and bags: formats, errors with line numbers, placement."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.bags import BagWriter
from smart_tire.cli._path_file import extent, length, placed, read_path, scaled
from smart_tire.errors import ParameterError
from smart_tire.samples import WheelSlip
from support.ideal_robot import odometry

POSES = ((0.0, 0.0, 0.0), (1.0, 0.5, 0.3))


def written(tmp_path, text):
    path = tmp_path / 'path.csv'
    path.write_text(text, encoding='utf-8')
    return path


@pytest.mark.parametrize('text', [
    '0,0,0\n1,0.5,0.3\n', 'x,y,yaw\n0,0,0\n1,0.5,0.3',
    'X, Y, Yaw\n\n0, 0, 0\n# a corner\n1,.5,3e-1\n',
    '\ufeffx,y,yaw\r\n0,0,0\r\n1,0.5,0.3\r\n'])
def test_a_file_may_have_a_header_comments_and_empty_lines(tmp_path, text):
    assert read_path(written(tmp_path, text)) == POSES


@pytest.mark.parametrize('text', ['0,0\n1,0.5\n', 'x,y\n0,0\n1,0.5\n'])
def test_without_yaw_the_orientation_is_unknown(tmp_path, text):
    poses = read_path(written(tmp_path, text))
    assert [pose[:2] for pose in poses] == [pose[:2] for pose in POSES]
    assert all(math.isnan(yaw) for _, _, yaw in poses)


@pytest.mark.parametrize('text, message', [
    ('x,y\n0,0\n1\n', 'line 3: 1 columns, expected 2 as before'),
    ('0,0\n1,2,3\n', 'line 2: 3 columns, expected 2 as before'),
    ('x,y\n0,0\n\n1,two\n', "line 4: 'two' is not a number"),
    ('0,0\n1,nan\n', 'line 2: y is nan'),
    ('0,0\ninf,0\n', 'line 2: x is inf'),
    ('0,0\n500000,5000000\n', 'line 2: x is 500000.0, expected at most 100000'),
    ('lat,lon\n0,0\n', "line 1: header 'lat,lon', expected x,y or x,y,yaw"),
    ('0\n1\n', 'line 1: 1 columns, expected x,y or x,y,yaw'),
    ('0,0,0,0\n', 'line 1: 4 columns, expected x,y or x,y,yaw'),
    ('', '0 poses, expected a path of two places'),
    ('x,y\n1,1\n1,1\n', '2 poses, expected a path of two places')])
def test_errors_name_the_line_and_what_is_expected(tmp_path, text, message):
    with pytest.raises(ParameterError, match=message):
        read_path(written(tmp_path, text))


def arc(unit=1.0, begin=0.0, angle=math.pi, backwards=0.0):
    """Return the text of an arc to the left; ``unit`` per rad."""
    return '\n'.join(f'{math.sin(yaw)},{-math.cos(yaw)},{unit * (yaw + backwards)}'
                     for yaw in (begin + angle * k / 200 for k in range(201)))


DEGREES = 180.0 / math.pi


@pytest.mark.parametrize('text', [
    arc(DEGREES), arc(DEGREES, angle=0.01), arc(DEGREES, -0.05, 0.1, math.pi),
    arc(DEGREES, begin=0.03, angle=0.05), arc(DEGREES, 0.7, 0.2), '0,0,90\n1,0,90\n',
    '0,0,0\n1,0,0\n1,0,90\n', '0,0,45\n1,1,45\n2,2,45\n', '0,0,180\n-1,0,180\n-2,0,180\n',
    '0,0,4\n2,0.1,4\n4,0.2,4\n'])
def test_yaws_in_degrees_are_refused(tmp_path, text):
    with pytest.raises(ParameterError, match='path.csv: yaw is up to .*in degrees.* Convert it'):
        read_path(written(tmp_path, text))


@pytest.mark.parametrize('text', [
    arc(), arc(begin=-3.0), arc(angle=20.0), arc(backwards=math.pi), arc(begin=9.0, angle=0.1),
    '0,0,0\n1,0,1.57\n', '0,0,1.57\n1,0,1.57\n', '0,0,0\n1,0,0\n2,0,0\n3,0,3\n',
    '0,0,0\n1,0,0\n1,0,1.57\n1,1,1.57\n', '0,0,1\n1,0,2\n1,1,3\n0,1,1\n0,0,2\n'])
def test_yaws_in_radians_turns_in_place_and_backward_motion_are_read(tmp_path, text):
    assert len(read_path(written(tmp_path, text))) > 1


def test_a_binary_file_is_not_a_path(tmp_path):
    path = tmp_path / 'path.csv'
    path.write_bytes(b'\xff\xfe\x00')
    with pytest.raises(ParameterError, match='not a CSV file'):
        read_path(path)


def test_a_recorded_drive_is_a_path(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        for k in range(101):
            writer.write_sample('odom', k, odometry(k, 0.01 * k, 1.0, 0.4))
    poses = read_path(tmp_path)  # also the folder of the bag
    assert poses[0] == pytest.approx((0.0, 1.0, 0.4))
    assert poses[-1] == pytest.approx((1.0, 1.0, 0.4))
    assert len(poses) < 22 and length(poses) == pytest.approx(1.0)


def test_a_bag_without_poses_is_refused(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_sample('wheel_slip', 0, WheelSlip(0, (0.0,) * 4, (0.0,) * 4, (0.1,) * 4))
    with pytest.raises(ParameterError, match='no messages on odom'):
        read_path(tmp_path / 'bag')


def test_the_first_pose_is_placed_at_the_robot():
    path = ((2.0, 1.0, 0.5), (2.0 + math.cos(0.5), 1.0 + math.sin(0.5), 0.5))
    begin, end = placed(path, (5.0, -1.0, math.pi / 2))
    assert begin == pytest.approx((5.0, -1.0, math.pi / 2))
    assert end == pytest.approx((5.0, 0.0, math.pi / 2))


def test_without_yaw_x_is_ahead_of_the_robot_and_y_to_its_left():
    begin, end = placed(((1.0, 0.0, math.nan), (1.0, 2.0, math.nan)), (0.0, 0.0, math.pi / 2))
    assert begin[:2] == (0.0, 0.0) and end[:2] == pytest.approx((-2.0, 0.0))
    assert np.isnan([begin[2], end[2]]).all()


def test_the_scale_keeps_the_shape():
    assert scaled(POSES, 2.0) == ((0.0, 0.0, 0.0), (2.0, 1.0, 0.3))
    assert extent(POSES) == pytest.approx(math.hypot(1.0, 0.5))
