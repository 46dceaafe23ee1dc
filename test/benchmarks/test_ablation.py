# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The parts that the ablation leaves out exist, and are back afterwards."""

from benchmarks.robots import ablation
import pytest
from smart_tire.estimation.ground import events, unknowns, window, window_fit
from smart_tire.estimation.slip import ground


@pytest.mark.parametrize('part', ablation.CONSTANTS)
def test_a_constant_is_replaced_wherever_it_is_used(part):
    name, value = ablation.CONSTANTS[part]
    modules = [one for one in (unknowns, events, window_fit, ground) if hasattr(one, name)]
    before = [getattr(one, name) for one in modules]
    with ablation.without(part):
        assert modules and all(getattr(one, name) == value for one in modules)
    assert [getattr(one, name) for one in modules] == before


def test_an_unknown_is_fixed_at_the_mean_of_its_prior():
    known = window.priors
    with ablation.without('com_x'):
        rows = window.priors(ablation.draw('concrete', 1).robot)
        first = unknowns.Unknown.COM_X
        assert [row.sigma for row in rows[first:first + 2]] == [ablation.NEGLIGIBLE] * 2
        assert rows[unknowns.Unknown.RADIUS].sigma > 0.005
    assert window.priors is known


def test_a_part_that_no_module_has_is_an_error(monkeypatch):
    monkeypatch.setitem(ablation.CONSTANTS, 'gone', ('NO_SUCH_CONSTANT', 0.0))
    with pytest.raises(KeyError, match='gone: no module'), ablation.without('gone'):
        pass
