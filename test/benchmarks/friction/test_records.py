# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""True crossings of a constructed run, matched with estimates by time and distance."""

from __future__ import annotations

from dataclasses import replace
import math

from benchmarks.friction.records import (
    concatenated, FUSED, match_rows, selected_rows, SINGLE, true_crossings)
import numpy as np
import pytest
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, Odometry, WheelSlip
from smart_tire.uncertain import Uncertain

WHEEL = 'front_right'
SPEED, SLIP = 0.5, 0.1  # m/s, -, of the constructed run
EXACT = (0.0,) * 36


def ns(seconds):
    return round(seconds * NS_PER_S)


def crossing(time, mu=0.47, sigma=0.0):
    """Return a crossing of the wheel; all other quantities are NaN."""
    value = {SINGLE: mu, FUSED: mu, 'slip': SLIP, 'total_slip': SLIP,
             'critical_slip': 1.5 * mu, 'normal_load': 26.7, 'stiffness': 52.7}
    return Friction(ns(time), WHEEL,
                    **{name: Uncertain(number, sigma) for name, number in value.items()})


def truth(times, standing=(), seconds=12.0):
    """Return a straight run with crossings at ``times``, stationary between ``standing`` [s]."""
    records = [crossing(time) for time in times]
    for stamp in np.arange(0.0, seconds, 0.01):
        still = any(begin <= stamp < end for begin, end in standing)
        v = 0.0 if still else SPEED * (1.0 - SLIP)
        ratio, slide = (math.nan, 0.0) if still else (SLIP, SPEED * SLIP)
        records.append(Odometry(ns(stamp), (0.0,) * 3, (0.0, 0.0, 0.0, 1.0), (v, 0.0, 0.0),
                                (0.0,) * 3, EXACT, EXACT))
        records.append(WheelSlip(ns(stamp), (ratio,) * 4, (slide,) * 4, (0.0,) * 4))
    return true_crossings(records, RobotParams(), WHEEL)


def test_speed_and_bound_are_those_of_the_crossing():
    found = truth([2.0, 4.0])
    assert found.speed == pytest.approx([SPEED] * 2)
    assert np.all((found.bound > 0.005) & (found.bound < 0.05))


def test_crossings_at_the_very_end_are_excluded():
    assert len(truth([2.0, 4.0, 11.6]).crossings) == 2


def test_an_estimate_is_matched_with_the_crossing_at_its_timestamp():
    rows = match_rows(truth([2.0, 4.0, 6.0]), [crossing(4.01, 0.5), crossing(6.02, 0.6)], WHEEL)
    assert rows.found.tolist() == [False, True, True]
    assert rows.value[FUSED][1:].tolist() == [0.5, 0.6]
    assert math.isnan(rows.value[FUSED][0])
    assert rows.true[FUSED].tolist() == [0.47] * 3
    assert rows.false == 0


def test_timestamps_may_differ_if_the_wheel_stops_within_a_crossing():
    run = truth([2.0, 8.0], standing=[(5.0, 8.0)])
    rows = match_rows(run, [crossing(2.0), crossing(5.005)], WHEEL)
    assert rows.found.all()
    assert rows.false == 0
    elsewhere = match_rows(run, [crossing(2.0), crossing(4.5)], WHEEL)
    assert elsewhere.found.tolist() == [True, False]
    assert elsewhere.false == 1


def test_estimates_without_crossing_are_false_except_after_the_last_one():
    estimates = [crossing(2.0), crossing(3.0), crossing(4.0), crossing(11.9)]
    assert match_rows(truth([2.0, 4.0]), estimates, WHEEL).false == 1


def test_crossings_of_other_wheels_are_ignored():
    other = replace(crossing(2.0), wheel='rear_left')
    rows = match_rows(truth([2.0]), [other], WHEEL)
    assert not rows.found.any()
    assert rows.false == 0


def test_rows_can_be_concatenated_and_selected():
    one = match_rows(truth([2.0, 4.0]), [crossing(2.0), crossing(3.0)], WHEEL)
    both = concatenated([one, one])
    assert len(both.found) == 4
    assert both.false == 2
    some = selected_rows(both, both.found)
    assert some.found.tolist() == [True, True]
    assert len(some.true[SINGLE]) == len(some.stamp_ns) == len(some.bound) == 2
