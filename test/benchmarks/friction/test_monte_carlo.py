# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Synthesized crossings: the waveform is near the bound, two peaks are not."""

from benchmarks.friction.grid import Case
from benchmarks.friction.monte_carlo import run_case
import pytest


def test_only_the_waveform_method_is_near_the_bound():
    found = run_case('slip', Case(slip=0.15), 30)
    own, exact, printed = (found.figures[name] for name in ('bounded', 'exact', 'printed'))
    assert (found.values['found'], own['finite']) == (1.0, 1.0)
    assert abs(own['bias']) < 0.02 and 0.6 < own['spread'] < 1.5
    assert exact['q90'] > 5.0 * own['q90'] and printed['bias'] > 0.4


@pytest.mark.parametrize('case', [Case(slip=-0.1), Case(slip=0.1, release='state')])
def test_two_peaks_are_not_applied_where_they_do_not_exist(case):
    assert run_case('some', case, 3).errors.keys() == {'single', 'bounded'}
