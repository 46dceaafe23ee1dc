"""Mean rates between two readings of a position."""

from __future__ import annotations

from collections.abc import Iterable


def mean_rates(before: Iterable[float], after: Iterable[float], elapsed: float) -> list[float]:
    """
    Return the mean rates of change from ``before`` to ``after`` over ``elapsed`` [s].

    >>> mean_rates([1.0, 2.0], [1.5, 2.0], 0.25)
    [2.0, 0.0]
    """
    return [(new - old) / elapsed for old, new in zip(before, after)]
