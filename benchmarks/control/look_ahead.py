# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Best look-ahead of the ideal kinematics for each path, for ``scenarios.BEST_LOOK_AHEAD``.

``python -m benchmarks.control.look_ahead``: a grid on concrete and sand, true motion, seed
101. Printed is the one with the smallest sum of squares of control errors among those that arrive
on both with a permitted yaw acceleration and in the time of the ideal kinematics; of the ideal
kinematics if there is none.
"""

from __future__ import annotations

from itertools import product
from unittest import mock

from benchmarks.control import scenarios
from benchmarks.control.run import MAX_DURATION_SHARE, MAX_YAW_ACCELERATION
from benchmarks.control.scenarios import (
    BEST, OWN, PATHS, SHORT, SHORT_LOOK_AHEAD, TrackingCase, TRUE)
from benchmarks.control.tracking import run_tracking
from benchmarks.grounds import CONCRETE, SAND
from benchmarks.scoring import combined, Figures, part_of

TIMES, DISTANCES = (0.1, 0.15, 0.2, 0.28), (0.06, 0.09, 0.12)  # s, m
SEED = 101


def scores(path: str, kinematics: str) -> list[Figures]:
    """Return the figures on both grounds."""
    return [part_of(combined([run_tracking(
        TrackingCase(path, ground, TRUE, OWN, kinematics), SEED)]), kinematics)
        for ground in (CONCRETE, SAND)]


def main() -> None:
    """Print the best look-ahead of each path."""
    for path in PATHS:
        short = scores(path, SHORT)
        found = {SHORT_LOOK_AHEAD: sum(one['control.rms'] ** 2 for one in short)}
        for look_ahead in product(TIMES, DISTANCES):
            with mock.patch.dict(scenarios.BEST_LOOK_AHEAD, {path: look_ahead}):
                tried = scores(path, BEST)
            if all(one['arrived'] and one['yaw.rms'] <= MAX_YAW_ACCELERATION
                    and one['duration'] <= MAX_DURATION_SHARE * other['duration']
                    for one, other in zip(tried, short)):
                found[look_ahead] = sum(one['control.rms'] ** 2 for one in tried)
        print(f'{path!r}: {min(found, key=found.__getitem__)}', flush=True)


if __name__ == '__main__':
    main()
