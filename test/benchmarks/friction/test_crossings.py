# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""True crossings of a constructed run: matched with estimates, counted and scored."""

from dataclasses import replace
import math

from benchmarks.friction.crossings import (
    bounded_errors, convergence, FUSED, match_rows, on_one_surface, QUANTITIES, ratio_errors,
    relative_errors, revolutions_on_ground, Rows, SINGLE, true_crossings)
import numpy as np
import pytest
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, WheelSlip
from smart_tire.uncertain import Uncertain
from support.ideal_robot import odometry

WHEEL = 'front_right'
SPEED, SLIP = 0.5, 0.1  # m/s, -, of the constructed run
LOAD, STIFFNESS = 26.7, 52.7


def ns(seconds):
    return round(seconds * NS_PER_S)


def crossing(time, mu=0.47, sigma=0.0):
    """Return a crossing of the wheel; all other quantities are NaN."""
    value = {SINGLE: mu, FUSED: mu, 'slip': SLIP, 'total_slip': SLIP,
             'critical_slip': 1.5 * mu, 'normal_load': LOAD, 'stiffness': STIFFNESS}
    return Friction(ns(time), WHEEL,
                    **{name: Uncertain(number, sigma) for name, number in value.items()})


def truth(times, standing=(), seconds=12.0):
    """Return a straight run with crossings at ``times``, stationary between ``standing`` [s]."""
    records = [crossing(time) for time in times]
    for stamp in np.arange(0.0, seconds, 0.01):
        still = any(begin <= stamp < end for begin, end in standing)
        v = 0.0 if still else SPEED * (1.0 - SLIP)
        ratio, slide = (math.nan, 0.0) if still else (SLIP, SPEED * SLIP)
        records += [odometry(ns(stamp), v_x=v),
                    WheelSlip(ns(stamp), (ratio,) * 4, (slide,) * 4, (0.0,) * 4)]
    return true_crossings(records, RobotParams(), WHEEL)


def rows(mu, single=None, fused=None, *, relative=0.02, estimated_stiffness=STIFFNESS):
    """Return crossings with true ``mu``, and estimates with ``relative`` sigma besides C_x."""
    mu = np.asarray(mu, float)
    n = len(mu)
    single = mu if single is None else np.asarray(single, float)
    fused = single if fused is None else np.asarray(fused, float)
    true = {name: np.zeros(n) for name in QUANTITIES} | {
        SINGLE: mu, FUSED: mu, 'normal_load': np.full(n, LOAD),
        'stiffness': np.full(n, STIFFNESS)}
    value = true | {SINGLE: single, FUSED: fused, 'stiffness': np.full(n, estimated_stiffness)}
    sigma = {name: np.zeros(n) for name in QUANTITIES} | {
        SINGLE: math.hypot(relative, 0.1) * single, 'stiffness': 0.1 * value['stiffness']}
    return Rows(np.arange(n), np.full(n, SPEED), np.isfinite(single), true, value, sigma, 0)


def everything(crossings):
    return np.ones(len(crossings.found), bool)


def test_the_bound_is_the_sigma_of_informative_crossings():
    found = truth([2.0, 4.0])
    assert found.speed == pytest.approx([SPEED] * 2)
    matched = match_rows(found, [crossing(2.0, 0.5), crossing(4.0, 0.5)], WHEEL)
    errors = bounded_errors(matched, found, RobotParams(), everything(matched))
    assert errors.error == pytest.approx([0.5 / 0.47 - 1.0] * 2)
    assert np.all((errors.sigma > 0.005) & (errors.sigma < 0.05))


def test_an_estimate_is_matched_with_the_crossing_at_its_timestamp_except_at_the_very_end():
    run = truth([2.0, 4.0, 6.0, 11.6])
    assert len(run.crossings) == 3
    found = match_rows(run, [crossing(4.01, 0.5), crossing(6.02, 0.6)], WHEEL)
    assert found.found.tolist() == [False, True, True]
    assert found.value[FUSED][1:].tolist() == [0.5, 0.6] and math.isnan(found.value[FUSED][0])
    assert found.true[FUSED].tolist() == [0.47] * 3 and found.false == 0


def test_timestamps_may_differ_if_the_wheel_stops_within_a_crossing():
    run = truth([2.0, 8.0], standing=[(5.0, 8.0)])
    found = match_rows(run, [crossing(2.0), crossing(5.005)], WHEEL)
    assert found.found.all() and found.false == 0
    elsewhere = match_rows(run, [crossing(2.0), crossing(4.5)], WHEEL)
    assert elsewhere.found.tolist() == [True, False] and elsewhere.false == 1


def test_estimates_without_crossing_are_false_except_after_the_last_one_or_of_other_wheels():
    estimates = [crossing(2.0), crossing(3.0), crossing(4.0), crossing(11.9),
                 replace(crossing(2.5), wheel='rear_left')]
    assert match_rows(truth([2.0, 4.0]), estimates, WHEEL).false == 1


@pytest.mark.parametrize(('mu', 'revolutions'), [
    ([.47] * 3 + [.25] * 3, [1, 2, 3, 1, 2, 3]), ([.47, .47, .36, .25, .25], [1, 2, 1, 1, 2]),
    ([.47, .47 + 1e-12, .47], [1, 2, 3])])
def test_revolutions_count_from_the_last_change_of_friction(mu, revolutions):
    assert revolutions_on_ground(rows(mu)).tolist() == revolutions


def test_revolutions_count_from_the_last_change_of_stiffness():
    found = rows([.25] * 5)
    found.true['stiffness'][3:] = 25.0
    assert revolutions_on_ground(found).tolist() == [1, 2, 3, 1, 2]


def test_errors_are_relative():
    found = rows([0.5] * 5, [0.55, 0.45, 0.5, 0.55, math.nan])
    figures = relative_errors(found, SINGLE, everything(found)).figures
    assert [figures[name] for name in ('finite', 'median', 'bias')] == pytest.approx(
        [0.8, 0.1, 0.05])


@pytest.mark.parametrize(('wrong', 'nees'), [(1.0, (0.02 / 0.52 / 0.02)**2), (1.75, 0.0)])
def test_the_consistency_excludes_the_error_and_the_sigma_of_the_stiffness(wrong, nees):
    single = 0.52 if wrong == 1.0 else 0.5 * wrong
    found = rows([0.5] * 4, [single] * 4, estimated_stiffness=STIFFNESS * wrong)
    errors = ratio_errors(found, everything(found))
    assert errors.sigma == pytest.approx([0.02 * single] * 4)
    assert errors.figures['nees'] == pytest.approx(nees, abs=1e-9)


def test_crossings_on_two_surfaces_are_not_scored():
    assert on_one_surface(rows([0.47, 0.47, 0.30, 0.2, 0.2])).tolist() == [
        True, True, False, True, True]


def test_revolutions_are_counted_until_convergence_on_each_surface_that_lasts():
    mu = [0.47] * 4 + [0.2] * 5 + [0.3] + [0.6] * 3
    fused = [0.9, 0.47, 0.47, 0.47] + [0.47, 0.3, 0.21, 0.2, 0.2] + [0.3] + [0.2, 0.2, 0.3]
    assert convergence(rows(mu, fused=fused)) == [2.0, 3.0, math.inf]
