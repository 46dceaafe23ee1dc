# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Values of the latest seconds by their times."""

from hypothesis import given, strategies as st
import numpy as np
import pytest

from smart_tire.control.constants import HISTORY_NS
from smart_tire.control.history import History
from smart_tire.samples import NS_PER_S


@given(st.lists(st.integers(1, 3 * NS_PER_S), min_size=2, max_size=20), st.floats(0.0, 1.0),
       st.integers(0, NS_PER_S))
def test_values_are_interpolated_or_held_until_they_are_too_old(gaps, share, max_age):
    history, times = History(), np.cumsum(gaps)
    for time_ns in times.tolist():
        history.add(time_ns, float(time_ns) ** 0.5, -1.0)
    recent = int((times > times[-1] - HISTORY_NS).sum()) + 1
    kept = times[-max(recent, 2):]
    assert history.times == kept.tolist()
    wanted = int(kept[0] + share * (kept[-1] - kept[0]))
    assert history.at(wanted) == pytest.approx((np.interp(wanted, kept, kept ** 0.5), -1.0))
    before = kept[kept <= wanted][-1]
    assert history.held(wanted, max_age) == (
        (float(before) ** 0.5, -1.0) if wanted - before <= max_age else None)
    assert history.held(int(kept[0]) - 1) is None


def test_an_earlier_time_discards_all_others():
    history = History()
    for time_ns in (5, 6, 3):
        history.add(time_ns, 1.0)
    assert history.times == [3]
