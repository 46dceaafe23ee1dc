# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Estimates without IMU or wheels, or with few messages: bounded, with sigmas that grow."""

from functools import cache

from benchmarks.faults import interrupted, stalled
from benchmarks.scenarios import CONCRETE, sequence
import numpy as np
import pytest
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.state import SLIP_VELS
from smart_tire.parameters import build, RobotParams, SimulatorParams, SlipEstimatorParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.rotation import euler
from smart_tire.samples import NS_PER_S, Odometry
from smart_tire.simulation.offline import simulate

pytestmark = pytest.mark.slow

LEGS, END = sequence((5.0, 90.0, 90.0), (8.0, 120.0, 60.0), (6.0, 60.0, 120.0))
BEGIN, BACK = 10.0, 13.0  # s, of a gap, in a turn
DRIVES = {  # on a ground with the slip that the prior expects
    'straight': sequence((24.0, 90.0, 90.0)),
    'turn': sequence((5.0, 90.0, 90.0), (19.0, 120.0, 60.0))}
ONSET = 9.0     # s, of gaps, 1 s after the turn began
MAX_SIGMAS = 4.0
INPUTS = 'imu/data', 'wheel_states'


def without(*topics, begin=BEGIN, end=BACK):
    """Return a function that removes topics from events, in a gap."""
    def change(events, _):
        for topic in topics:
            events = interrupted(events, topic, [(begin, end)])
        return events
    return change


def lossy(events, seed):
    """Return ``events`` with a fifth of the messages."""
    rng = np.random.default_rng(seed)
    return [event for event in events if event[1] not in INPUTS or rng.random() < 0.2]


def late(events, _):
    """Return ``events`` of a host that stalls for 0.4 s in each second."""
    return stalled(events, [(second, second + 0.4) for second in range(3, round(END))])


class Run:
    """Times [s], errors and standard deviations of the estimates of a changed simulation."""

    def __init__(self, change, seed, events=None):
        events = events or simulated(seed)
        estimator = SlipEstimator(build(SlipEstimatorParams, {}))
        found = [one for _, topic, sample in change(events, seed) if topic in INPUTS
                 for one in estimator.update(sample) if isinstance(one, Odometry)]
        truth = [sample for _, topic, sample in events if topic == 'ground_truth/odom']
        stamps = np.array([one.stamp_ns for one in found])
        true = [truth[i] for i in np.minimum(np.searchsorted(
            [one.stamp_ns for one in truth], stamps), len(truth) - 1)]
        self.time = (stamps - events[0][0]) / NS_PER_S
        self.place = np.array([np.subtract(one.position, other.position)[:2]
                               for one, other in zip(found, true)])
        self.place_covariance = np.array(
            [one.pose_covariance for one in found]).reshape(-1, 6, 6)[:, :2, :2]
        self.speed = np.array([one.linear[0] - other.linear[0]
                               for one, other in zip(found, true)])
        self.speed_sigma = np.sqrt([one.twist_covariance[0] for one in found])
        self.rate = np.array([one.angular[2] - other.angular[2]
                              for one, other in zip(found, true)])
        self.rate_sigma = np.sqrt([one.twist_covariance[35] for one in found])
        turned = [euler(one.orientation)[2] - euler(other.orientation)[2]
                  for one, other in zip(found, true)]
        self.heading = (np.array(turned) + np.pi) % (2.0 * np.pi) - np.pi
        self.heading_sigma = np.sqrt([one.pose_covariance[35] for one in found])

    def squares(self, begin):
        """Return the normalized squared errors of the position from ``begin`` [s] on."""
        later = self.time > begin
        return np.array([error @ np.linalg.solve(covariance, error) for error, covariance in
                         zip(self.place[later], self.place_covariance[later])])

    @property
    def nees(self):
        """Return the mean of the normalized squared errors per dimension, while moving."""
        return float(np.mean(self.squares(6.0))) / 2.0

    def sigma(self, begin, end):
        """Return the mean standard deviation of the speed in a time, a gap's estimates are few."""
        return np.interp(np.arange(begin, end, 0.01), self.time, self.speed_sigma).mean()


@cache
def simulated(seed):
    return simulate(SimulatorParams(seed=seed), LEGS, END)


@cache
def usual(seed):
    return Run(lambda events, _: events, seed)


@pytest.mark.parametrize('seed', [1, pytest.param(2, marks=pytest.mark.long)])
@pytest.mark.parametrize('change, growth', [
    # the error of the unknown ground is part of all of them
    (without('imu/data'), 1.1), (without('wheel_states'), 1.5), (without(*INPUTS), 4.0),
    (lossy, 1.05), (late, 0.98)])
def test_estimates_are_bounded_and_their_sigmas_grow_while_inputs_are_missing(
        change, growth, seed):
    found, whole = Run(change, seed), usual(seed)
    assert np.isfinite(found.place_covariance).all() and np.isfinite(found.speed_sigma).all()
    assert np.mean(np.square(found.speed / found.speed_sigma)) < 2.0
    assert np.abs(found.speed).max() < 0.8
    assert found.nees < 3.0
    assert found.sigma(BEGIN, BACK) > growth * whole.sigma(BEGIN, BACK)
    if change is not lossy:  # which lasts
        assert found.sigma(BACK + 1.0, BACK + 2.0) < 1.3 * whole.sigma(BACK + 1.0, BACK + 2.0)


@cache
def driven(drive, seed):
    """Return the events of a drive on concrete."""
    return simulate(SimulatorParams(seed=seed, ground=CONCRETE, robot=RobotParams(
        film=TreadFilmParams(wheels=()))), *DRIVES[drive])


@pytest.mark.parametrize('seed', [1, *(pytest.param(seed, marks=pytest.mark.long)
                                       for seed in (2, 3))])
@pytest.mark.parametrize('drive', DRIVES)
@pytest.mark.parametrize('topics', [INPUTS[:1], INPUTS[1:], INPUTS])
def test_errors_stay_within_their_sigmas_in_gaps_of_any_length(topics, drive, seed):
    growth = []
    for length in (1.0, 3.0, 10.0):
        found = Run(without(*topics, begin=ONSET, end=ONSET + length), seed, driven(drive, seed))
        later = found.time > ONSET
        assert np.sqrt(found.squares(ONSET).max()) < MAX_SIGMAS
        for error, sigma in ((found.speed, found.speed_sigma), (found.rate, found.rate_sigma),
                             (found.heading, found.heading_sigma)):
            assert np.abs(error / sigma)[later].max() < MAX_SIGMAS + (error is found.rate)
        end = np.searchsorted(found.time, ONSET + length - 0.1)
        growth.append(np.linalg.eigvalsh(found.place_covariance[end]).max()
                      + found.heading_sigma[end] ** 2)
    assert growth[0] < growth[1] < growth[2]


@pytest.mark.parametrize('seed', [1, *(pytest.param(seed, marks=pytest.mark.long)
                                       for seed in (2, 3, 4))])
def test_a_turn_is_estimated_consistently_without_the_imu_that_has_seen_its_begin(seed):
    found = Run(without('imu/data', begin=ONSET, end=ONSET + 3.0), seed)
    assert found.nees < 2.0
    assert np.linalg.norm(found.place, axis=1).max() < 2.5
    blind = (found.time > ONSET + 0.2) & (found.time < ONSET + 3.0)
    assert np.mean(np.square(found.rate / found.rate_sigma)[blind]) < 2.0


def test_the_wheels_do_not_confirm_the_yaw_rate_that_they_give():
    events = without('imu/data', begin=ONSET, end=ONSET + 10.0)(driven('turn', 1), 1)
    estimator, variances = SlipEstimator(build(SlipEstimatorParams, {})), []
    left, right = SLIP_VELS
    for received, topic, sample in events:
        if topic in INPUTS:
            estimator.update(sample)
            if ONSET < (received - events[0][0]) / NS_PER_S < ONSET + 9.9:
                P = estimator._segment.filter.kalman.P
                variances.append(P[left, left] + P[right, right] - 2.0 * P[left, right])
    assert variances[-1] > 4.0 * variances[0]
    assert np.diff(variances[10::10]).min() > -0.03 * variances[-1]
