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

"""Required tracking errors of the slip-compensated kinematics, relative to the ideal ones."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.control.scenarios import IDEAL, OURS
from benchmarks.control.tracking_results import Combined

MAX_SHARE = 0.5           # of the error of the ideal kinematics, on sand and over changes
MAX_CONCRETE_SHARE = 1.0  # on concrete


def max_error(row: Mapping[str, Combined], *, concrete: bool) -> float:
    """
    Return the largest rms error [m] that is allowed for a row of the table.

    With estimated localization its error is added, except on concrete.
    """
    if concrete:
        return MAX_CONCRETE_SHARE * row[IDEAL].rms
    return MAX_SHARE * row[IDEAL].rms + row[OURS].localization


def met(row: Mapping[str, Combined], *, concrete: bool) -> bool:
    """Return whether a row of the table meets the requirements, arrival included."""
    ours = row[OURS]
    return ours.arrived == 1.0 and ours.rms <= max_error(row, concrete=concrete)
