# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Effective track from whole turns."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.calibration.recording import ImuRecord, Recording, WheelRecord
from smart_tire.calibration.robot.turn_track import fit_turn_track
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain

ROBOT = RobotParams()
TURN, REST = 6.0, 2.0  # s


def turning(tracks, rates, *, bias=0.0, noise=0.01, latency=0.0, seed=0, positions=True):
    """Return turns with these effective tracks [m] and yaw rates [rad/s]."""
    rng, end = np.random.default_rng(seed), len(rates) * (TURN + REST) + REST

    def profile(time, values):
        number = np.clip(((time - REST) // (TURN + REST)).astype(int), 0, len(values) - 1)
        inside = (time - REST) % (TURN + REST) < TURN
        return np.where(inside & (time > REST), np.asarray(values)[number], 0.0)

    imu = np.arange(0.0, end, 0.01)
    rate = np.zeros((len(imu), 3))
    rate[:, 2] = profile(imu, rates) + bias + noise * rng.standard_normal(len(imu))
    fine = np.arange(0.0, end, 0.001)
    difference = np.cumsum(profile(fine, np.multiply(tracks, rates))) * 1e-3 / ROBOT.wheel_radius
    time = np.arange(0.1, end - 0.1, 0.0625)
    half = 0.5 * np.interp(time, fine, difference)
    angle = np.stack([-half, half, -half, half], axis=1)
    velocity = np.vstack([np.zeros(4), np.diff(angle, axis=0) / 0.0625])
    return Recording(ImuRecord(imu, rate, np.zeros((len(imu), 3))),
                     WheelRecord(time + latency, velocity, angle if positions else None))


@pytest.mark.parametrize('positions', [True, False])
def test_the_track_is_that_of_the_turns_within_its_standard_error(positions):
    errors = []
    for seed in range(20):
        bias = 0.01 * float(np.random.default_rng([seed, 1]).standard_normal())
        run = turning([0.57] * 4, [0.6, -0.6, 1.0, -1.0], bias=bias, seed=seed,
                      latency=0.02, positions=positions)
        fit = fit_turn_track([run], ROBOT, Uncertain(0.0, 0.01))
        errors.append((fit.track.value - 0.57) / fit.track.sigma)
        assert fit.track.sigma < 0.01 and len(fit.turns) == 4
    assert np.sqrt(np.mean(np.square(errors))) < 1.3


def test_a_known_gyro_bias_is_removed_from_each_turn():
    run = turning([0.57] * 2, [0.6, -0.6], bias=0.05, noise=0.0)
    fit = fit_turn_track([run], ROBOT, Uncertain(0.05, 0.001))
    assert fit.turns == pytest.approx([0.57, 0.57], abs=0.002)
    assert fit.spread < 0.002


def test_tracks_of_several_grounds_are_refused_with_their_values():
    run = turning([0.57, 0.57, 0.84, 0.84], [0.6, -0.6, 0.6, -0.6])
    with pytest.raises(EstimatorError, match='0.57, 0.57, 0.84, 0.84 m: several grounds'):
        fit_turn_track([run], ROBOT, Uncertain(0.0, 0.01))
    slightly = turning([0.57, 0.57, 0.60, 0.60], [0.6, -0.6, 0.6, -0.6])
    assert fit_turn_track([slightly], ROBOT, Uncertain(0.0, 0.01)).spread > 0.015


@pytest.mark.parametrize('rates, message', [
    ([0.6, 0.6], '2 steady turns to the left and 0 to the right'),
    ([0.12, -0.12], '0 steady turns'), ([0.0], '0 steady turns')])
def test_turns_in_one_direction_or_too_little_yaw_are_refused(rates, message):
    with pytest.raises(EstimatorError, match=message):
        fit_turn_track([turning([0.57] * len(rates), rates)], ROBOT, Uncertain(0.0, 0.01))


def test_swapped_sides_are_refused():
    with pytest.raises(EstimatorError, match='left and right swapped'):
        fit_turn_track([turning([-0.57] * 2, [0.6, -0.6])], ROBOT, Uncertain(0.0, 0.01))
