"""The log of the way gone: means between any two times."""

from __future__ import annotations

import pytest

from smart_tire.estimation.slip.odometry_buffer import MEMORY, OdometryBuffer


def log():
    travel = OdometryBuffer()
    travel.start(1.0)
    for k in range(1, 11):
        travel.add(1.0 + 0.01 * k, float(k), 0.5)
    return travel


def test_the_mean_over_whole_stretches_is_that_of_their_speeds():
    assert log().mean(1.0, 1.1) == pytest.approx((5.5, 0.5))
    assert log().mean(1.02, 1.04) == pytest.approx((3.5, 0.5))


def test_parts_of_stretches_count_by_their_time():
    assert log().mean(1.025, 1.03)[0] == pytest.approx(3.0)
    assert log().mean(1.015, 1.025)[0] == pytest.approx(2.5)


def test_beyond_its_end_the_last_stretch_goes_on():
    assert log().mean(1.1, 1.105)[0] == pytest.approx(10.0)


def test_nothing_is_told_of_what_lies_before_or_is_empty():
    assert log().mean(0.9, 1.05) is None
    assert log().mean(1.05, 1.05) is None
    travel = log()
    for k in range(1000):
        travel.add(1.11 + 0.01 * k, 1.0, 0.0)
    assert travel.mean(1.0, 1.1) is None
    assert travel.mean(11.1 - MEMORY + 0.02, 11.1) == pytest.approx((1.0, 0.0))
