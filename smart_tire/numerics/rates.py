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
