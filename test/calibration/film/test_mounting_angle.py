"""The angle of a film on its wheel, from readings of it in many passages."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.calibration.film.mounting_angle import film_angle, LATENESS_SIGMA
from smart_tire.errors import EstimatorError

SCATTER = 0.004  # rad


def readings(seed, angle, speeds, lateness=0.0):
    """Return angles as read, on many turns of the wheel."""
    rng = np.random.default_rng(seed)
    speeds = np.asarray(speeds)
    turns = math.tau * np.arange(len(speeds))
    return (angle + turns + lateness * speeds + SCATTER * rng.standard_normal(len(speeds)),
            speeds)


@pytest.mark.parametrize('angle', [0.0, 0.001, 3.0, math.tau - 0.001])
def test_an_angle_at_the_end_of_a_turn_is_as_good_as_any(angle):
    found = film_angle(*readings(1, angle, [6.0] * 20))
    assert 0.0 <= found.value < math.tau
    assert abs(math.remainder(found.value - angle, math.tau)) < 3.0 * found.sigma


@pytest.mark.parametrize('speeds', [[6.0] * 16, [4.0, 9.0] * 8, [8.0, -8.0] * 8], ids=str)
def test_stamps_that_are_late_are_told_by_several_speeds_and_else_allowed_for(speeds):
    off = []
    for seed in range(60):
        lateness = LATENESS_SIGMA * np.random.default_rng([seed, 1]).standard_normal()
        found = film_angle(*readings(seed, 2.0, speeds, lateness))
        off.append((found.value - 2.0) / found.sigma)
    assert 0.75 < math.sqrt(np.mean(np.square(off))) < 1.3
    assert (found.sigma > 0.01) == (len(set(speeds)) == 1)


def test_a_passage_that_is_off_does_not_count():
    angles, speeds = readings(3, 2.0, [8.0, -8.0] * 8)
    spoiled = angles.copy()
    spoiled[4] += 0.5
    clean = film_angle(np.delete(angles, 4), np.delete(speeds, 4))
    assert film_angle(spoiled, speeds).value == pytest.approx(clean.value, abs=1e-3)


@pytest.mark.parametrize(('angles', 'why'), [
    ([1.0, 1.0], '2 passages'), ([1.0, math.nan, 1.0, 1.0], 'without positions'),
    ([0.2, 1.9, 3.0, 4.4, 5.8, 2.2], 'scatter')])
def test_what_tells_no_angle_is_refused_with_the_reason(angles, why):
    with pytest.raises(EstimatorError, match=why):
        film_angle(angles, [6.0] * len(angles))
