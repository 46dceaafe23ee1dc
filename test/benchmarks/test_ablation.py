# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Constants of the estimators get other values before anything is derived from them."""

from importlib.util import module_from_spec

from benchmarks.robots import ablation
import numpy as np
import pytest

from smart_tire.estimation import slip
from smart_tire.estimation.slip import state
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
    name = 'smart_tire.estimation.slip.state'
    spec = ablation.Variation('slip.state.OUTLIER_SIGMAS', 2.0).find_spec(name, slip.__path__)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    assert (module.OUTLIER_SIGMAS, module.MAX_NIS) == (
        2.0 * state.OUTLIER_SIGMAS, 4.0 * state.MAX_NIS)
    assert module.PUSH_SIGMAS == state.PUSH_SIGMAS
    assert ablation.Variation('slip.state.EVIDENCE', 2.0).find_spec(
        'smart_tire.estimation.slip.ground', slip.__path__) is None
