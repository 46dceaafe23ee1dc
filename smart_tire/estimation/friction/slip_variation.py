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

"""Variation of a wheel's slip within one crossing, from the change of its speed."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.uncertain import Uncertain

UNKNOWN_CHANGE_SIGMA = 0.01  # -, of the slip change over a contact length
SPEED_TO_SLIP_SHARE = 0.5  # of a relative change of wheel speed that may be a change of slip
SPEED_TO_RESIDUAL_SHARE = 0.05  # of a relative change of wheel speed, nonlinear change of slip
SPEED_CHANGE_NOISE = 0.01  # relative, apparent change of speed from timestamp jitter


@dataclass(frozen=True, slots=True)
class SlipVariation:
    """Linear change of slip over a contact length, and rms residual from it."""

    change: Uncertain
    residual: float


def slip_variation(crossing: PatchCrossing, contact_length: float) -> SlipVariation:
    """Return the variation that the change of wheel speed allows."""
    speed_change = max(crossing.speed_change - SPEED_CHANGE_NOISE, 0.0)
    return SlipVariation(
        Uncertain(0.0, math.hypot(UNKNOWN_CHANGE_SIGMA, SPEED_TO_SLIP_SHARE * speed_change
                                  * contact_length / crossing.distance)),
        SPEED_TO_RESIDUAL_SHARE * speed_change)
