# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Odometry as published: continuous, at its own rate, and fused by another filter."""

from array import array
from dataclasses import replace
from functools import cache
import math
from pathlib import Path

from benchmarks.scenarios import sequence
import numpy as np
import pytest
from scipy.stats import chi2
from smart_tire.analysis.pipeline import EstimatorParams, INPUTS, Pipeline
from smart_tire.bags import Bag
from smart_tire.estimation.slip import estimator as slip_estimator
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.odometry import OdometryOutput, planar, planar_pose
from smart_tire.estimation.slip.output import ContinuousPose, SlipOutputBuilder
from smart_tire.estimation.slip.state import AGREEMENT_SIGMAS, CORRECTION_TIME
from smart_tire.parameters import build, SimulatorParams, SlipEstimatorParams
from smart_tire.rotation import quaternion
from smart_tire.samples import NS_PER_S, Odometry
from smart_tire.simulation.offline import simulate
from support.real_recordings import real_recording
from support.twist_fusion import planar_twist, TwistFusion
import yaml

pytestmark = pytest.mark.slow

PERIOD_NS = 8_000_000
MAX_STEP = 2e-3  # m beyond the twist in a period
PAGE = Path(__file__).parents[3] / 'docs' / 'how_to' / 'robot_localization.md'
# as in the demo: circles on concrete, then to the sand, where the ground is reported late
LEGS, END = sequence((9.0, 120.0, 60.0), (9.0, 60.0, 120.0), (4.0, 120.0, 120.0),
                     (9.0, 120.0, 60.0), (2.0, 0.0, 0.0))


def odometry(index, pose, twist=(0.0, 0.0, 0.0), sigmas=(0.01, 0.005, 0.01)):
    """Return an estimate at an instant of the grid, with a pose covariance of 1 in x."""
    x, y, yaw = pose
    twist_covariance, pose_covariance = [0.0] * 36, [0.0] * 36
    for row, sigma in zip((0, 7, 35), sigmas):
        twist_covariance[row] = sigma ** 2
    pose_covariance[0] = 1.0
    return Odometry(index * PERIOD_NS, (x, y, 0.0), quaternion(0.02, -0.01, yaw),
                    (*twist[:2], 0.0), (0.0, 0.0, twist[2]), tuple(pose_covariance),
                    tuple(twist_covariance))


def follower():
    """Return a function that gives an estimate the continuous pose."""
    pose = ContinuousPose()

    def follow(estimate):
        covariance = array('d', estimate.pose_covariance)
        x, y, yaw = pose.follow(
            estimate.stamp_ns, planar_pose(estimate), planar_twist(estimate), covariance,
            array('d', estimate.twist_covariance))
        return replace(estimate, position=(x, y, 0.0), orientation=quaternion(0.02, -0.01, yaw),
                       pose_covariance=tuple(covariance))

    return follow


def offset(pose, wanted):
    """Return the difference of two poses in the body axes of the first one."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy, turn = np.subtract(wanted, pose)
    return c * dx + s * dy, c * dy - s * dx, math.remainder(turn, math.tau)


def beyond_twist(found):
    """Return the motion (n, 3) of the pose beyond the integrated twist, along its axes."""
    motions = []
    for one, two in zip(found, found[1:]):
        dt = (two.stamp_ns - one.stamp_ns) / NS_PER_S
        before, after = planar_pose(one), planar_pose(two)
        middle = (*before[:2], before[2] + 0.5 * math.remainder(after[2] - before[2], math.tau))
        motions.append(np.subtract(offset(middle, after), np.multiply(
            0.5 * dt, np.add(planar_twist(one), planar_twist(two)))))
        motions[-1][2] = math.remainder(after[2] - before[2], math.tau) - 0.5 * dt * (
            one.angular[2] + two.angular[2])
    return np.array(motions)


def steps(found):
    """Return the lengths (n,) [m] of the motions of the position beyond the twist."""
    return np.hypot(*beyond_twist(found)[:, :2].T)


def estimates(params=None, **values):
    estimator = SlipEstimator(params or build(SlipEstimatorParams, values))
    return lambda samples: [one for sample in samples for one in estimator.update(sample)
                            if isinstance(one, Odometry)]


@cache
def driven(seed):
    """Return the odometry of the whole stack in a drive like the demo, and the true one."""
    events, pipeline = simulate(SimulatorParams(seed=seed), LEGS, END), Pipeline(EstimatorParams())
    return ([one for _, topic, sample in events if topic in INPUTS
             for one in pipeline.update(sample) if isinstance(one, Odometry)],
            {sample.stamp_ns: sample for _, topic, sample in events
             if topic == 'ground_truth/odom'})


# -- continuous pose -----------------------------------------------------------------------------


def test_a_correction_is_worked_in_at_the_bounded_rate_and_until_it_is():
    follow = follower()
    found = [follow(odometry(k, (0.008 * k + 0.05 * (k > 10), 0.0, 0.0), (1.0, 0.0, 0.0)))
             for k in range(800)]
    extra = beyond_twist(found)
    assert extra[:10] == pytest.approx(0.0, abs=1e-12)
    assert extra[10:250, 0] == pytest.approx(AGREEMENT_SIGMAS * 0.01 * 0.008, rel=1e-6)
    assert found[-1].position[0] == pytest.approx(0.008 * 799 + 0.05, abs=1e-6)


def test_a_small_correction_decays_with_its_time_constant():
    follow = follower()
    follow(odometry(0, (0.0, 0.0, 0.0)))
    found = [follow(odometry(k, (1e-3, 0.0, 0.0))) for k in range(1, 76)]  # 0.6 s
    assert 1e-3 - found[-1].position[0] == pytest.approx(
        1e-3 * math.exp(-0.6 / CORRECTION_TIME))


@pytest.mark.parametrize('turn', [0.0, 2.0])
def test_each_axis_of_the_robot_is_corrected_within_its_own_sigma(turn):
    follow = follower()
    follow(odometry(0, (0.0, 0.0, turn)))
    c, s = math.cos(turn), math.sin(turn)
    found = follow(odometry(1, (c - s, s + c, turn + 0.5)))
    assert offset((0.0, 0.0, turn), planar_pose(found)) == pytest.approx(
        np.multiply(AGREEMENT_SIGMAS * 0.008, (0.01, 0.005, 0.01)), rel=1e-3)


def test_the_correction_is_bounded_whatever_the_sigma():
    follow, sigmas = follower(), (3.0, 2.0, 0.1)
    found = [follow(odometry(k, (float(k > 3), -float(k > 5), 0.0), sigmas=sigmas))
             for k in range(400)]
    assert 1.8e-3 < steps(found).max() < MAX_STEP


def test_the_offset_that_is_left_is_part_of_the_covariance():
    follow = follower()
    follow(odometry(0, (0.0, 0.0, 0.0)))
    found = follow(odometry(1, (0.3, -0.2, 0.1)))
    left = np.subtract((0.3, -0.2, 0.1), planar_pose(found))
    expected = np.outer(left, left)
    expected[0, 0] += 1.0
    assert planar(found.pose_covariance) == pytest.approx(expected)
    assert left[0] > 0.29


def test_the_heading_is_followed_across_the_half_turn():
    follow = follower()
    found = [follow(odometry(k, (0.0, 0.0, 3.13 + 0.008 * k), (0.0, 0.0, 1.0)))
             for k in range(10)]
    assert beyond_twist(found) == pytest.approx(0.0, abs=1e-9)
    assert found[-1].pose_covariance[35] == pytest.approx(0.0, abs=1e-12)


def test_the_first_pose_and_that_after_a_reset_are_the_estimate():
    pose, covariance = ContinuousPose(), array('d', [0.01] * 36)
    for wanted in ((1.0, 2.0, 3.0), (5.0, 0.0, -1.0)):
        assert pose.follow(0, wanted, (9.0, 0.0, 0.0), covariance, covariance) == wanted
        assert set(covariance) == {0.01}
        pose.reset()


@pytest.mark.parametrize('seed', [1, pytest.param(2, marks=pytest.mark.long)])
def test_odometry_is_continuous_while_the_ground_is_reported_late(seed):
    assert steps(driven(seed)[0]).max() < MAX_STEP


def test_the_estimated_pose_itself_makes_steps_there(monkeypatch):
    monkeypatch.setattr(slip_estimator, 'SlipOutputBuilder',
                        lambda params, pose: SlipOutputBuilder(params))
    driven.cache_clear()
    assert steps(driven(1)[0]).max() > 5.0 * MAX_STEP
    driven.cache_clear()


@pytest.mark.parametrize('name, radius, track', [
    ('husky_rectangle', 0.1651, 0.555), ('warthog_gravel_0', 0.3, 1.08),
    ('warthog_ice_1', 0.3, 1.08), *(pytest.param(*one, marks=pytest.mark.long) for one in (
        ('husky_mair_6', 0.1651, 0.555), ('warthog_asphalt', 0.3, 1.08),
        ('warthog_grass_0729a', 0.3, 1.08), ('warthog_grass_0808c', 0.3, 1.08)))])
def test_odometry_is_continuous_with_wheels_that_are_late_and_slow(name, radius, track):
    with Bag(real_recording(name)) as bag:
        samples = [sample for _, _, sample in bag.samples(('imu/data', 'wheel_states'))]
    found = estimates(wheel_radius=radius, track_width=track)(samples)
    assert len(found) > 3000
    assert steps(found).max() < MAX_STEP


def test_reset_odometry_is_a_step_to_the_origin():
    inputs = [sample for _, topic, sample in simulate(SimulatorParams(seed=1), LEGS[:1], 6.0)
              if topic in ('imu/data', 'wheel_states')]
    estimator, found = SlipEstimator(SlipEstimatorParams()), []
    for count, sample in enumerate(inputs, -len(inputs)):
        if count == -20:
            estimator.reset_odometry()
        found += [one for one in estimator.update(sample) if isinstance(one, Odometry)]
    assert steps(found).max() > 1.0
    assert math.hypot(*found[-1].position[:2]) < 0.5


# -- rate and increments -------------------------------------------------------------------------


def messages(found, rate, twist='estimate'):
    """Return what is published."""
    output = OdometryOutput(build(SlipEstimatorParams, {'odom_rate': rate, 'odom_twist': twist}))
    return [message for one in found if (message := output.message(one))]


@pytest.mark.parametrize('rate, every', [
    (125.0, 1), (124.9, 2), (62.5, 2), (50.0, 3), (125.0 / 7, 7), (1.0, 125)])
def test_odometry_is_published_at_every_nth_instant_of_the_grid(rate, every):
    found = [odometry(k, (0.0, 0.0, 0.0)) for k in range(1000, 1600)]
    published = messages(found, rate)
    assert published == [one for one in found if one.stamp_ns // PERIOD_NS % every == 0]


@pytest.mark.parametrize('rate', [125.0, 25.0])
def test_increments_add_up_to_the_pose_and_their_covariances_to_its_own(rate):
    found = messages(driven(1)[0], rate)
    increments = messages(driven(1)[0], rate, 'increments')
    dt, pose, covariance = 1.0 / rate, planar_pose(found[0]), planar(found[0].pose_covariance)
    for one in increments[1:]:
        v_x, v_y, W = planar_twist(one)
        c, s = (f(pose[2] + 0.5 * W * dt) for f in (math.cos, math.sin))
        dx, dy = dt * (c * v_x - s * v_y), dt * (s * v_x + c * v_y)
        F = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        G = dt * np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        covariance = F @ covariance @ F.T + G @ planar(one.twist_covariance) @ G.T
        pose = pose[0] + dx, pose[1] + dy, pose[2] + dt * W
    ratio = np.diag(covariance) / np.diag(planar(found[-1].pose_covariance))
    assert 0.8 < ratio.min() < ratio.max() < 1.6
    assert pose[:2] == pytest.approx(found[-1].position[:2], abs=1e-9)
    assert [one.position for one in found] == [one.position for one in increments]
    for one, increment in zip(found[1:], increments[1:]):
        more = planar(increment.twist_covariance) - planar(one.twist_covariance)
        assert np.linalg.eigvalsh(more).min() > -1e-12


def test_no_increment_leads_over_a_step():
    output = OdometryOutput(build(SlipEstimatorParams, {'odom_twist': 'increments'}))
    first, later = odometry(0, (0.0, 0.0, 0.0)), odometry(3, (9.0, 0.0, 0.0))
    assert output.message(first) is first
    assert output.message(later) is later  # the instants between them are missing
    output.reset()
    step = odometry(4, (0.0, 0.0, 0.0))
    assert output.message(step) is step
    moved = output.message(odometry(5, (0.008, 0.0, 0.0)))
    assert planar_twist(moved) == pytest.approx((1.0, 0.0, 0.0))


def page_parameters():
    """Return the parameters in the blocks of the page, by node."""
    blocks = PAGE.read_text(encoding='utf-8').split('```yaml\n')[1:]
    found = {}
    for block in blocks:
        for node, tree in yaml.safe_load(block.split('```')[0]).items():
            found.setdefault(node.rsplit('/', 1)[-1], {}).update(tree['ros__parameters'])
    return found


def fused(seed, output):
    """Return the mean NEES of the position in a filter that fuses the messages while driving."""
    page = page_parameters()
    noise = np.array(page['ekf_filter_node']['process_noise_covariance'])[[0, 1, 5, 6, 7, 11]]
    found, truth = driven(seed)
    sent = [message for one in found if (message := output.message(one))]
    moving = [one for one in sent if one.stamp_ns > sent[0].stamp_ns + 2 * NS_PER_S]
    fusion, nees = TwistFusion(moving[0], noise), []
    stamps = np.array(sorted(truth))
    for one in moving[1:]:
        fusion.fuse(one)
        true = truth[stamps[np.argmin(np.abs(stamps - one.stamp_ns))]]
        nees.append(fusion.nees(np.array(true.position[:2])))
    return float(np.mean(nees[len(nees) // 4:]))


@pytest.mark.parametrize('seeds', [range(1, 3), pytest.param(
    range(1, 9), marks=pytest.mark.long)])
def test_the_twist_as_the_page_on_robot_localization_says_gives_a_consistent_position(seeds):
    page = page_parameters()['slip_estimator']
    own = {name: value for name, value in page.items() if name.startswith('odom_')
           and name != 'odom_frame'}
    assert own['odom_twist'] == 'increments'
    nees = [fused(seed, OdometryOutput(build(SlipEstimatorParams, own))) for seed in seeds]
    # at one time each is a chi square of two degrees of freedom, over two; means vary less
    low, high = chi2.ppf((0.005, 0.995), 2 * len(nees)) / (2 * len(nees))
    assert low < np.mean(nees) < high


def test_the_estimated_twist_at_125_hz_makes_such_a_filter_overconfident():
    assert fused(1, OdometryOutput(SlipEstimatorParams())) > 4.0
    assert fused(2, OdometryOutput(replace(SlipEstimatorParams(), odom_rate=62.5))) > 4.0
