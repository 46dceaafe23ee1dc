"""Constants of the estimators get other values before anything is derived from them."""

import subprocess
import sys

from benchmarks.robots import ablation
import numpy as np
import pytest

from smart_tire.uncertain import Uncertain


def test_constants_are_the_numbers_of_the_estimators_without_indices():
    names = list(ablation.constants())
    assert {'slip.state.PUSH_SIGMAS', 'plausibility.JERK_DENSITY', 'friction.constants.SLIP_SIGMA',
            'ground.unknowns.SLOPE_SIGMA'} <= set(names)
    assert not {'slip.state.GROUND', 'slip.state.MAX_NIS', 'slip.kalman.MIN_SHARE',
                'ground.measurements.YAW_RATE'} & set(names)  # indices, derived, compiled
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(('value', 'expected'), [
    (2.0, 3.0), (3, 4), (1, 2), ((1.0, 4), (1.5, 6)), (Uncertain(2.0, 0.2), Uncertain(2.0, 0.3)),
    (np.array([1.0, 2.0]), [1.5, 3.0]), (np.linspace(0.0, 5.0, 4), np.linspace(0.0, 5.0, 6)),
    (np.arange(2, 6), [2, 3, 4, 5])])
def test_a_value_is_multiplied(value, expected):
    assert ablation.varied(value, 1.5) == pytest.approx(expected)


@pytest.mark.parametrize(('factor', 'expected'), [(0.1, 1), (3.0, 6)])
def test_a_count_stays_whole(factor, expected):
    found = ablation.varied(2, factor)
    assert (found, type(found)) == (expected, int)


def test_what_is_derived_from_a_constant_follows_it():
    program = (
        'import sys\n'
        'from benchmarks.robots.ablation import Variation\n'
        'assert not [name for name in sys.modules if "estimation" in name]\n'
        'sys.meta_path.insert(0, Variation("slip.state.OUTLIER_SIGMAS", 2.0))\n'
        'from smart_tire.estimation.slip import ground, state\n'
        'print(state.OUTLIER_SIGMAS, ground.MAX_NIS, state.PUSH_SIGMAS)')
    found = subprocess.run([sys.executable, '-c', program], check=True, capture_output=True,
                           text=True)
    assert found.stdout.split() == ['6.0', '36.0', '4.0']
