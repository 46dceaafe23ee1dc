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
from benchmarks.scenarios import sequence
import numpy as np
import pytest
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.parameters import build, SimulatorParams, SlipEstimatorParams
from smart_tire.samples import NS_PER_S, Odometry
from smart_tire.simulation.offline import simulate

pytestmark = pytest.mark.slow

LEGS, END = sequence((5.0, 90.0, 90.0), (8.0, 120.0, 60.0), (6.0, 60.0, 120.0))
BEGIN, BACK = 10.0, 13.0  # s, of a gap, in a turn
INPUTS = 'imu/data', 'wheel_states'


def without(*topics):
    """Return a function that removes topics from events, in the gap."""
    def change(events, _):
        for topic in topics:
            events = interrupted(events, topic, [(BEGIN, BACK)])
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

    def __init__(self, change, seed):
        events = simulated(seed)
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

    @property
    def nees(self):
        """Return the normalized squared error of the position per dimension, while moving."""
        moved = self.time > 6.0
        return float(np.mean([error @ np.linalg.solve(covariance, error) for error, covariance in
                              zip(self.place[moved], self.place_covariance[moved])])) / 2.0

    def sigma(self, begin, end):
        """Return the mean standard deviation of the speed in a time."""
        return self.speed_sigma[(self.time >= begin) & (self.time < end)].mean()


@cache
def simulated(seed):
    return simulate(SimulatorParams(seed=seed), LEGS, END)


@cache
def usual(seed):
    return Run(lambda events, _: events, seed)


@pytest.mark.parametrize('seed', [1, pytest.param(2, marks=pytest.mark.long)])
@pytest.mark.parametrize('change, growth', [
    (without('imu/data'), 1.1), (without('wheel_states'), 2.0), (without(*INPUTS), 4.0),
    (lossy, 1.2), (late, 0.98)])
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
