# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Mean rates between two readings."""

from __future__ import annotations

import pytest

from smart_tire.numerics.rates import mean_rates


def test_rates_are_differences_over_the_elapsed_time():
    assert mean_rates((1.0, -1.0), (2.0, -4.0), 0.5) == pytest.approx([2.0, -6.0])


def test_no_elapsed_time_is_an_error():
    with pytest.raises(ZeroDivisionError):
        mean_rates((0.0,), (1.0,), 0.0)
