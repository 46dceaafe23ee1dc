# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Smoothed motion, slip, time offset and rolling shutter from given poses."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
import math

import numpy as np
import pytest
from smart_tire.parameters import RobotParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import NS_PER_S
from smart_tire.uncertain import Uncertain
from smart_tire.vision.localization import NOT_SQUARE, PoseFit
from smart_tire.vision.motion import (
    CameraMotion, ISOLATED, JUMP, MIN_IMAGES, motion_of, OFFSET_PRIOR, pixel_noise, row_time,
    slips_of, time_offset, unrolled, used, wheel_tracks)
from smart_tire.vision.smoothing import smooth
from support.overhead import (
    camera, corners, fixes_of, imu_samples, PARAMS, START_NS, wheel_samples)

ROBOT = RobotParams()
SURE = Uncertain(0.0, 0.0)
SPEED, RATE, DRIFT = 0.45, 0.6, -0.02  # m/s, rad/s, m/s: v_x, yaw rate, v_y


def turning(time):
    """Return x, y, yaw of a steady turn with a lateral speed."""
    yaw = 0.3 + RATE * time
    forward = SPEED / RATE * np.array([math.sin(yaw), -math.cos(yaw)])
    lateral = DRIFT / RATE * np.array([math.cos(yaw), math.sin(yaw)])
    return (*(forward + lateral), yaw)


def swinging(time):
    """Return x, y, yaw of a robot that turns to and fro in place."""
    return 0.1, 0.2, 0.8 * math.sin(1.3 * time)


def motion(fixes, offset=SURE):
    """Return the motion of fixes without gaps."""
    return motion_of(fixes, 0.1, offset, ROBOT)


def test_velocities_are_those_of_base_link():
    found = motion(fixes_of(turning))
    inner = found.twist[5:-5]
    assert np.abs(inner - [SPEED, DRIFT, RATE]).max() < 0.004
    assert np.abs(found.pose[:, :2] - [turning(1.0 + k / 15)[:2] for k in range(90)]).max() < 4e-4
    sample = found.odometry(0.087)[7]
    assert sample.stamp_ns == found.stamp_ns[7] == START_NS + round((1.0 + 7 / 15) * NS_PER_S)
    assert sample.position[2] == 0.087
    assert sample.twist_covariance[0] == found.twist_covariance[7, 0, 0]
    assert sample.twist_covariance[35] == found.twist_covariance[7, 2, 2]
    assert sample.pose_covariance[5] == found.pose_covariance[7, 0, 2]


def test_late_stamps_are_corrected_and_their_uncertainty_moves_the_pose():
    offset = Uncertain(0.08, 0.01)
    found = motion(fixes_of(turning, late=0.08), offset)
    assert found.stamp_ns[0] == pytest.approx(START_NS + NS_PER_S, abs=1)
    sure = motion(fixes_of(turning, late=0.08), Uncertain(0.08, 0.0))
    added = found.pose_covariance[40] - sure.pose_covariance[40]
    assert np.trace(added[:2, :2]) == pytest.approx(
        0.01 ** 2 * (SPEED ** 2 + DRIFT ** 2), rel=0.02)
    assert added[2, 2] == pytest.approx((0.01 * RATE) ** 2, rel=0.02)


def test_the_calibration_is_in_the_pose_only():
    fixes = fixes_of(turning)
    shared = [replace(fix, calibration=np.diag([1e-4, 4e-4, 9e-4])) for fix in fixes]
    plain, wider = motion(fixes), motion(shared)
    assert wider.twist_covariance == pytest.approx(plain.twist_covariance)
    assert wider.pose_covariance[3] - plain.pose_covariance[3] == pytest.approx(
        np.diag([1e-4, 4e-4, 9e-4]))


def test_a_start_is_neither_smoothed_away_nor_claimed_to_be_known():
    times = np.arange(90) / 15
    speed = np.where(times < 3.0, 0.0, np.minimum((times - 3.0) * 1.5, 0.5))
    fine = np.arange(9000) / 1500
    way = np.cumsum(np.where(fine < 3.0, 0.0, np.minimum((fine - 3.0) * 1.5, 0.5))) / 1500
    values = (way[::100] + 2e-4 * np.random.default_rng(2).standard_normal(90))[:, None]
    track = smooth(times, values, np.full((90, 1, 1), 4e-8))
    error = track.rates[:, 0] - speed
    sigma = np.sqrt(track.covariances[:, 1, 1])
    assert np.abs(error / sigma).max() < 5.0
    assert np.abs(error[5:40]).max() < 0.003 and np.abs(error[60:85]).max() < 0.003
    assert np.abs(error).max() < 0.06                     # m/s, of 0.5 within five images
    assert sigma[45:50].min() > 3.0 * np.median(sigma)  # while it accelerates
    assert track.noise == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize('factor', [0.5, 2.0])
def test_the_noise_of_the_measurements_is_estimated(factor):
    rng, times = np.random.default_rng(4), np.arange(300) / 15
    track = smooth(times, (0.3 * times + factor * 1e-3 * rng.standard_normal(300))[:, None],
                   np.full((300, 1, 1), 1e-6))
    assert track.noise == pytest.approx(factor, rel=0.15)
    assert np.abs(track.rates[20:-20] - 0.3).max() < 2e-3


def test_rates_are_interpolated_within_the_track_and_not_over_gaps():
    track = smooth(np.arange(6.0), np.arange(6.0)[:, None] ** 2, np.full((6, 1, 1), 1e-8))
    middle, variance = track.rates_at(np.array([2.5, 3.0]), 1.0)
    assert middle[1] == pytest.approx(track.rates[3])
    assert middle[0] == pytest.approx(0.5 * (track.rates[2] + track.rates[3]))
    assert (variance > 0.0).all()
    assert np.isnan(track.rates_at(np.array([-0.1, 5.1]), 1.0)[0]).all()
    assert np.isnan(track.rates_at(np.array([2.5]), 0.9)[0]).all()


def test_fixes_are_cut_at_gaps_and_short_rests_are_counted():
    fixes = fixes_of(turning)
    kept = fixes[:20] + fixes[29:29 + MIN_IMAGES - 1] + fixes[60:]
    refused = Counter()
    parts = used(kept, 0.1, refused)
    assert [len(part) for part in parts] == [20, 30]
    assert refused == {ISOLATED: MIN_IMAGES - 1}


def test_a_pose_that_jumps_is_refused_and_its_neighbors_are_not():
    fixes = fixes_of(turning)
    fixes[30] = replace(fixes[30], pose=fixes[30].pose + [0.5, 0.0, 0.0])
    refused = Counter()
    (part,) = used(fixes, 0.1, refused)
    assert refused == {JUMP: 1}
    assert [fix.stamp_ns for fix in part] == [
        fix.stamp_ns for fix in fixes_of(turning) if fix is not fixes[30]
        and fix.stamp_ns != fixes[30].stamp_ns]


def test_residuals_beyond_the_noise_are_refused_with_the_reason_of_the_fix():
    fixes = fixes_of(turning)
    fixes[10] = replace(fixes[10], squares=4 * (6 * 0.1) ** 2, reason=NOT_SQUARE)
    refused = Counter()
    assert sum(map(len, used(fixes, 0.1, refused))) == len(fixes) - 1
    assert refused == {NOT_SQUARE: 1}


def test_the_pixel_noise_ignores_outliers():
    rng = np.random.default_rng(1)
    fixes = [replace(fix, squares=float(np.sum((0.2 * rng.standard_normal(4)) ** 2)))
             for fix in fixes_of(turning, duration=20.0)]
    assert pixel_noise(fixes) == pytest.approx(0.2, rel=0.1)
    wrong = [replace(fix, squares=100.0) if k % 5 == 0 else fix for k, fix in enumerate(fixes)]
    assert pixel_noise(wrong) == pytest.approx(0.2, rel=0.25)


@pytest.mark.parametrize('late', [0.08, -0.03])
def test_the_time_offset_is_found_with_the_gyroscope(late):
    fixes = fixes_of(swinging, late=late)
    inputs = SampleArrays(imu_samples(lambda t: 0.01 + 0.8 * 1.3 * math.cos(1.3 * t)))
    offset, source = time_offset([fixes], inputs, ROBOT)
    assert offset.value == pytest.approx(late, abs=4.0 * offset.sigma)
    assert offset.sigma < 0.004
    assert source == 'from imu/data'


def test_the_time_offset_is_found_with_wheels_that_slip():
    def speeds(time):
        turn = 0.5 * ROBOT.track_width / 0.7 * 0.8 * 1.3 * math.cos(1.3 * time)
        return np.array([-turn, turn, -turn, turn]) / ROBOT.wheel_radius
    offset, source = time_offset(
        [fixes_of(swinging, late=0.08)], SampleArrays(wheel_samples(speeds)), ROBOT)
    # the body of the test does not lag behind the wheels as it would with mass
    lag = 0.08 - offset.value
    assert 0.0 < lag < 0.02
    assert offset.sigma == pytest.approx(0.5 * lag, rel=0.3)
    assert source == 'from wheel_states'


@pytest.mark.parametrize('inputs', [[], imu_samples(lambda t: 0.0)])
def test_a_time_offset_that_nothing_shows_is_uncertain(inputs):
    fixes = fixes_of(lambda t: (0.3 * t, 0.0, 0.0))
    offset, source = time_offset([fixes], SampleArrays(inputs), ROBOT)
    assert offset == (0.0, OFFSET_PRIOR)
    assert source.startswith('not estimated')


def straight(time):
    """Return x, y, yaw of a robot that drives backward after 3 s of rest."""
    return -0.4 * max(time - 3.0, 0.0), 0.1, 0.0


def slips(wheels, fixes=None, robot=ROBOT):
    """Return the slips of a robot that drives backward at 0.4 m/s from 3 s on."""
    found = motion(fixes or fixes_of(straight))
    return slips_of(found, wheel_tracks(SampleArrays(wheels), robot), robot)


def test_slip_is_b3_for_each_wheel_also_in_reverse():
    ratio = np.array([0.1, -0.1, 0.3, 0.0])
    speed = -0.4 / (1.0 - ratio) / ROBOT.wheel_radius
    found = slips(wheel_samples(lambda t: speed if t >= 3.0 else 0.0 * speed))
    steady = [slip for slip in found if slip.stamp_ns > START_NS + 4.5 * NS_PER_S]
    assert len(steady) > 20
    errors = np.array([slip.ratio for slip in steady]) - ratio
    assert np.abs(errors).max() < 0.01
    assert np.sqrt(np.mean(errors ** 2)) < 0.004
    assert (np.abs(errors) < 5.0 * np.array([slip.sigma for slip in steady])).all()
    expected = np.array([speed * ROBOT.wheel_radius + 0.4])
    assert np.abs(np.array([slip.slip_velocity for slip in steady]) - expected).max() < 0.005
    rest = [slip for slip in found if slip.stamp_ns < START_NS + 2.5 * NS_PER_S]
    assert all(np.isnan(slip.ratio).all() and slip.sigma == (1.0,) * 4 for slip in rest)


def test_a_locked_wheel_on_a_moving_robot_is_minus_one_and_a_missing_encoder_is_nan():
    speed = np.array([-0.4, 0.0, -0.4, math.nan]) / ROBOT.wheel_radius
    found = slips(wheel_samples(lambda t: speed if t >= 3.0 else 0.0 * speed))
    assert len(found) > 80
    for slip in found[60:80]:
        assert slip.ratio[1] == -1.0
        assert math.isnan(slip.ratio[3]) and slip.sigma[3] == 1.0


def steady_slips(wheels, **changes):
    """Return slips of a robot whose twist is known with a given covariance."""
    robot = replace(ROBOT, **changes)
    stamps = tuple(START_NS + round((2.0 + k / 15) * NS_PER_S) for k in range(60))
    spread = np.array([[9e-4, 0.0, 1e-3], [0.0, 1.0, 0.0], [1e-3, 0.0, 4e-3]])
    return slips_of(CameraMotion(stamps, np.zeros((60, 3)), np.tile([0.4, 0.0, 0.2], (60, 1)), *[
        np.tile(spread, (60, 1, 1))] * 2, 1.0), wheel_tracks(SampleArrays(wheels), robot), robot)


def test_the_sigma_of_slip_is_that_of_velocity_and_radius():
    wheels = wheel_samples(lambda t: np.full(4, 0.5) / ROBOT.wheel_radius)
    arm = 0.5 * ROBOT.track_width
    for side, sign in ((0, -1.0), (1, 1.0)):  # a turn to the left is faster on the right
        ground = 9e-4 + 2.0 * sign * arm * 1e-3 + arm ** 2 * 4e-3
        share = (0.4 + sign * arm * 0.2) / 0.5
        for radius in (0.0, 0.05):
            found = steady_slips(wheels, wheel_radius_sigma=radius)
            assert found[30].sigma[side] == pytest.approx(
                math.sqrt(ground / 0.25 + (share * radius) ** 2), rel=0.01)


def test_the_sigma_of_slip_is_that_of_the_encoder():
    encoder, rng = replace(ROBOT.encoder, counts_per_revolution=60), np.random.default_rng(6)
    noise = math.tau / 60 / math.sqrt(6.0)  # rad, of two edges of a count
    wheels = [replace(one, position=tuple(one.position + noise * rng.standard_normal(4)))
              for one in wheel_samples(lambda t: np.full(4, 0.5) / ROBOT.wheel_radius)]
    found = steady_slips(wheels, encoder=encoder, wheel_radius_sigma=0.0)
    plain = steady_slips(wheel_samples(lambda t: np.full(4, 0.5) / ROBOT.wheel_radius),
                         wheel_radius_sigma=0.0)
    error = np.subtract([one.ratio for one in found], [one.ratio for one in plain])
    added = np.square([one.sigma for one in found]) - np.square([one.sigma for one in plain])
    assert 0.3 < np.mean(error ** 2) / np.mean(added) < 3.0


def test_the_outer_wheels_of_a_turn_are_faster():
    fixes = fixes_of(turning)
    side = 0.5 * ROBOT.track_width * RATE
    speed = np.array([SPEED - side, SPEED + side] * 2) / ROBOT.wheel_radius
    found = slips(wheel_samples(lambda t: speed), fixes)
    assert np.abs([slip.ratio for slip in found[10:-10]]).max() < 0.015


def test_wheels_that_fall_silent_give_no_slip():
    speed = np.full(4, -0.4) / ROBOT.wheel_radius
    wheels = wheel_samples(lambda t: speed)
    silent = [one for one in wheels if not 4.0 < (one.stamp_ns - START_NS) / NS_PER_S < 5.0]
    times = [(slip.stamp_ns - START_NS) / NS_PER_S for slip in slips(silent)]
    assert not any(4.1 < time < 4.9 for time in times)
    assert any(time > 5.1 for time in times) and any(time < 3.9 for time in times)
    assert slips(wheels[:2]) == []


def test_speeds_serve_where_the_angles_are_missing():
    speed = np.full(4, -0.5) / ROBOT.wheel_radius
    wheels = [replace(one, position=None) for one in wheel_samples(lambda t: speed)]
    ratios = [slip.ratio for slip in slips(wheels)][60:-8]
    assert np.abs(np.array(ratios) - 0.2).max() < 0.01


@pytest.mark.parametrize('line', [0.0, 3e-5, -2e-5])
def test_a_rolling_shutter_is_found_and_its_effect_removed(line):
    rng, one = np.random.default_rng(5), camera()
    fit, found = PoseFit(one, PARAMS, 0.087), []
    for k in range(40):
        time = 1.0 + k / 15
        quads = [corners(one, PARAMS, turning(time))[0]]
        for _ in range(3):  # each corner at the time of its row
            quads.append(np.array([
                corners(one, PARAMS, turning(time + line * (corner[1] - 359.5)))[0][i]
                for i, corner in enumerate(quads[-1])]))
        found.append(fit.fix(START_NS + round(time * NS_PER_S), {
            0: quads[-1] + 0.02 * rng.standard_normal((4, 2))}))
    moved = motion_of(found, 0.02, SURE, ROBOT)
    estimate = row_time([found], [moved], 0.02)
    assert estimate.value == pytest.approx(line, abs=4.0 * estimate.sigma)
    assert estimate.sigma < 2e-6
    poses = np.array([fix.pose[:2] for fix in unrolled(found, moved, line)])
    truth = np.array([turning(1.0 + k / 15)[:2] for k in range(40)])
    assert np.abs(poses - truth).max() < 5e-4
    if line:
        assert np.abs([fix.pose[:2] for fix in found] - truth).max() > 1.5e-3
