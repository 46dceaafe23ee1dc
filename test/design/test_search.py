# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The search for the best layout, its limits, and tables and maps around it."""

from dataclasses import replace
import math
from types import SimpleNamespace

import numpy as np
import pytest
from smart_tire.design import search as searching
from smart_tire.design.drive import DriveSchedule, Ground
from smart_tire.design.layout import Accuracy, FilmLayout
from smart_tire.design.search import (
    AXES, best_layouts, FACTORS, Limits, maps, search, sensitivity, values_of)
from smart_tire.parameters import RobotParams

PAPER = FilmLayout.of(RobotParams())
LIMITS = Limits(films=4, rate=800.0, bits=10, budget=20e3, batch=16)


class Bowl:
    """A study whose accuracy is least at a planted layout; more films and samples are better."""

    def __init__(self, length=0.028, spacing=0.110):
        self.robot, self.length, self.spacing = RobotParams(), length, spacing
        self.drives = [SimpleNamespace(
            robot=self.robot, ground=Ground('a', 50.0, 0.5, 0.01), torque=True,
            drive=DriveSchedule('b', ((1.0, 60.0, 80.0),), 8.0))]

    def accuracy(self, layout):
        off = (layout.length / self.length - 1.0)**2 + (layout.spacing / self.spacing - 1.0)**2
        if layout.length > 0.034:
            return Accuracy(*[math.inf] * 4)
        value = (1.0 + off) / math.sqrt(layout.films * layout.wheels * layout.rate)
        return Accuracy(value, 2.0 * value, 3.0 * value, 4.0 * value + layout.across)


def test_the_search_finds_a_planted_optimum():
    study, choices = Bowl(), {name: values_of(name) for name in ('length', 'spacing')}
    for start in (PAPER, replace(PAPER, length=0.036)):  # does not fit
        found = search(lambda one: study.accuracy(one).friction, start, choices)
        assert (found.length, found.spacing) == pytest.approx((0.028, 0.110))
        assert replace(found, length=0.020, spacing=0.030) == PAPER


def test_a_negligible_improvement_is_no_reason_for_another_layout():
    found = search(lambda one: 1.0 - 1e-3 * (one.length > 0.021), PAPER, {
        'length': values_of('length')})
    assert found == PAPER


def test_the_rate_is_the_largest_within_limit_and_budget():
    assert LIMITS.sampled(PAPER).rate == pytest.approx(20e3 / 27.0)
    assert LIMITS.sampled(PAPER).radio_load(16) == pytest.approx(20e3)
    assert LIMITS.sampled(replace(PAPER, films=1)).rate == 800.0


def test_the_best_of_each_number_of_films_keeps_the_limits():
    found = list(best_layouts(Bowl(), PAPER, LIMITS, 'friction'))
    assert [(one.wheels, one.films) for one in found] == [
        (1, 1), (1, 2), (1, 3), (1, 4), (2, 1), (2, 2), (3, 1), (4, 1)]
    for one in found:
        assert one.radio_load(16) <= 20e3 * (1.0 + 1e-9)
        assert one.rate <= 800.0 and one.bits <= 10
    assert found[1].bits == 6  # more samples of fewer bits: quantization is none here


def test_what_never_fits_is_no_layout():
    study = Bowl()
    study.accuracy = lambda layout: Accuracy(*[math.inf] * 4)
    assert list(best_layouts(study, PAPER, LIMITS, 'friction')) == []


def test_another_quantity_has_another_optimum():
    off = replace(PAPER, across=0.4)
    by_length, by_friction = (next(iter(best_layouts(Bowl(), off, LIMITS, quantity)))
                              for quantity in ('contact_length', 'friction'))
    assert (by_length.across, by_friction.across) == (0.0, 0.4)


def test_the_table_changes_one_property_after_another(monkeypatch):
    made = []

    def information(robot, ground, drive, torque):
        made.append((drive.legs[0][1] / 60.0, robot.tire.contact_length / 0.046,
                     robot.tire.longitudinal_stiffness / 52.7, ground.stiffness / 50.0, torque))

    monkeypatch.setattr(searching, 'DriveInformation', information)
    monkeypatch.setattr(searching, 'Study', lambda drives: Bowl())
    rows = list(sensitivity(Bowl(), PAPER))
    assert list(dict.fromkeys(row[0] for row in rows)) == [
        *AXES, 'wheel_speed', 'tire_length', 'tire_stiffness']
    by_rate = {value: accuracy.friction for name, value, accuracy in rows if name == 'rate'}
    assert by_rate[200.0] == pytest.approx(2.0 * by_rate[800.0])
    assert np.array(made) == pytest.approx(np.array([
        *((one, 1.0, 1.0, 1.0, True) for one in FACTORS if one != 1.0),
        *((1.0, one, 1.0, 1.0, True) for one in FACTORS if one != 1.0),
        *((1.0, 1.0, one, one, True) for one in FACTORS if one != 1.0)]))


def test_the_maps_have_the_values_of_their_axes_and_gaps_where_films_do_not_fit():
    study, shown = Bowl(), []
    figure = maps(study, PAPER, 'friction', shown.append)
    assert len(figure.panels) == len(shown) == 6
    field = figure.panels[0].field
    lengths, spacings = values_of('length'), values_of('spacing')
    assert field.values.shape == (len(spacings), len(lengths))
    assert field.values[2, 1] == pytest.approx(100.0 * study.accuracy(
        replace(PAPER, length=lengths[1], spacing=spacings[2])).friction)
    assert np.isnan(field.values[:, -1]).all() and np.isfinite(field.values[:, :-1]).all()
    left, right, bottom, top = field.extent
    assert (left, right, bottom, top) == pytest.approx((6.0, 38.0, 12.5, 147.5))
    assert field.limits[0] == pytest.approx(np.nanmin(field.values))
