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
Results of an internal reference estimator on the same scenarios.

It is a waveform fit with the slip of the reference filter: two films on one wheel, 400 Hz, 10
bits, 5 mV noise, bending variation of 15 % per cycle, gains known to 3 %, total slip from the
filter, exact film angle and wheel speed. The runs are of the same kind, but the random numbers
differ.
"""

from __future__ import annotations

from dataclasses import dataclass
import math


@dataclass(frozen=True)
class Reference:
    """Absolute relative errors of mu, median and 90 % quantile, with estimated slip."""

    single: float        # from one crossing
    single_90: float     # NaN if unknown
    fused: float
    fused_90: float
    revolutions: float   # until fused mu is within 10 %, worst case


REFERENCE_RESULTS = {
    'concrete': Reference(.017, .05, .018, .022, 1),
    'curve': Reference(.11, .25, .017, .11, 4),
    'sweep_60': Reference(.06, .20, .011, .027, 1),
    'mu_jumps': Reference(.09, .26, .04, .13, 4),
    'figure_eight': Reference(.05, math.nan, .013, .022, 3),
    'noisy': Reference(.09, math.nan, .034, .12, 12),
}

# Slip -> relative Cramer-Rao bound of one crossing: two films, 60 rpm, 5 mV, mu 0.47.
REFERENCE_BOUNDS = {0.05: 0.067, 0.10: 0.018, 0.15: 0.009}
PRINTED_EXCESS = (1.2, 1.9)  # relative, of mu from two peaks and the printed map


@dataclass(frozen=True)
class ForceReference:
    """
    Relative errors of mu and C_x, and error of v_y [m/s], by an output-error fit without torque.

    A rigid body on brush tires is fitted to the whole run, which is of the same kind; C_x, mu,
    drag, biases and center of mass are free.
    """

    mu: float = math.nan
    stiffness: float = math.nan
    speed_y: float = math.nan


FORCE_REFERENCES = {  # run and ground; '' for a run as a whole
    ('sand_turn', ''): ForceReference(.008, .04, .001),
    ('mu_jumps', ''): ForceReference(.02, math.nan, .0003),
    ('gravel_eight', ''): ForceReference(.055, .045, .001),
    ('sand_straight', ''): ForceReference(.04, .028),
    ('center_of_mass', ''): ForceReference(.05, .10),
}
