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

"""Checks of tire parameters: stiffness for the load of a wheel."""

from __future__ import annotations

from collections.abc import Iterator

from smart_tire.analysis.checks.recording import CheckedRecording
from smart_tire.findings import Finding, Level
from smart_tire.samples import GRAVITY

# C_x / F_z. Below, 3 mu F_z / C_x exceeds 1 for mu = 0.5: the patch never slides fully, so that
# friction is not observable. Above are the 10 to 30 of passenger car tires, twice.
MIN_STIFFNESS_RATIO, MAX_STIFFNESS_RATIO = 1.5, 60.0
ASSUMED_FRICTION = 0.5


def check_stiffness(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a longitudinal stiffness that is implausible for the load."""
    robot = recording.robot
    load = 0.25 * robot.mass * GRAVITY
    stiffness = robot.tire.longitudinal_stiffness
    ratio, critical = stiffness / load, 3.0 * ASSUMED_FRICTION * load / stiffness
    if critical > 1.0:
        yield Finding(Level.WARNING, 'tire.longitudinal_stiffness', f'{stiffness:g} N for a load '
                      f'of {load:.3g} N: critical slip {critical:.2g} at mu = '
                      f'{ASSUMED_FRICTION:g}', 'critical slip below 1, C_x / F_z of '
                      f'{MIN_STIFFNESS_RATIO:g} to {MAX_STIFFNESS_RATIO:g}',
                      'smart_tire identify stiffness; check mass')
    elif ratio > MAX_STIFFNESS_RATIO:
        yield Finding(Level.WARNING, 'tire.longitudinal_stiffness', f'{stiffness:g} N is '
                      f'{ratio:.3g} times the load of {load:.3g} N',
                      f'{MIN_STIFFNESS_RATIO:g} to {MAX_STIFFNESS_RATIO:g} times',
                      'smart_tire identify stiffness; check mass')
