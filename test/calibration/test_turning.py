# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""S from a pose reference and from the IMU alone, and the effective track from turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smart_tire.calibration.latency import fit_yaw_rate
from smart_tire.calibration.recording import (
    CalibrationRecording, ImuRecord, PoseRecord, WheelRecord)
from smart_tire.calibration.turning import combine, effective_track, identify_icr
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams
from smart_tire.uncertain import Uncertain
from support.identifying import assert_agrees, assert_consistent, recorded, rms, turning_run

ROBOT = RobotParams()
ICR = 0.04  # m
TURN, REST = 6.0, 2.0  # s


def fitted(noise, seed):
    return identify_icr(recorded(turning_run(seed, icr=ICR, turn=0.4), noise, seed), ROBOT)


@pytest.mark.parametrize('noise, source', [(0.003, 'reference'), (None, 'IMU')])
def test_it_is_correct_within_its_standard_error(noise, source, seeds):
    found = [fitted(noise, seed) for seed in seeds]
    assert_consistent([fit.icr for fit in found], ICR, 0.0, 1.5)
    assert max(fit.icr.sigma for fit in found) < 0.03
    assert max(abs(fit.icr.value - ICR) for fit in found) < 0.02
    assert all(source in fit.source for fit in found)


def test_errors_match_their_sigma_if_noise_of_the_reference_dominates(seeds):
    assert_consistent([fitted(0.01, seed).icr for seed in seeds], ICR, 0.6, 1.5)


def test_turns_scatter_by_their_standard_errors_if_s_is_constant():
    fit = fitted(0.003, 0)
    normalized = (fit.turn_icr - ICR) / fit.turn_sigma
    assert len(normalized) > 5 and 0.5 < rms(normalized) < 2.0
    assert fit.spread < 0.01


def test_a_change_of_s_increases_the_spread():
    first, second = (identify_icr(recorded(turning_run(seed, icr=icr, turn=0.4), 0.002), ROBOT)
                     for seed, icr in ((1, 0.0), (2, 0.08)))
    both = combine([first, second])
    assert both.spread == pytest.approx(0.04, rel=0.3)
    assert both.icr.value == pytest.approx(0.04, abs=0.02)
    assert both.initial_sigma > both.spread
    sigma = next(item.value for item in both.parameters(ROBOT) if item.name == 'icr_x_sigma')
    assert sigma == pytest.approx(both.initial_sigma / ROBOT.wheelbase)


def test_yaw_misalignment_of_the_reference_does_not_matter():
    recording = recorded(turning_run(3, icr=ICR, turn=0.4), 0.002)
    poses = recording.reference
    askew = PoseRecord(poses.time, poses.position, poses.yaw + 0.03)
    assert_agrees(identify_icr(replace(recording, reference=askew), ROBOT).icr, ICR, 3.5)


def test_the_position_of_the_imu_matters():
    moved = build(RobotParams, {'imu.position': [0.15, 0.02, 0.1]})
    recording = recorded(turning_run(4, icr=ICR, turn=0.4))
    shift = identify_icr(recording, moved).icr.value - identify_icr(recording, ROBOT).icr.value
    assert shift == pytest.approx(0.1, rel=0.05)


def test_a_poor_reference_is_replaced_by_the_imu():
    fit = identify_icr(recorded(turning_run(5, icr=ICR, turn=0.4), 1.0), ROBOT)
    assert 'IMU' in fit.source


def test_without_turns_it_is_refused_and_a_little_turning_has_a_large_standard_error():
    straight = recorded(turning_run(6, turn=0.0))
    straight.imu.rate[:] = 0.0
    with pytest.raises(EstimatorError, match='0 intervals in turns'):
        identify_icr(straight, ROBOT)
    little, more = (identify_icr(recorded(turning_run(6, turn=turn, icr=ICR)), ROBOT).icr
                    for turn in (0.01, 0.4))
    assert_agrees(little, ICR)
    assert little.sigma > 2.0 * more.sigma


def test_both_reasons_are_given_if_neither_makes_it_observable():
    recording = recorded(turning_run(7, turn=0.4), 1.0)
    rough = recording.imu.force + np.random.default_rng(7).normal(
        0.0, 50.0, recording.imu.force.shape)
    recording = replace(recording, imu=replace(recording.imu, force=rough))
    with pytest.raises(EstimatorError, match='reference.*; lateral acceleration of the IMU'):
        identify_icr(recording, ROBOT)


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
    return CalibrationRecording(
        ImuRecord(imu, rate, np.zeros((len(imu), 3))),
        WheelRecord(time + latency, velocity, angle if positions else None))


def track_of(run):
    return effective_track([fit_yaw_rate(run, ROBOT)], Uncertain(ROBOT.wheel_radius, 0.0))


@pytest.mark.parametrize('positions', [True, False])
def test_the_track_is_that_of_the_turns_within_its_standard_error(positions, seeds):
    found = [track_of(turning(
        [0.57] * 4, [0.6, -0.6, 1.0, -1.0], seed=seed, latency=0.02, positions=positions,
        bias=0.01 * float(np.random.default_rng([seed, 1]).standard_normal()))) for seed in seeds]
    assert_consistent(found, 0.57, 0.0, 1.3)
    assert max(track.sigma for track in found) < 0.01


def test_an_error_of_the_radius_is_one_of_the_track():
    fits = [fit_yaw_rate(turning([0.57] * 2, [0.6, -0.6]), ROBOT)]
    track = effective_track(fits, Uncertain(2.0 * ROBOT.wheel_radius, 0.04 * ROBOT.wheel_radius))
    assert track.value == pytest.approx(1.14, rel=0.01)
    assert track.sigma == pytest.approx(0.02 * 1.14, rel=0.1)


def test_tracks_of_several_grounds_are_refused_with_their_values():
    rates = [0.6, -0.6, 0.6, -0.6]
    with pytest.raises(EstimatorError, match='0.57, 0.57, 0.84, 0.84 m: several grounds'):
        track_of(turning([0.57, 0.57, 0.84, 0.84], rates, noise=1e-4))
    assert track_of(turning([0.57, 0.57, 0.60, 0.60], rates)).sigma > 0.007  # half the spread


def test_turns_in_one_direction_are_refused():
    with pytest.raises(EstimatorError, match='2 turns to the left and 0 to the right'):
        track_of(turning([0.57] * 2, [0.6, 0.6]))
