"""Mean rates between two readings."""

from __future__ import annotations

import pytest

from smart_tire.numerics.rates import mean_rates


def test_rates_are_differences_over_the_elapsed_time():
    assert mean_rates((1.0, -1.0), (2.0, -4.0), 0.5) == pytest.approx([2.0, -6.0])


def test_no_elapsed_time_is_an_error():
    with pytest.raises(ZeroDivisionError):
        mean_rates((0.0,), (1.0,), 0.0)
