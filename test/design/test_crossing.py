# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Exact crossings: closed forms, and what raises or lowers their covariance."""

from dataclasses import replace

import pytest
from smart_tire.design.crossing import ExactCrossings, REPEATED
from smart_tire.design.drive import Place
from smart_tire.estimation.contact.trajectory import WheelTrajectory
from smart_tire.estimation.friction.waveform_model import Shared
from smart_tire.parameters import build, RobotParams
from smart_tire.samples import NS_PER_S

SPEED = 0.5     # m/s
PLACE = Place(2.0, SPEED, 0.1, 0.15)


def trajectory(robot, stop=99.0):
    """Return a path at ``SPEED``, up to a ``stop`` [s]."""
    encoder, rate = robot.encoder, SPEED / robot.wheel_radius
    path = WheelTrajectory(robot.wheel_radius, encoder.counts_per_revolution,
                           encoder.stamp_jitter)
    for i in range(80):
        time = i / 16.0
        path.add_wheel(round(time * NS_PER_S), rate * (time < stop), rate * min(time, stop))
    return path


def measured(place=PLACE, films=(0, 1), length_sigma=0.0, count=1, **values):
    """Return the result of the last of ``count`` crossings, which differ a little."""
    robot = build(RobotParams, {f'film.{name}': value for name, value in values.items()})
    exact = ExactCrossings(robot, 'front_right', trajectory(robot), length_sigma)
    for i in range(count):
        result = exact.measure(films, place._replace(slip=place.slip + 0.001 * i))
    return result


def test_the_fit_stays_at_the_truth():
    for slip, normalized in ((0.1, 0.15), (-0.1, 0.15), (0.05, 0.3)):
        slips = measured(PLACE._replace(slip=slip, normalized_slip=normalized)).slips
        assert (slips.slip, slips.normalized_slip) == pytest.approx((slip, normalized), abs=1e-4)


def test_without_noise_the_slip_has_the_error_of_the_gain():
    exact = {'noise': 2e-5, 'bits': 24}
    for films, share in (((0,), 1.0), ((0, 1), 0.5**0.5)):
        found = measured(films=films, **exact, stretch_gain_tolerance=0.03).slips.slip_sigma
        assert found == pytest.approx(0.1 * 0.03 * share, rel=0.1)
    assert measured(**exact, stretch_gain_tolerance=0.0).slips.slip_sigma < 0.0008


def test_a_much_larger_noise_has_a_proportional_error():
    low, high = (measured(noise=noise, bits=24, films=(0,)).slips.white_cov[0, 0]**0.5
                 for noise in (0.005, 0.020))
    assert 2.0 < high / low < 4.0


def test_a_higher_rate_lowers_the_error_and_an_unknown_length_raises_it():
    slow, normal, fast = (measured(sample_rate=rate).slips.normalized_slip_sigma
                          for rate in (150.0, 400.0, 1600.0))
    assert slow > 1.2 * normal and normal > 1.2 * fast > 0.6 * normal
    known, unknown = (measured(length_sigma=sigma) for sigma in (0.0, 0.1))
    assert unknown.slips.normalized_slip_sigma > 1.2 * known.slips.normalized_slip_sigma
    assert unknown.waveform.shared(Shared.LENGTH).sigma < 0.03
    assert known.waveform.shared(Shared.LENGTH).sigma == 0.0


def test_coarse_steps_of_the_converter_count_as_noise():
    step = 3.3 / 63
    coarse, noisy = (measured(**values).slips.slip_sigma for values in (
        {'noise': 0.0, 'bits': 6}, {'noise': step / 12.0**0.5, 'bits': 24}))
    assert coarse == pytest.approx(noisy, rel=0.02)


def test_errors_of_the_rolled_distance_raise_the_error():
    robot = RobotParams()
    fine, coarse = (ExactCrossings(one, 'front_right', trajectory(one)).measure((0, 1), PLACE)
                    for one in (robot, replace(robot, encoder=replace(
                        robot.encoder, stamp_jitter=0.1, counts_per_revolution=10.0))))
    assert coarse.slips.slip_sigma > fine.slips.slip_sigma


def test_clipped_samples_have_no_information():
    clipped, free = (measured(voltage_range=limit, rest_voltage=1.65, bits=24).slips.slip_sigma
                     for limit in (2.5, 3.3))
    assert clipped > 1.1 * free


def test_the_shape_is_learned():
    assert measured(count=8).slips.normalized_slip_sigma < (
        0.9 * measured().slips.normalized_slip_sigma)


def test_crossings_of_steady_motion_are_computed_some_times_only():
    robot = RobotParams()
    exact = ExactCrossings(robot, 'front_right', trajectory(robot))
    first, *others = [exact.measure((0, 1), PLACE._replace(time=2.0 + 0.0003 * i))
                      for i in range(REPEATED + 3)]
    assert len(set(map(id, [first, *others]))) == REPEATED
    assert others[-1].slips.normalized_slip_sigma < first.slips.normalized_slip_sigma
    assert exact.measure((0,), PLACE) is not others[-1]


def test_reverse_is_like_forward():
    robot = RobotParams()
    path = WheelTrajectory(robot.wheel_radius, 2000.0, 0.001)
    for i in range(80):
        path.add_wheel(round(i / 16.0 * NS_PER_S), -SPEED / robot.wheel_radius,
                       -i / 16.0 * SPEED / robot.wheel_radius)
    back = ExactCrossings(robot, 'front_right', path).measure((0,), PLACE._replace(speed=-SPEED))
    assert back.slips.slip_sigma == pytest.approx(measured(films=(0,)).slips.slip_sigma, rel=1e-6)


def test_a_wheel_that_stops_in_the_patch_shows_nothing():
    robot = RobotParams()
    path = trajectory(robot, stop=PLACE.time + 0.02)
    assert ExactCrossings(robot, 'front_right', path).measure((0, 1), PLACE) is None
