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
from support.identifying import assert_agrees, assert_consistent
from support.motors import in_step_run, offline_run, truth

pytestmark = pytest.mark.slow

ROBOT = RobotParams()
MOTOR = ROBOT.motor
SEED = 1
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


def found(run=offline_run, seed=SEED, lifted=True, robot=ROBOT):
    return identify_motor([run(seed)], [run(seed, lifted=True)] if lifted else [], robot)


def constant_of(seed=SEED):
    return MOTOR.torque_constant * float(np.mean(truth(seed)[0]))


def changed(record, **wheels):
    """Return a recording with other columns of the wheels."""
    return replace(record, wheels=replace(record.wheels, **wheels))


@pytest.mark.parametrize('run', [pytest.param(offline_run, marks=pytest.mark.long), in_step_run])
def test_constant_and_friction_are_correct_within_their_standard_errors(run, seeds):
    fits = [found(run, seed, robot=inaccurate(seed)) for seed in seeds]
    frictions = [MOTOR.coulomb_friction * float(np.mean(truth(seed)[1])) for seed in seeds]
    for name, values, worst in ((CONSTANT, list(map(constant_of, seeds)), 0.025),
                                (COULOMB, frictions, 0.05), (INERTIA, MOTOR.inertia, 0.1)):
        estimates = [fit.get(name) for fit in fits]
        assert_consistent(estimates, values, 0.3, 1.4)
        assert np.max([one.sigma for one in estimates] / np.asarray(values)) <= worst, name


def test_the_feed_forward_is_one_over_the_free_speed(seeds):
    fits = [found(in_step_run, seed, lifted=False) for seed in seeds]
    inverse = [fit.get(FEED_FORWARD) for fit in fits]
    assert_consistent(inverse, 1.0 / 22.0, 0.3, 1.6)
    assert max(one.sigma for one in inverse) < 0.01 / 22.0
    for fit in fits:
        assert_agrees(fit.get(STALL), 5.0, 2.0)


@pytest.mark.parametrize('run, error', [(offline_run, 0.92), (in_step_run, 1.08)])
def test_a_constant_that_is_8_percent_off_is_corrected(run, error):
    robot = build(RobotParams, {'motor.torque_constant': MOTOR.torque_constant * error})
    records = [[changed(one, torque=error * one.wheels.torque)]
               for one in (run(SEED), run(SEED, lifted=True))]
    constant = identify_motor(*records, robot).get(CONSTANT)
    assert constant.sigma <= 0.025 * constant_of()
    assert_agrees(constant, constant_of(), 2.0)


def test_parameters_contain_what_is_observable_and_its_accuracy():
    fit = found(in_step_run)
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
    fit = found(lifted=False)
    assert all('lifted' in fit.refused[name] for name in (INERTIA, COULOMB, VISCOUS))
    constant = fit.get(CONSTANT)
    assert_agrees(constant, constant_of(), 2.0)
    assert found().get(CONSTANT).sigma < constant.sigma < 0.05 * constant_of()


@pytest.mark.parametrize('factor', [0.9, 1.1])
def test_an_assumed_inertia_that_is_wrong_stays_within_the_standard_error(factor):
    robot = build(RobotParams, {'motor.inertia': factor * MOTOR.inertia})
    assert_agrees(found(lifted=False, robot=robot).get(CONSTANT), constant_of(), 2.0)


def test_readings_in_step_with_unrecorded_commands_are_refused(seeds):
    for seed in seeds:
        ground, lifted = (replace(in_step_run(seed, **options), duties=None)
                          for options in ({}, {'lifted': True}))
        fit = identify_motor([ground], [lifted], ROBOT)
        assert all('in step' in fit.refused[name]
                   for name in (CONSTANT, INERTIA, COULOMB, VISCOUS))
        assert 'motor_commands' in fit.refused[FEED_FORWARD]


def test_readings_at_the_changes_of_the_duty_are_refused():
    fit = identify_motor([in_step_run(SEED, phase=0.002)], [], ROBOT)
    assert 'in step' in fit.refused[CONSTANT] and 'few milliseconds' in fit.refused[CONSTANT]
    assert [item.name for item in fit.parameters()] == ['pid.feed_forward']


def test_a_motor_that_differs_is_reported():
    assert not found(in_step_run).notes
    scale = np.array([1.0, 1.0 / 1.2, 1.0, 1.0])  # of the torque that the front right measures
    fit = identify_motor(*([changed(one, torque=scale * one.wheels.torque)] for one in (
        in_step_run(SEED), in_step_run(SEED, lifted=True))), ROBOT)
    assert len(fit.notes) == 1 and fit.notes[0].startswith('front_right: torque constant 1.')


def test_the_slope_of_the_ground_does_not_matter():
    run, weight = offline_run(SEED), 0.05 * 9.80665
    imu = replace(run.imu, force=run.imu.force + np.array([weight, 0.0, 0.0]))
    kappa = MOTOR.torque_constant / constant_of()
    share = 0.25 * kappa * ROBOT.mass * ROBOT.wheel_radius * weight
    fit = identify_motor([changed(replace(run, imu=imu), torque=run.wheels.torque + share)], [],
                         ROBOT)
    assert fit.get(CONSTANT).value == pytest.approx(
        found(lifted=False).get(CONSTANT).value, rel=0.003)


def test_resistance_and_slope_are_separable_in_both_directions_only():
    both = found(lifted=False).get(RESISTANCE)
    forward = identify_motor([offline_run(SEED, parts=FORWARD)], [], ROBOT).get(RESISTANCE)
    rolling = 0.087 * 0.015 * 26.72
    true = float(np.mean(truth(SEED)[1])) * (0.15 + rolling) + rolling
    for estimate in (both, forward):
        assert_agrees(estimate, true, 2.0)
    assert forward.sigma > 1.5 * both.sigma


def test_two_recordings_give_a_smaller_sigma():
    one = found().get(CONSTANT)
    both = identify_motor([offline_run(SEED), offline_run(SEED, parts=FORWARD)],
                          [offline_run(SEED, lifted=True)], ROBOT).get(CONSTANT)
    assert both.sigma < 1.1 * one.sigma
    assert both.value == pytest.approx(one.value, abs=2.0 * one.sigma)


def test_a_constant_speed_is_refused():
    fit = identify_motor([offline_run(SEED, parts=CRUISE)], [], ROBOT)
    assert 'requires starts and stops' in fit.refused[CONSTANT]
    assert not fit.parameters()


@pytest.mark.parametrize('duty, quantity, reason', [
    (0.4, CONSTANT, ''), (0.0, FEED_FORWARD, 'the duty is zero while the wheels turn')])
def test_a_duty_that_does_not_change_does_not_determine_the_torque(duty, quantity, reason):
    run = in_step_run(SEED)
    steady = replace(run.duties, duty=np.full_like(run.duties.duty, duty))
    fit = identify_motor([replace(run, duties=steady)], [], ROBOT)
    assert reason in fit.refused[quantity] and fit.get(STALL) is None


def test_a_constant_that_is_known_better_is_kept():
    robot = build(RobotParams, {'motor.torque_constant_sigma': 0.01})
    fit = found(lifted=False, robot=robot)
    assert fit.refused[CONSTANT].endswith('requires a recording with lifted wheels')
    assert 'already known to 1.0%' in fit.refused[CONSTANT]


@pytest.mark.parametrize('records, reason', [
    (lambda ground, lifted: ([lifted], []), 'they slide, or are lifted'),
    (lambda ground, lifted: ([ground], [ground]), 'they are not lifted'),
    (lambda ground, lifted: ([changed(ground, torque=None)], []), 'without motor torque'),
    (lambda ground, lifted: ([changed(ground, torque=np.where(
        [False, False, True, False], np.nan, ground.wheels.torque))], []),
     'rear_left was not measured'),
    (lambda ground, lifted: ([changed(ground, torque=np.copysign(
        ground.wheels.torque, ground.wheels.velocity))], []), 'magnitudes of currents'),
    (lambda ground, lifted: ([offline_run(SEED, parts=((0.6, 60.0),))], []),
     'readings in straight motion')], ids=lambda value: value if isinstance(value, str) else '')
def test_recordings_that_cannot_be_those_of_drives_are_refused(records, reason):
    with pytest.raises(EstimatorError, match=reason):
        identify_motor(*records(offline_run(SEED), offline_run(SEED, lifted=True)), ROBOT)
