# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction maps of bags: poses in the map, files, figure."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from smart_tire.analysis.friction_map import (
    CELLS, FIGURE, FILES, in_map, localization, LOCALIZED, MAP, map_figure, robot_name, track_of,
    TRANSFORMS, write_map, write_mask)
from smart_tire.bags import Bag, BagWriter, channel_of
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.mapping.grid import friction_map
from smart_tire.mapping.raster import read_raster, speed_mask
from smart_tire.mapping.track import FrictionTrack, SPACING
from smart_tire.parameters import RobotParams, TrajectoryControllerParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import GroundState, NS_PER_S
from smart_tire.uncertain import Uncertain
from support.ideal_robot import odometry
from support.recordings import stream


def drive(seconds=4.0, drift=0.0, **start):
    """Return poses of a robot that drives a curve, with an error of yaw that grows."""
    found = SampleArrays()
    for t in np.arange(0.0, seconds, 0.02):
        yaw = 0.3 * t
        x, y = math.sin(yaw) / 0.6, (1.0 - math.cos(yaw)) / 0.6
        turn, x_0, y_0 = start.get('yaw', 0.0), start.get('x', 0.0), start.get('y', 0.0)
        found.add_sample(odometry(
            round(t * NS_PER_S), x_0 + math.cos(turn) * x - math.sin(turn) * y,
            y_0 + math.sin(turn) * x + math.cos(turn) * y, yaw + turn + drift * t,
            v_x=0.5, variance=start.get('variance', 0.0) * (1.0 + t)))
    return found


def test_poses_of_the_odometry_become_those_in_the_map():
    odom, true = drive(drift=0.01, variance=1e-4), drive(x=3.0, y=-2.0, yaw=1.2, variance=1e-6)
    rows = np.arange(0, 200, 7)
    seen = true.poses()
    sparse = type(seen)(*(getattr(seen, name)[rows] for name in (
        'stamp_ns', 'pose', 'twist', 'covariance', 'twist_sigma')))
    found = in_map(odom.poses(), sparse)
    np.testing.assert_allclose(found.pose[7:190], seen.pose[7:190], atol=2e-3)
    # the variance of the odometry since the latest reference, 0.14 s ago at most
    assert found.covariance[190, 0, 0] < 2e-5 < odom.poses().covariance[190, 0, 0]
    blind = in_map(odom.poses(), type(seen)(*(getattr(seen, name)[:10] for name in (
        'stamp_ns', 'pose', 'twist', 'covariance', 'twist_sigma'))))
    assert blind.covariance[-1, 0, 0] == pytest.approx(1e-4 * 3.8, rel=0.05)


@pytest.mark.parametrize(('seen', 'frame'), [(True, 'map'), (False, 'odom')])
def test_a_drive_is_mapped_where_the_camera_has_seen_it(seen, frame):
    estimates = drive(variance=1e-6)
    for seconds in (1, 2, 3):
        estimates.add_sample(GroundState(
            seconds * NS_PER_S, Uncertain(50.0, 2.0), Uncertain(0.4, 0.02)))
    camera = drive(x=10.0, variance=1e-6) if seen else SampleArrays()
    track = track_of(estimates, camera, RobotParams(), drive='a')
    assert (track.frame, track.drive, track.robot) == (frame, 'a', '')
    assert (track.position[:, 0].min() > 9.0) == seen


def write_transforms(path, transforms):
    """Write a bag with (time [s], parent, child, x, y, yaw) on /tf, and a damaged message."""
    write = Encoder(TRANSFORMS)
    with BagWriter(path) as writer:
        writer.add_topic(channel_of('/tf', TRANSFORMS))
        writer.write('/tf', 1, b'\0\1\0\0\7\0\0\0')
        for t, parent, child, x, y, yaw in transforms:
            one = empty('geometry_msgs/msg/TransformStamped')
            stamp_ns = round(t * NS_PER_S)
            one.header.stamp.sec, one.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
            one.header.frame_id, one.child_frame_id = parent, child
            one.transform.translation.x, one.transform.translation.y = x, y
            one.transform.rotation.z, one.transform.rotation.w = (
                math.sin(0.5 * yaw), math.cos(0.5 * yaw))
            writer.write('/tf', stamp_ns, write(SimpleNamespace(transforms=[one])))


def test_transforms_in_the_bag_lead_to_the_map(tmp_path):
    estimates = drive(drift=0.02, variance=1e-6)
    poses, true = estimates.poses(), drive(x=3.0, y=-2.0, yaw=1.2).poses()
    lines = [(9.0, 'map', 'odom', 99.0, 99.0, 0.0), (1.0, 'odom', 'base_link', 9.0, 9.0, 0.0),
             (1.0, 'map', 'other/odom', 9.0, 9.0, 0.0)]
    for row in range(20, 200, 20):
        (x, y, yaw), (own_x, own_y, own_yaw) = true.pose[row], poses.pose[row]
        turn = yaw - own_yaw
        lines.append((row * 0.02, 'map', 'odom', x - math.cos(turn) * own_x
                      + math.sin(turn) * own_y, y - math.sin(turn) * own_x
                      - math.cos(turn) * own_y, turn))
    write_transforms(tmp_path / 'bag', lines)
    for seconds in (1, 2, 3):
        estimates.add_sample(GroundState(
            seconds * NS_PER_S, Uncertain(50.0, 2.0), Uncertain(0.4, 0.02)))
    with Bag(tmp_path / 'bag') as bag:
        seen = localization(bag, poses, RobotParams())
        np.testing.assert_array_equal(seen.stamp_ns, true.stamp_ns[20:200:20])
        np.testing.assert_allclose(seen.pose, true.pose[20:200:20], atol=1e-6)
        np.testing.assert_allclose(seen.covariance[0], np.diag(np.square(LOCALIZED)))
        assert bag.faults.rejected == {'/tf': 1}
        assert not len(localization(bag, poses, RobotParams(frame_prefix='r1/')))
        track = track_of(estimates, SampleArrays(), RobotParams(), bag, drive='a')
        camera = track_of(estimates, drive(x=10.0, variance=1e-6), RobotParams(), bag, drive='a')
    assert track.frame == 'map' and track.position[:, 1].min() < -1.5
    assert track.covariance[:, 0].min() > LOCALIZED[0] ** 2
    assert camera.position[:, 0].min() > 9.0  # which is more accurate


def test_a_transform_from_before_the_drive_counts(tmp_path):
    write_transforms(tmp_path / 'bag', [(0.0, 'map', 'odom', 1.0, 2.0, 0.0)])
    with Bag(tmp_path / 'bag') as bag:
        found = in_map(drive().poses(), localization(bag, drive().poses(), RobotParams()))
    np.testing.assert_allclose(found.pose, drive().poses().pose + [1.0, 2.0, 0.0], atol=1e-9)


def test_the_namespace_of_a_bag_names_its_robot(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        for receive_ns, topic, sample in stream(0.5):
            writer.write_sample(topic, receive_ns, sample)
    with Bag(tmp_path / 'bag') as bag:
        assert robot_name(bag) == ''
        bag.match = lambda wanted: {'wheel_states': '/fleet/r7/wheel_states'}
        assert robot_name(bag) == 'fleet/r7'


@pytest.fixture(scope='module')
def found():
    """Return a map of two drives, and their tracks."""
    x = np.arange(0.0, 2.0, SPACING)
    ones = np.ones(len(x))
    tracks = [FrictionTrack(
        np.arange(len(x)) + day * 10 ** 12, np.column_stack([x + 0.01, 0.05 * ones]),
        np.outer(ones, [1e-8, 0.0, 1e-8]), mu * ones, 0.02 * ones, 0.01 * ones,
        np.zeros(len(x), int), np.zeros(len(x), int), drive=str(day))
        for day, mu in enumerate((0.45, 0.1))]
    return friction_map(tracks), tracks


def test_the_files_of_a_map(found, tmp_path):
    made, tracks = found
    write_map(tmp_path, made, tracks)
    assert {path.name for path in tmp_path.iterdir()} == {*FILES, 'bag'}
    raster = read_raster(tmp_path / f'{MAP}.yaml')
    np.testing.assert_allclose(raster.friction, 0.1, atol=0.005)
    lines = (tmp_path / CELLS).read_text().splitlines()
    assert lines[0] == 'stamp_ns,first_ns,x,y,friction,sigma,drives,current'
    assert len(lines) == 1 + 2 * 20  # the ground before the change, too
    with Bag(tmp_path / 'bag') as bag:
        (_, topic, grid), = bag.samples([MAP])
    assert (topic, grid.columns, grid.frame) == (MAP, 20, 'odom')
    assert set(grid.values) == {10}
    assert (tmp_path / FIGURE).stat().st_size > 5_000


def test_the_mask_has_the_limits_of_the_controller(found, tmp_path):
    made, _ = found
    params = TrajectoryControllerParams(max_speed=2.0)
    write_mask(tmp_path, made, params, 0.3)
    mask = speed_mask(made.raster, params.friction, 0.3, 2.0)
    assert 0 < mask.min() < 100
    assert (tmp_path / 'speed_mask.yaml').read_text().startswith('image: speed_mask.png\n')


def test_the_figure_shows_friction_and_its_error_with_the_tracks(found):
    made, tracks = found
    figure = map_figure(made, tracks)
    (friction, sigma), = figure.rows
    assert friction.field.values is made.raster.friction
    assert sigma.field.values is made.raster.sigma
    assert friction.field.extent == pytest.approx((0.0, 2.0, 0.0, 0.1))
    assert len(friction.marks) == 4
    assert '20 of 20 cells have changed' in figure.caption


def test_lines_end_where_a_track_does(found):
    made, (track, _) = found
    rows = np.abs(track.position[:, 0] - 1.0) > 0.2
    broken = FrictionTrack(*(getattr(track, name)[rows] for name in (
        'stamp_ns', 'position', 'covariance', 'friction', 'sigma', 'common', 'side', 'block')))
    line = map_figure(made, [broken]).rows[0][0].marks[0].curve
    assert len(line.x) == rows.sum() + 1 and np.isnan(line.x).sum() == np.isnan(line.y).sum() == 1
    whole = map_figure(made, [track]).rows[0][0].marks[0].curve
    np.testing.assert_array_equal(whole.x, track.position[:, 0])
