# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Information of a drive: limit cases in closed form, and what raises or lowers the bound."""

from dataclasses import replace
import math

import numpy as np
import pytest
from smart_tire.design.drive import DriveInformation, DriveSchedule, Ground
from smart_tire.estimation.ground.measurements import MeasuredCrossing
from smart_tire.estimation.ground.unknowns import CURVE_ERROR, Unknown
from smart_tire.estimation.ground.window_fit import start_of
from smart_tire.models.tire.brush_tire import LN_FRICTION
from smart_tire.parameters import RobotParams
from smart_tire.samples import WHEELS

ROBOT, CONCRETE = RobotParams(), Ground('concrete', 52.7, 0.47, 0.015)
TURN = DriveSchedule('turn', ((0.5, 120.0, 60.0),), 5.0)
NONE, ALL = np.zeros(4), range(4)


@pytest.fixture(scope='module')
def turn():
    """Return the information of a turn on concrete."""
    return DriveInformation(ROBOT, CONCRETE, TURN)


def crossings(drive, wheel, sigma=0.005, turn=0.0):
    return [MeasuredCrossing(one.time, wheel, one.slip, one.normalized_slip,
                             sigma**2 * np.eye(2), False)
            for one in drive.places(wheel, 0.0, turn)]


def noise_of(one):
    """Return the covariance of slip and of its product with the normalized slip."""
    by_slips = np.array([[1.0, 0.0], [one.normalized_slip, one.slip]])
    return by_slips @ one.covariance @ by_slips.T


def test_the_fit_stays_at_the_truth(turn):
    for window in turn.windows:
        x = window.solution.fit.x
        assert np.exp(x[:3]) == pytest.approx(CONCRETE[1:], rel=1e-9)
        assert np.abs(window.solution.fit.rows.residual).max() < 1e-6


def test_a_robot_that_stands_knows_the_prior_only():
    standing = DriveInformation(ROBOT, CONCRETE, DriveSchedule('none', ((0.0, 0.0, 0.0),), 5.0))
    covariance = standing.covariances((), NONE)[-1]
    assert math.sqrt(covariance[Unknown.FRICTION, Unknown.FRICTION]) == pytest.approx(
        LN_FRICTION.sigma, rel=1e-6)
    assert standing.places(1, 0.0) == []


def test_places_are_a_circumference_apart_and_have_the_slip_of_the_plant(turn):
    for wheel, speed in ((0, 120.0), (1, 60.0)):
        places = turn.places(wheel, 0.03)[2:]
        assert np.diff([one.time for one in places]) == pytest.approx(60.0 / speed, rel=0.01)
        assert places[-1].speed == pytest.approx(
            speed / 60.0 * math.tau * ROBOT.wheel_radius, rel=0.01)
    outer, inner = (turn.places(wheel, 0.0)[-1] for wheel in (0, 1))
    assert outer.slip > 0.05 > -0.05 > inner.slip  # the outer wheels drive, the inner ones brake
    # load transfer: the inner wheels slide at a smaller slip
    assert 0.1 < outer.normalized_slip < inner.normalized_slip < 0.3


def test_a_film_further_back_or_a_wheel_turned_is_later(turn):
    first, *others = (turn.places(1, *place)[-1].time for place in (
        (0.0, 0.0), (0.1, 0.0), (0.0, 0.25)))
    circumference = math.tau * ROBOT.wheel_radius
    assert np.mod(np.subtract(others, first), 1.0) == pytest.approx(
        [0.1 / circumference, 0.25], abs=0.01)


def test_information_of_independent_wheels_adds(turn):
    def information(*wheels):
        return np.linalg.inv(turn.covariances(
            [one for wheel in wheels for one in crossings(turn, wheel)], NONE)[0])

    none, left, right, both = (information(*wheels) for wheels in ((), (0,), (1,), (0, 1)))
    scale = np.sqrt(np.diag(none))
    assert (both - left) / np.outer(scale, scale) == pytest.approx(
        (right - none) / np.outer(scale, scale), abs=1e-6)
    assert np.abs((right - none) / np.outer(scale, scale)).max() > 1.0


def test_one_exact_crossing_has_the_information_of_its_noise(turn):
    one, = [one for one in crossings(turn, 1, 0.5) if 2.0 < one.time < 3.0]
    error = Unknown.FILM_ERROR + 1  # of slip times normalized slip, with a derivative of 1
    before, after = (np.linalg.inv(turn.covariances(found, NONE)[0])[error, error]
                     for found in ((), [one]))
    assert after - before == pytest.approx(np.linalg.inv(noise_of(one))[1, 1], rel=0.03)


def test_the_derivative_by_the_friction_is_that_of_the_motion(turn):
    one, = [one for one in crossings(turn, 1, 0.5) if 2.0 < one.time < 3.0]
    error, mu = Unknown.FILM_ERROR + 1, Unknown.FRICTION
    before, after = (np.linalg.inv(turn.covariances(found, NONE)[0]) for found in ((), [one]))
    solution = turn.windows[0].solution
    measurements, truth = solution.measurements, solution.hypothesis
    measurements.set_crossings([one])
    varied = []
    for step in (-0.02, 0.02):  # of ln mu
        x = truth.x[np.newaxis].copy()
        x[0, mu] += step
        motion = measurements.simulate(
            x, *start_of(truth, measurements), truth.events[np.newaxis])
        varied.append(measurements.crossing_values(x, measurements.at_crossings(motion))[0])
    expected = np.linalg.inv(noise_of(one))[1] @ (varied[1] - varied[0]) / 0.04
    assert (after - before)[error, mu] == pytest.approx(expected, rel=0.05)


def test_less_noise_and_more_wheels_lower_the_bound(turn):
    def sigmas(*wheels, sigma=0.005):
        return turn.sigmas([one for wheel in wheels for one in crossings(turn, wheel, sigma)],
                           NONE, ALL)

    order = [sigmas(), sigmas(1, sigma=0.05), sigmas(1), sigmas(1, sigma=0.0005), sigmas(0, 1),
             sigmas(0, 1, 2, 3)]
    for better, worse in zip(order[1:], order):
        assert np.all(np.array(better) < worse)
    assert sigmas(1, sigma=1e3) == pytest.approx(sigmas(), rel=1e-4)


def test_nuisances_raise_the_bound(turn):
    found = crossings(turn, 1)
    least = turn.sigmas(found, NONE, ALL)[0]
    assert turn.sigmas(found, np.full(4, 0.05), ALL)[0] > 1.05 * least
    for robot, torque in (
            (ROBOT, False),
            (replace(ROBOT, motor=replace(ROBOT.motor, torque_constant_sigma=0.3)), True),
            (replace(ROBOT, center_of_mass_sigma=(0.05, 0.05)), True),
            (replace(ROBOT, film=replace(ROBOT.film, stretch_gain_tolerance=0.3)), True)):
        other = DriveInformation(robot, CONCRETE, TURN, torque)
        assert other.sigmas(found, NONE, ALL)[0] > 1.02 * least


def test_no_information_makes_the_friction_better_known_than_the_curve_of_a_tire(turn):
    found = [one for wheel in ALL for one in crossings(turn, wheel, 1e-6)]
    covariance = turn.covariances(found, NONE)[-1][Unknown.FRICTION, Unknown.FRICTION]
    friction, _ = turn.sigmas(found, NONE, ALL)
    assert friction > math.hypot(CURVE_ERROR, 0.5 * math.sqrt(covariance)) > CURVE_ERROR


def test_the_slip_of_a_wheel_with_films_is_better_known(turn):
    by_wheel = [turn.sigmas(crossings(turn, 0), NONE, [wheel])[1] for wheel in range(len(WHEELS))]
    assert by_wheel[0] < by_wheel[1]
