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

"""
Results of an internal reference filter on the same scenarios.

Runs and sensor errors are of the same kind, but the random numbers differ. The filter smooths
wheel speeds with a lag of 0.13 s. Slips are rms errors of both sides in steady intervals; on the
straight run at all times against truth averaged over 125 ms. Its force balance assumes C_x 52.7 N
and mu 0.47, which is right on concrete and wrong on sand and in the mu jumps.
"""

from __future__ import annotations

from dataclasses import dataclass
import math


@dataclass(frozen=True)
class Reference:
    """Errors of one filter on one run."""

    left: float   # -, rms error of the slip
    right: float
    speed: float = math.nan    # m/s, rms error of the forward speed
    end: float = math.nan      # m, position error at the end
    heading_end: float = math.nan  # degrees


@dataclass(frozen=True)
class ReferenceRun:
    """Results on one run by variant of the filter."""

    no_slip: Reference   # slip 0 assumed
    plain: Reference     # IMU + wheels + constraints
    balance: Reference   # with force balance


TITLES = {'plain': 'reference filter', 'balance': 'reference, force balance'}

_SWEEP = ReferenceRun(
    Reference(.114, .096), Reference(.024, .023, .012), Reference(.010, .008, .0024))

REFERENCE_RESULTS = {
    'concrete': ReferenceRun(
        Reference(.111, .108), Reference(.007, .013, .006), Reference(.005, .009, .0033)),
    'sand': ReferenceRun(
        Reference(.285, .081), Reference(.010, .019, .010), Reference(.005, .008, .004)),
    'sweep_60': _SWEEP,
    'mu_jumps': ReferenceRun(
        Reference(.063, .072), Reference(.029, .021, .010), Reference(.016, .012, .0044)),
    'figure_eight': ReferenceRun(
        Reference(.076, .074), Reference(.016, .016, .010, 0.18, 1.5),
        Reference(.006, .006, .0036, 0.10, 0.7)),
    'degraded': ReferenceRun(
        Reference(.073, .074), Reference(.018, .017, .010), Reference(.006, .006, .0056)),
    'straight': ReferenceRun(
        Reference(.109, .110), Reference(.041, .042, .012), Reference(.035, .037, .0095)),
    'spin_reverse': ReferenceRun(
        Reference(.202, .182), Reference(.019, .019, .010), Reference(.013, .013, .007)),
}
