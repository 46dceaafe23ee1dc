"""Smoothed sliding lies at the middle of the periods that the wheel readings describe."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.lag_compensation import LONGEST, timed
from smart_tire.estimation.slip.output import OutputContext
from smart_tire.estimation.slip.rts_smoother import Smoothed
from smart_tire.estimation.slip.state import N, SLIP_VELS, State

STEP = 0.01
PERIOD = 0.1  # s, of the wheel readings


def state(time, wheels_at, slides, stretch=0):
    x = [float(row) for row in range(N)]
    x[State.SLIP_VEL_L], x[State.SLIP_VEL_R] = slides
    seen = OutputContext(round(time * 1e9), 0.0, 0.0, (0.0, 0.0), 0.0, (0.0,) * 4, time, wheels_at)
    return Smoothed(stretch, seen, x, 1e-4 * np.eye(N))


def run(sliding, end=2.0, late=0.0, stretch=0):
    """Return states whose sliding is the mean over the reading that came last, ``late``."""
    states = []
    for k in range(round(end / STEP)):
        time = k * STEP
        middle = max(0.0, (np.floor((time - late) / PERIOD + 1e-9) - 0.5) * PERIOD)
        states.append(state(time, middle, (sliding(middle), -sliding(middle)), stretch))
    return states


def slides(states):
    return np.array([[s.x[row] for row in SLIP_VELS] for s in states])


def times(states):
    return np.array([s.seen.time for s in states])


@pytest.mark.parametrize('late', [0.0, 0.2])
def test_a_sliding_that_grows_evenly_no_longer_lags(late):
    states = run(lambda t: 0.3 * t, late=late)
    moved = list(timed(states))
    assert times(moved).tolist() == times(states).tolist()
    inside = (times(moved) > 0.1) & (times(moved) < 2.0 - 2.0 * PERIOD - late)
    expected = 0.3 * np.stack([times(moved), -times(moved)], axis=1)
    assert np.abs(slides(moved) - expected)[inside].max() < 1e-9
    assert np.abs(slides(states) - expected)[inside].max() > 0.3 * (PERIOD + late)


def test_nothing_else_changes_but_the_spread_where_the_sliding_does():
    def step(t):
        return 0.0 if t < 1.0 else 0.2
    for before, after in zip(run(step), timed(run(step)), strict=True):
        others = [row for row in range(N) if row not in SLIP_VELS]
        assert [before.x[row] for row in others] == [after.x[row] for row in others]
        extra = after.P - before.P
        assert np.count_nonzero(extra) == np.count_nonzero(np.diag(extra)[list(SLIP_VELS)])
        changing = 0.951 < after.seen.time < 1.049
        assert np.all(np.diag(extra)[list(SLIP_VELS)] > 0.0) == changing
        assert extra.max() <= 0.25 * 0.2 ** 2 + 1e-12


def test_steady_sliding_stays_as_it_is():
    states = run(lambda t: 0.1)
    assert slides(timed(states)) == pytest.approx(slides(states))


def test_readings_of_another_stretch_are_not_mixed_in():
    states = run(lambda t: 0.1) + run(lambda t: 0.5, stretch=1)
    assert np.abs(slides(timed(states)) - slides(states)).max() < 1e-12


def test_a_long_silence_of_the_wheels_holds_nothing_up():
    states = run(lambda t: 0.3 * t, end=0.5)
    states += [state(0.5 + k * STEP, 0.35, (0.2, 0.2)) for k in range(round(2 * LONGEST / STEP))]
    given, taken = 0, 0

    def source():
        nonlocal given
        for item in states:
            given += 1
            yield item
    for item in timed(source()):
        taken += 1
        assert given - taken <= LONGEST / STEP + 2
        if item.seen.time > 0.5:
            assert item.x[State.SLIP_VEL_L] == 0.2
    assert taken == len(states)
