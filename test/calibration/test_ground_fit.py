# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One fit of all windows: constants within their standard errors, or refused with the reason."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
import math

import numpy as np
import pytest
from smart_tire.calibration import ground_fit
from smart_tire.calibration.ground_fit import fit_ground, SCALE
from smart_tire.calibration.stiffness import stiffness_of
from smart_tire.errors import EstimatorError
from smart_tire.estimation.ground.unknowns import Unknown
from smart_tire.parameters import build, RobotParams, SimulatorParams
from smart_tire.simulation.offline import simulate
from support.identifying import assert_agrees, assert_consistent
from support.motors import recorded, truth
from support.straight import CONCRETE, Ground, oscillation, straight_run

pytestmark = pytest.mark.slow

ROBOT = RobotParams()
STIFFNESS, LATE, PITCHING = 60.0, 0.02, 1.06  # N; s; measured over true forward acceleration
STARTS = ((1.4, 110.0, 110.0), (0.8, 0.0, 0.0), (1.8, -60.0, -60.0), (0.8, 0.0, 0.0),
          (1.1, 140.0, 140.0), (0.8, 0.0, 0.0), (1.4, -110.0, -110.0), (0.8, 0.0, 0.0))
TURNS = ((4.0, 90.0, 30.0), (1.0, 0.0, 0.0), (4.0, 15.0, 60.0), (1.0, 0.0, 0.0),
         (3.0, -45.0, 45.0), (1.0, 0.0, 0.0))


def drive(parts, seed, stiffness=STIFFNESS):
    """Return the recording of parts (duration [s], rpm left, right) on one ground."""
    times = np.cumsum([2.0, *(part[0] for part in parts)])
    legs = [(float(time), left, right) for time, (_, left, right) in zip(times, parts)]
    return recorded(simulate(build(SimulatorParams, {
        'seed': seed, 'film.wheels': [], 'encoder.latency': LATE, 'ground.names': ['ground'],
        'ground.friction': [0.47], 'ground.stiffness': [stiffness], 'ground.drag': [0.015],
        'ground.base': 'ground', 'ground.patches.names': []}), legs,
        float(times[-1]))).scaled(PITCHING)


drive = lru_cache(drive)


def driven(seed):
    return [drive(STARTS, seed), drive(TURNS, seed)]


@lru_cache
def fitted(seed, torques, off=(0.0, 0.0), sigma=0.0):
    x, y, z = ROBOT.imu.position
    robot = build(RobotParams, {'imu.position': (x + off[0], y + off[1], z),
                                'imu.position_sigma': sigma})
    return fit_ground(driven(seed), robot, torques=torques)


@pytest.mark.parametrize('torques', [False, True])
def test_stiffness_latency_and_scale_are_correct_within_their_standard_errors(torques, seeds):
    fits = [fitted(seed, torques) for seed in seeds]
    assert_consistent([stiffness_of(one).stiffness for one in fits], STIFFNESS, 0.2, 1.4)
    assert_consistent([one.latency for one in fits], LATE, 0.2, 1.4)
    assert_consistent([one.estimate(SCALE) for one in fits], PITCHING - 1.0, 0.1, 1.4)
    for one in fits:
        assert stiffness_of(one).stiffness.sigma < (0.06 if torques else 0.1) * STIFFNESS
        assert one.latency.sigma < 0.004
        assert one.estimate(SCALE).sigma < 0.03
        assert one.tension.size < 4.0


def test_the_torque_constant_is_that_of_the_motors(seeds):
    true = [math.log(float(np.mean(truth(seed)[0]))) for seed in seeds]
    found = [fitted(seed, True).estimate(Unknown.TORQUE_SCALE) for seed in seeds]
    assert_consistent(found, true, 0.1, 1.4)
    assert max(one.sigma for one in found) < 0.05


def test_the_position_of_the_imu_is_found_if_it_was_not_given():
    fit = fitted(1, False, (0.06, -0.04), 0.05)
    for row, off in ((Unknown.IMU_X, -0.06), (Unknown.IMU_Y, 0.04)):
        assert_agrees(fit.estimate(row), off)
        assert fit.estimate(row).sigma < 0.012
    assert fitted(1, False).estimate(Unknown.IMU_X).sigma <= 1e-6


def test_the_figure_shows_the_fit():
    found = stiffness_of(fitted(1, True))
    slip, force = found.curve
    assert (np.diff(slip) >= 0.0).all() and len(slip) == len(found.slip) == len(found.force)
    small = np.abs(slip) < 0.04  # below, the force is linear but for a few percent
    slope = float(slip[small] @ force[small] / (slip[small] @ slip[small]))
    assert slope == pytest.approx(found.stiffness.value, rel=0.1)


def test_torques_that_are_not_measured_are_not_needed():
    runs = [replace(one, wheels=replace(one.wheels, torque=None)) for one in driven(1)]
    assert fit_ground(runs, ROBOT, torques=True).x == pytest.approx(fitted(1, False).x)


def test_recordings_on_different_grounds_are_refused_with_their_values():
    fit = fit_ground([drive(STARTS, 1), drive(STARTS, 2, 25.0)], ROBOT, torques=False)
    with pytest.raises(EstimatorError, match='C_x .*several grounds'):
        stiffness_of(fit)


def test_a_gap_of_the_recording_is_left_out():
    run = drive(STARTS, 1)
    inside = (run.wheels.time > 7.5) & (run.wheels.time < 8.5)  # in the middle of a window
    gap = replace(run, wheels=run.wheels.where(~inside))
    whole, rest = (fit_ground([one, drive(TURNS, 1)], ROBOT, torques=False)
                   for one in (run, gap))
    assert len(rest.windows) < len(whole.windows)
    assert_agrees(stiffness_of(rest).stiffness, STIFFNESS)


def test_wheels_without_positions_are_integrated():
    runs = [replace(one, wheels=replace(one.wheels, position=None)) for one in driven(1)]
    assert_agrees(stiffness_of(fit_ground(runs, ROBOT, torques=False)).stiffness, STIFFNESS)


def vibrating(recording, size):
    """Return a recording with white vibration [m/s2] while the wheels rotate."""
    imu, wheels = recording.imu, recording.wheels
    speed = np.interp(imu.time, wheels.time, np.abs(wheels.velocity).mean(axis=1))
    noise = size * np.random.default_rng(3).standard_normal(imu.force.shape)
    return replace(recording, imu=replace(imu, force=imu.force + (speed > 1.0)[:, None] * noise))


def backward(recording):
    """Return a recording whose IMU looks back."""
    force = recording.imu.force * np.array([-1.0, -1.0, 1.0])
    return replace(recording, imu=replace(recording.imu, force=force))


def cruise(time):
    return min(max(0.1 * (time - 1.0), 0.0), 0.7)


def test_the_prior_of_the_scale_counts_once(monkeypatch):
    """Its sigma is a third of that of the data: after all passes, a tenth remains."""
    name, free = 'acceleration on straight lines', fitted(1, False).estimate(SCALE)
    sigma = free.sigma / 3.0
    monkeypatch.setattr(ground_fit, 'PRIORS', {
        **ground_fit.PRIORS, name: ground_fit.PRIORS[name]._replace(sigma=sigma)})
    bound = fit_ground(driven(1), ROBOT, torques=False).estimate(SCALE)
    assert abs(bound.value) < 0.14 * free.value and bound.sigma <= sigma


@pytest.mark.parametrize('run, reason', [
    (lambda: drive(STARTS, 1).scaled(1.4), 'acceleration on straight lines would be'),
    (lambda: backward(drive(STARTS, 1)), 'axes of the IMU are wrong'),
    (lambda: vibrating(drive(STARTS, 1), 1.5), 'or the robot vibrates'),
    (lambda: straight_run(CONCRETE, 9, pace=cruise, seconds=10.0), 'speed changes too little'),
    (lambda: straight_run(CONCRETE, 9, pace=lambda time: oscillation(time, 0.05), seconds=10.0),
     r'standard error of \d+%'),
    (lambda: straight_run(CONCRETE, 9, pace=lambda time: 0.0, seconds=10.0),
     'intervals of straight motion'),
    (lambda: straight_run(Ground(52.7, 0.03, 0.0), 9, pace=oscillation, seconds=10.0),
     'wheels slide|below critical slip|speed changes too little')],
    ids=['scale', 'backward', 'vibration', 'constant speed', 'gentle', 'standstill', 'sliding'])
def test_recordings_that_do_not_show_the_stiffness_are_refused(run, reason):
    with pytest.raises(EstimatorError, match=reason):
        stiffness_of(fit_ground([run()], ROBOT, torques=False))
