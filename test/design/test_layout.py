# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Layouts: their films, their load of the radio link, their accuracy."""

from dataclasses import replace
import math

import pytest
from smart_tire.calibration.film_gains import volts_per_slip
from smart_tire.design.drive import DriveInformation, DriveSchedule, Ground
from smart_tire.design.layout import Accuracy, FilmLayout, Study
from smart_tire.errors import ParameterError
from smart_tire.parameters import build, RobotParams

ROBOT = RobotParams()
PAPER = FilmLayout.of(ROBOT)
DRIVE = DriveSchedule('turn', ((0.5, 60.0, 80.0),), 4.0)


@pytest.fixture(scope='module')
def study():
    """Return the study of a short turn on concrete."""
    return Study([DriveInformation(ROBOT, Ground('concrete', 52.7, 0.47, 0.015), DRIVE)])


def test_the_layout_of_the_paper_gives_its_robot():
    assert FilmLayout(1, 2, 0.020, 0.030, 0.0, 400.0, 10, 0.005) == PAPER
    film, own = PAPER.robot(ROBOT).film, ROBOT.film
    assert film.stretch_gain == pytest.approx(own.stretch_gain)
    assert film.bending_peak == pytest.approx(own.bending_peak)
    assert (film.centers, film.wheels, film.bits) == (own.centers, own.wheels, own.bits)
    assert film.noise == pytest.approx(own.noise)


@pytest.mark.parametrize('length', [0.010, 0.035])
def test_a_film_of_another_length_reaches_the_range_at_the_same_slip(length):
    own, film = ROBOT.film, replace(PAPER, length=length, spacing=0.05).robot(ROBOT).film
    full = own.voltage_range - own.rest_voltage
    for i in range(2):
        slip = (full - own.bending_peak[i]) / volts_per_slip(own.stretch_gain[i], 0.020, 0.046)
        output = film.bending_peak[i] + slip * volts_per_slip(film.stretch_gain[i], length, 0.046)
        assert output == pytest.approx(full)
    # a short film needs a larger gain, which amplifies the noise of the charge
    assert film.noise / own.noise == pytest.approx(max(
        a / b for a, b in zip(film.stretch_gain, own.stretch_gain)))
    assert (film.noise > own.noise) == (length < 0.020)


def test_more_films_repeat_those_of_the_robot_on_more_wheels():
    film = replace(PAPER, films=3, wheels=2).robot(ROBOT).film
    assert film.stretch_gain == pytest.approx((307.5, 242.5, 307.5))
    assert film.centers == pytest.approx((0.0, 0.030, 0.060))
    assert film.wheels == ('front_right', 'front_left')
    several = build(RobotParams, {
        'film.wheels': ['front_right', 'front_left'],
        'film.stretch_gain': [300.0, 200.0, 9.0, 9.0],
        'film.bending_peak': [0.8, 0.6, 0.1, 0.1]})
    assert replace(PAPER, films=3).robot(several).film.bending_peak == pytest.approx(
        (0.8, 0.6, 0.8))


@pytest.mark.parametrize('wrong', [{'spacing': 0.021}, {'films': 4, 'spacing': 0.2}])
def test_films_that_do_not_fit_are_refused(wrong, study):
    with pytest.raises(ParameterError):
        replace(PAPER, **wrong).robot(ROBOT)
    assert study.accuracy(replace(PAPER, **wrong)) == Accuracy(*[math.inf] * 4)


def test_the_radio_load_has_samples_and_headers():
    # per batch of 16: 12 bytes of header and 2 of battery
    assert PAPER.radio_load(16) == pytest.approx(400.0 * (2 * 10 + 14 * 8 / 16))
    assert replace(PAPER, wheels=3, rate=100.0).radio_load(16) == pytest.approx(
        0.75 * PAPER.radio_load(16))


def test_films_lower_the_bound_and_more_wheels_lower_it_further(study):
    none, one, paper, two = (study.accuracy(replace(PAPER, **values)) for values in (
        {'wheels': 0}, {'films': 1}, {}, {'wheels': 2}))
    assert none.friction > 2.0 * one.friction
    assert one.friction > paper.friction > two.friction
    assert none.slip > one.slip > paper.slip > 1.2 * two.slip
    assert (none.film_slip, none.contact_length) == (math.inf, 0.1)
    assert 0.006 < paper.contact_length < one.contact_length < 0.03


def test_off_the_middle_a_single_film_is_worse_and_a_pair_is_not(study):
    single = replace(PAPER, films=1)
    assert study.accuracy(replace(single, across=0.8)).friction > (
        1.05 * study.accuracy(single).friction)
    assert study.accuracy(replace(PAPER, across=0.8)) == study.accuracy(PAPER)


def test_the_accuracy_is_the_rms_over_drives(study):
    sand = DriveInformation(ROBOT, Ground('sand', 30.0, 0.35, 0.16), DRIVE)
    first, second, both = (one.accuracy(PAPER) for one in (
        study, Study([sand]), Study([*study.drives, sand])))
    assert both == pytest.approx([math.sqrt(0.5 * (a * a + b * b))
                                  for a, b in zip(first, second)])


def test_friction_and_slip_may_be_those_of_the_wheels_with_films(study):
    own = Study(study.drives, wheels=PAPER.names).accuracy(PAPER)
    assert own.slip < 0.8 * study.accuracy(PAPER).slip
