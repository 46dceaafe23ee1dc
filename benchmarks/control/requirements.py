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

"""Requirements of path tracking: control error against the ideal kinematics, localization."""

from __future__ import annotations

from collections.abc import Mapping
import math

from benchmarks.control.scenarios import BEST, OURS, SHORT
from benchmarks.control.tracking_results import Combined

MAX_SHARE = 1.0              # of the control error of the ideal kinematics
MAX_BEST_SHARE = 1.5         # of it with the best look-ahead of each path
MAX_DURATION_SHARE = 1.05    # of the time of the ideal kinematics with the best look-ahead
MAX_YAW_ACCELERATION = 1.2   # rad/s2, rms
MAX_LOCALIZATION = 0.005     # rms error over the length of the path


def max_error(row: Mapping[str, Combined]) -> float:
    """
    Return the largest rms control error [m] that is allowed for a row of the table.

    A best look-ahead counts only where it arrives, and smoothly.
    """
    best = row[BEST]
    counts = best.arrived == 1.0 and best.yaw_acceleration <= MAX_YAW_ACCELERATION
    return min(MAX_SHARE * row[SHORT].rms,
               MAX_BEST_SHARE * best.rms if counts else math.inf)


def missed(row: Mapping[str, Combined]) -> list[str]:
    """Return what a row of the table misses: nothing if all requirements are met."""
    ours = row[OURS]
    checks = {
        'arrival': ours.arrived == 1.0, 'error': ours.rms <= max_error(row),
        'time': ours.duration <= MAX_DURATION_SHARE * row[BEST].duration,
        'yaw': ours.yaw_acceleration <= MAX_YAW_ACCELERATION,
        'localization': ours.localization <= MAX_LOCALIZATION * ours.length}
    return [name for name, met in checks.items() if not met]
