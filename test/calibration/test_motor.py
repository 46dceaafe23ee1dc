# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motor constants: correct within their standard errors, or refused with the reason."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from smart_tire.calibration.motor import (
    AXLE, CONSTANT, COULOMB, FEED_FORWARD, identify_motor, INERTIA, RESISTANCE, STALL, VISCOUS)
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams
from support.motors import in_step_run, offline_run, truth

pytestmark = pytest.mark.slow

ROBOT = RobotParams()
MOTOR = ROBOT.motor
SEEDS = range(10)
CRUISE = ((14.0, 90.0),)
FORWARD = ((1.3, 140.0), (1.1, 40.0)) * 8

offline_run, in_step_run = lru_cache(offline_run), lru_cache(in_step_run)


def inaccurate(seed):
    """Return a robot whose C_x and wheel radius have errors of their standard deviations."""
    stiffness, radius = np.random.default_rng([seed, 12]).standard_normal(2).tolist()
    sigma = ROBOT.tire.longitudinal_stiffness_sigma
    return build(RobotParams, {
        'tire.longitudinal_stiffness': 52.7 * (1.0 + sigma * stiffness),
        'wheel_radius': ROBOT.wheel_radius * (1.0 + ROBOT.wheel_radius_sigma * radius)})


def found(seed, run=offline_run, lifted=True, robot=ROBOT):
    return identify_motor([run(seed)], [run(seed, lifted=True)] if lifted else [], robot)


def normalized(fits, name, true_values):
    """Return errors over standard errors, and relative standard errors, of a quantity."""
    estimates = [fit.get(name) for fit in fits]
    return (np.array([(estimate.value - value) / estimate.sigma
                      for estimate, value in zip(estimates, true_values)]),
            np.array([estimate.sigma / value for estimate, value in zip(estimates, true_values)]))


@pytest.mark.parametrize('run', [offline_run, in_step_run])
def test_constant_and_friction_are_correct_within_their_standard_errors(run):
    fits = [found(seed, run, robot=inaccurate(seed)) for seed in SEEDS]
    constants = [MOTOR.torque_constant * float(np.mean(truth(seed)[0])) for seed in SEEDS]
    frictions = [MOTOR.coulomb_friction * float(np.mean(truth(seed)[1])) for seed in SEEDS]
    for name, values, worst in ((CONSTANT, constants, 0.025), (COULOMB, frictions, 0.05),
                                (INERTIA, [MOTOR.inertia] * len(SEEDS), 0.1)):
        errors, sigma = normalized(fits, name, values)
        assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 1.4, name
        assert np.max(np.abs(errors)) < 3.0, name
        assert np.max(sigma) <= worst, name


def test_the_feed_forward_is_one_over_the_free_speed():
    fits = [found(seed, in_step_run, lifted=False) for seed in SEEDS]
    errors, sigma = normalized(fits, FEED_FORWARD, [1.0 / 22.0] * len(SEEDS))
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 1.6 and np.max(sigma) < 0.01
    for fit in fits:
        stall = fit.get(STALL)
        assert stall.value == pytest.approx(5.0, abs=2.0 * stall.sigma)


@pytest.mark.parametrize('run', [offline_run, in_step_run])
@pytest.mark.parametrize('error', [0.92, 1.08])
def test_a_constant_that_is_8_percent_off_is_corrected(run, error):
    robot = build(RobotParams, {'motor.torque_constant': MOTOR.torque_constant * error})
    for seed in range(3):
        records = [[replace(one, wheels=replace(one.wheels, torque=error * one.wheels.torque))]
                   for one in (run(seed), run(seed, lifted=True))]
        constant = identify_motor(*records, robot).get(CONSTANT)
        true = MOTOR.torque_constant * float(np.mean(truth(seed)[0]))
        assert constant.sigma <= 0.025 * true
        assert constant.value == pytest.approx(true, abs=2.0 * constant.sigma)


def test_parameters_contain_what_is_observable_and_its_accuracy():
    fit = found(1, in_step_run)
    items = {item.name: item for item in fit.parameters()}
    assert items.keys() == {
        'motor.torque_constant', 'motor.torque_constant_sigma', 'motor.inertia',
        'motor.coulomb_friction', 'motor.viscous_friction', 'pid.feed_forward',
        'pid.stall_torque'}
    constant = items['motor.torque_constant']
    assert items['motor.torque_constant_sigma'].value == pytest.approx(
        constant.sigma / constant.value)
    assert items['motor.viscous_friction'].value >= 0.0
    assert 'not separable' in fit.refused[AXLE]


def test_without_lifted_wheels_inertia_and_friction_are_refused():
    fit = found(1, lifted=False)
    assert all('lifted' in fit.refused[name] for name in (INERTIA, COULOMB, VISCOUS))
    true = MOTOR.torque_constant * float(np.mean(truth(1)[0]))
    constant, better = fit.get(CONSTANT), found(1).get(CONSTANT)
    assert constant.value == pytest.approx(true, abs=2.0 * constant.sigma)
    assert better.sigma < constant.sigma < 0.05 * true


def test_an_assumed_inertia_that_is_wrong_stays_within_the_standard_error():
    for inertia in (0.9 * MOTOR.inertia, 1.1 * MOTOR.inertia):
        robot = build(RobotParams, {'motor.inertia': inertia})
        constant = found(2, lifted=False, robot=robot).get(CONSTANT)
        true = MOTOR.torque_constant * float(np.mean(truth(2)[0]))
        assert constant.value == pytest.approx(true, abs=2.0 * constant.sigma)


@pytest.mark.parametrize('seed', range(5))
def test_readings_in_step_with_unrecorded_commands_are_refused(seed):
    records = [replace(in_step_run(seed, lifted=lifted), duties=None)
               for lifted in (False, True)]
    fit = identify_motor(records[:1], records[1:], ROBOT)
    assert all('in step' in fit.refused[name] for name in (CONSTANT, INERTIA, COULOMB, VISCOUS))
    assert 'motor_commands' in fit.refused[FEED_FORWARD]


def test_readings_at_the_changes_of_the_duty_are_refused():
    fit = identify_motor([in_step_run(3, phase=0.002)], [], ROBOT)
    assert 'in step' in fit.refused[CONSTANT] and 'few milliseconds' in fit.refused[CONSTANT]
    assert [item.name for item in fit.parameters()] == ['pid.feed_forward']


def test_a_motor_that_differs_is_reported():
    assert not found(4, in_step_run).notes
    records = [in_step_run(4), in_step_run(4, lifted=True)]
    scale = np.array([1.0, 1.0 / 1.2, 1.0, 1.0])  # of the torque that the front right measures
    fit = identify_motor(*([replace(one, wheels=replace(
        one.wheels, torque=scale * one.wheels.torque))] for one in records), ROBOT)
    assert len(fit.notes) == 1 and fit.notes[0].startswith('front_right: torque constant 1.')


def test_the_slope_of_the_ground_does_not_matter():
    run, slope, level = offline_run(5), 0.05, found(5, lifted=False)
    weight = slope * 9.80665
    imu = replace(run.imu, force=run.imu.force + np.array([weight, 0.0, 0.0]))
    kappa = 1.0 / float(np.mean(truth(5)[0]))
    share = 0.25 * kappa * ROBOT.mass * ROBOT.wheel_radius * weight
    wheels = replace(run.wheels, torque=run.wheels.torque + share)
    fit = identify_motor([replace(run, imu=imu, wheels=wheels)], [], ROBOT)
    assert fit.get(CONSTANT).value == pytest.approx(level.get(CONSTANT).value, rel=0.003)


def test_resistance_and_slope_are_separable_in_both_directions_only():
    both = found(6, lifted=False).get(RESISTANCE)
    forward = identify_motor([offline_run(6, parts=FORWARD)], [], ROBOT).get(RESISTANCE)
    true = float(np.mean(truth(6)[1])) * (0.15 + 0.087 * 0.015 * 26.72) + 0.087 * 0.015 * 26.72
    assert both.value == pytest.approx(true, abs=2.0 * both.sigma)
    assert forward.value == pytest.approx(true, abs=2.0 * forward.sigma)
    assert forward.sigma > 1.5 * both.sigma


def test_two_recordings_give_a_smaller_sigma():
    one = found(7).get(CONSTANT)
    both = identify_motor([offline_run(7), offline_run(7, parts=FORWARD)],
                          [offline_run(7, lifted=True)], ROBOT).get(CONSTANT)
    assert both.sigma < 1.1 * one.sigma
    assert both.value == pytest.approx(one.value, abs=2.0 * one.sigma)


def test_a_constant_speed_is_refused():
    fit = identify_motor([offline_run(9, parts=CRUISE)], [], ROBOT)
    assert 'requires starts and stops' in fit.refused[CONSTANT]
    assert not fit.parameters()


def test_a_duty_that_does_not_change_does_not_determine_the_torque():
    run = in_step_run(3)
    steady = replace(run.duties, duty=np.full_like(run.duties.duty, 0.4))
    fit = identify_motor([replace(run, duties=steady)], [], ROBOT)
    assert CONSTANT in fit.refused and fit.get(STALL) is None


def test_a_duty_of_zero_is_no_feed_forward():
    run = in_step_run(3)
    fit = identify_motor([replace(run, duties=replace(
        run.duties, duty=np.zeros_like(run.duties.duty)))], [], ROBOT)
    assert fit.refused[FEED_FORWARD] == 'the duty is zero while the wheels turn'


def test_a_constant_that_is_known_better_is_kept():
    robot = build(RobotParams, {'motor.torque_constant_sigma': 0.01})
    fit = found(1, lifted=False, robot=robot)
    assert fit.refused[CONSTANT].endswith('requires a recording with lifted wheels')
    assert 'already known to 1.0%' in fit.refused[CONSTANT]


def test_recordings_on_the_ground_and_lifted_must_not_be_swapped():
    ground, lifted = offline_run(0), offline_run(0, lifted=True)
    with pytest.raises(EstimatorError, match='they slide, or are lifted'):
        identify_motor([lifted], [], ROBOT)
    with pytest.raises(EstimatorError, match='they are not lifted'):
        identify_motor([ground], [ground], ROBOT)


def test_recordings_without_torque_are_refused():
    run = offline_run(0)
    without = replace(run, wheels=replace(run.wheels, torque=None))
    with pytest.raises(EstimatorError, match='without motor torque'):
        identify_motor([without], [], ROBOT)
    partly = run.wheels.torque.copy()
    partly[:, 2] = np.nan
    with pytest.raises(EstimatorError, match='rear_left was not measured'):
        identify_motor([replace(run, wheels=replace(run.wheels, torque=partly))], [], ROBOT)


def test_magnitudes_of_currents_are_refused():
    run = offline_run(0)
    torque = np.copysign(run.wheels.torque, run.wheels.velocity)
    with pytest.raises(EstimatorError, match='magnitudes of currents'):
        identify_motor([replace(run, wheels=replace(run.wheels, torque=torque))], [], ROBOT)


def test_a_short_recording_is_refused():
    with pytest.raises(EstimatorError, match='readings in straight motion'):
        identify_motor([offline_run(0, parts=((0.6, 60.0),))], [], ROBOT)
