# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction of the present ground: as measured, and as the robot shows it."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from smart_tire.control.constants import MAX_FRICTION, PRIOR_SIGMA, RAISE_SHARE
from smart_tire.control.ground_knowledge import GroundKnowledge, ShownFriction
from smart_tire.parameters.path_following import FrictionLimitParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GRAVITY, GroundState, NS_PER_S, WheelSample
from smart_tire.uncertain import fused, Uncertain, UNKNOWN
from support.torques import required_torque

PARAMS = FrictionLimitParams(share=0.5, sigmas=2.0, unknown=0.3, minimum=0.05, fade_distance=2.0,
                             fade_time=10.0)
PRIOR = Uncertain(0.3 + 2.0 * PRIOR_SIGMA, PRIOR_SIGMA)
ROBOT, V_X, PERIOD = RobotParams(), 1.0, 0.01
LOAD = ROBOT.mass * GRAVITY / 4.0


def ground(mu, sigma=0.0, stiffness=50.0, stiffness_sigma=5.0, correlation=0.0):
    return GroundState(0, Uncertain(stiffness, stiffness_sigma), Uncertain(mu, sigma),
                       stiffness_friction_correlation=correlation)


def knowledge(*grounds, driven=0.0, now_ns=0):
    """Return what is known of these grounds after a distance driven since."""
    made = GroundKnowledge()
    for one in grounds:
        made.set_ground(one)
    made.drive(driven, now_ns)
    return made


def bound(made):
    """Return the lower bound of the friction."""
    return made.acceleration(PARAMS) / (PARAMS.share * GRAVITY)


def test_unknown_friction_is_the_configured_one():
    assert bound(knowledge()) == pytest.approx(0.3)
    assert knowledge().friction(0.3, PARAMS) == (0.3, PRIOR_SIGMA)


@pytest.mark.parametrize(('mu', 'sigma'), [(0.8, 0.04), (0.8, 0.15), (0.2, 0.15), (0.5, 1.0)])
def test_the_lower_bound_is_some_standard_deviations_below_estimate_and_prior(mu, sigma):
    mean, spread = fused(PRIOR, Uncertain(mu, sigma))
    assert bound(knowledge(ground(mu, sigma))) == pytest.approx(mean - 2.0 * spread)


def test_the_lower_bound_has_a_minimum():
    assert bound(knowledge(ground(0.01, 1e-4))) == pytest.approx(0.05)


def test_an_exact_estimate_has_the_uncertainty_of_the_wheel_load():
    assert bound(knowledge(ground(0.8))) == bound(knowledge(ground(0.8, 0.032)))
    assert bound(knowledge(ground(0.8))) < 0.74


@pytest.mark.parametrize('mu', [0.1, 0.9])
def test_knowledge_fades_with_the_distance_driven_and_the_time_since(mu):
    known = bound(knowledge(ground(mu))) - 0.3
    for distance, time in ((2.0, 0.0), (0.0, 10.0), (1.0, 5.0), (0.0, -10.0)):
        made = knowledge(ground(mu), driven=distance, now_ns=round(time * NS_PER_S))
        assert bound(made) == pytest.approx(0.3 + known / math.e)
    assert bound(knowledge(ground(mu), driven=6.1)) == pytest.approx(0.3)
    assert bound(knowledge(ground(mu), now_ns=31 * NS_PER_S)) == pytest.approx(0.3)


def test_an_estimate_is_as_old_as_the_distance_since_it():
    made, certain = knowledge(driven=5.0), bound(knowledge(ground(0.9)))
    made.set_ground(ground(0.9))
    assert bound(made) == certain
    made.set_ground(ground(0.9), behind=2.0)
    assert bound(made) == pytest.approx(0.3 + (certain - 0.3) / math.e)


@pytest.mark.parametrize('bad', [
    *(replace(ground(0.5), friction_coefficient=one) for one in (
        UNKNOWN, Uncertain(0.5, math.inf), Uncertain(0.5, math.nan), Uncertain(math.inf, 0.1),
        Uncertain(1.3, 1e-3), Uncertain(1e9, 0.0), Uncertain(0.0, 0.1), Uncertain(-0.5, 0.1),
        Uncertain(0.5, -0.1))),
    *(ground(0.5, stiffness=one) for one in (0.9, 1.1e6, -50.0, math.nan)),
    *(ground(0.5, stiffness_sigma=one) for one in (-0.1, math.inf, math.nan)),
    *(ground(0.5, correlation=one) for one in (-1.01, 1.01, math.nan))])
def test_an_implausible_ground_changes_nothing(bad):
    made = knowledge(ground(0.6), bad)
    assert bound(made) == bound(knowledge(ground(0.6)))
    made.clear()
    assert made.latest(PARAMS) is None


@pytest.mark.parametrize(('correlation', 'relative'), [
    (0.0, math.sqrt(0.05)), (1.0, 0.1), (-1.0, 0.3)])
def test_the_critical_slip_over_the_load_is_that_of_the_brush_model(correlation, relative):
    made = knowledge(ground(0.5, 0.05, 50.0, 10.0, correlation))
    measured, weight = made.latest(PARAMS)
    assert measured.friction == (0.5, 0.05)
    assert measured.slip_per_load == pytest.approx((0.03, 0.03 * relative))
    assert weight == 1.0


def test_the_critical_slip_has_at_least_the_uncertainty_of_the_wheel_load():
    measured, _ = knowledge(ground(0.5, 0.05, 50.0, 5.0, 1.0)).latest(PARAMS)
    assert measured.slip_per_load == pytest.approx((0.03, 0.03 * 0.04))


def shown(force, slip, *, prior=0.2, drag=0.0, seconds=1.0, aimed=0.2, effort=True):
    """Return the friction after driving with a ``force`` over the weight at a slip."""
    friction, acceleration = ShownFriction(ROBOT, prior), GRAVITY * (force - drag)
    omega = V_X / (1.0 - slip) / ROBOT.wheel_radius
    torque = float(required_torque(
        force * LOAD, omega, acceleration / ROBOT.wheel_radius, LOAD, ROBOT))
    for step in range(round(seconds / PERIOD)):
        friction.add_wheels(WheelSample(round(step * PERIOD * NS_PER_S), (omega,) * 4, None,
                                        (torque,) * 4 if effort else None), V_X, 0.0)
        friction.learn_resistance(acceleration, V_X, PERIOD, 0.05)
        friction.learn_friction(acceleration, V_X, 1, aimed, PERIOD)
    return friction


def test_the_force_in_use_is_a_lower_bound_of_the_friction():
    assert shown(0.4, 0.01).value == pytest.approx(0.4, rel=1e-3)
    assert shown(2.0, 0.01).value == MAX_FRICTION


def test_wheels_that_slip_with_little_force_show_little_friction():
    assert 0.1 <= shown(0.1, 0.25, prior=0.5, seconds=2.0).value < 0.14
    assert shown(0.1, 0.25, prior=0.5, seconds=0.05).value > 0.3  # it takes a moment


def test_wheels_that_lag_behind_the_aimed_slip_are_no_evidence():
    assert shown(0.02, 0.1, aimed=0.2).value == 0.2


def test_only_soft_ground_with_its_rolling_resistance_raises_the_friction():
    assert shown(0.22, 0.2, drag=0.16).value == pytest.approx(0.22 / RAISE_SHARE, rel=0.02)
    assert shown(0.22, 0.2).value == pytest.approx(0.22, rel=0.02)


def test_a_stop_whose_force_builds_up_late_is_no_evidence():
    friction = shown(0.02, -0.3, prior=0.4, seconds=0.01)
    for _ in range(100):
        friction.learn_friction(-0.2, V_X, -1, 0.2, PERIOD)
    assert friction.value == 0.4


def test_slip_against_the_direction_of_the_limit_is_no_evidence():
    assert shown(0.02, -0.2).value == 0.2


@pytest.mark.parametrize('drag', [0.05, 0.15])
def test_the_motor_torques_show_the_resistance_of_the_ground(drag):
    assert shown(0.4, 0.01, drag=drag, seconds=3.0).value == pytest.approx(0.4, rel=0.02)
    assert shown(0.4, 0.01, drag=drag, effort=False).value == pytest.approx(0.4 - drag, rel=1e-3)


@pytest.mark.parametrize('bad', [math.nan, math.inf, 1e9])
def test_readings_that_are_not_plausible_are_ignored(bad):
    friction = shown(0.3, 0.01)
    sample = WheelSample(10 * NS_PER_S, (bad,) * 4, None, (bad,) * 4)
    for one in (sample, replace(sample, velocity=(10.0,) * 4)):
        friction.add_wheels(one, V_X, 0.0)
        friction.learn_resistance(0.0, V_X, PERIOD, 0.05)
        friction.learn_friction(0.0, V_X, 1, 1.0, PERIOD)
    assert friction.value == pytest.approx(0.3, rel=1e-3)
