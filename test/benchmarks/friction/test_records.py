"""True passages of a made-up run and what is told of them: paired by instant and place."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest

from benchmarks.friction.records import chosen, FUSED, rows_of, SINGLE, together, true_passages
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, Odometry, WheelSlip
from smart_tire.uncertain import Uncertain

WHEEL = 'front_right'
SPEED, SLIP = 0.5, 0.1  # m/s, -, of the made-up run
EXACT = (0.0,) * 36


def ns(seconds):
    return round(seconds * NS_PER_S)


def passage(time, mu=0.47, sigma=0.0):
    """Return a passage of the wheel; every quantity that is not set is NaN."""
    value = {SINGLE: mu, FUSED: mu, 'slip': SLIP, 'total_slip': SLIP,
             'critical_slip': 1.5 * mu, 'normal_load': 26.7, 'stiffness': 52.7}
    return Friction(ns(time), WHEEL,
                    **{name: Uncertain(number, sigma) for name, number in value.items()})


def truth(times, standing=(), seconds=12.0):
    """Return a run straight on with passages at ``times``; still between ``standing`` [s]."""
    records = [passage(time) for time in times]
    for stamp in np.arange(0.0, seconds, 0.01):
        still = any(begin <= stamp < end for begin, end in standing)
        v = 0.0 if still else SPEED * (1.0 - SLIP)
        ratio, slide = (math.nan, 0.0) if still else (SLIP, SPEED * SLIP)
        records.append(Odometry(ns(stamp), (0.0,) * 3, (0.0, 0.0, 0.0, 1.0), (v, 0.0, 0.0),
                                (0.0,) * 3, EXACT, EXACT))
        records.append(WheelSlip(ns(stamp), (ratio,) * 4, (slide,) * 4, (0.0,) * 4))
    return true_passages(records, RobotParams(), WHEEL)


def test_speed_and_bound_are_those_of_the_passage():
    found = truth([2.0, 4.0])
    assert found.speed == pytest.approx([SPEED] * 2)
    assert np.all((found.bound > 0.005) & (found.bound < 0.05))


def test_passages_at_the_very_end_are_not_asked_for():
    assert len(truth([2.0, 4.0, 11.6]).passages) == 2


def test_an_estimate_belongs_to_the_passage_at_its_instant():
    rows = rows_of(truth([2.0, 4.0, 6.0]), [passage(4.01, 0.5), passage(6.02, 0.6)], WHEEL)
    assert rows.found.tolist() == [False, True, True]
    assert rows.value[FUSED][1:].tolist() == [0.5, 0.6]
    assert math.isnan(rows.value[FUSED][0])
    assert rows.true[FUSED].tolist() == [0.47] * 3
    assert rows.false == 0


def test_where_the_wheel_stands_in_a_passage_its_instant_may_be_any():
    run = truth([2.0, 8.0], standing=[(5.0, 8.0)])
    rows = rows_of(run, [passage(2.0), passage(5.005)], WHEEL)
    assert rows.found.all()
    assert rows.false == 0
    elsewhere = rows_of(run, [passage(2.0), passage(4.5)], WHEEL)
    assert elsewhere.found.tolist() == [True, False]
    assert elsewhere.false == 1


def test_what_is_told_where_nothing_passed_is_false_but_not_after_the_last_passage():
    told = [passage(2.0), passage(3.0), passage(4.0), passage(11.9)]
    assert rows_of(truth([2.0, 4.0]), told, WHEEL).false == 1


def test_passages_of_other_wheels_are_passed_over():
    other = replace(passage(2.0), wheel='rear_left')
    rows = rows_of(truth([2.0]), [other], WHEEL)
    assert not rows.found.any()
    assert rows.false == 0


def test_runs_can_be_joined_and_passages_be_chosen():
    one = rows_of(truth([2.0, 4.0]), [passage(2.0), passage(3.0)], WHEEL)
    both = together([one, one])
    assert len(both.found) == 4
    assert both.false == 2
    some = chosen(both, both.found)
    assert some.found.tolist() == [True, True]
    assert len(some.true[SINGLE]) == len(some.stamp_ns) == len(some.bound) == 2
