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

"""Interface of the methods that estimate slip and normalized slip from one patch crossing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TYPE_CHECKING

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.brush_inversion import SlipFit
from smart_tire.uncertain import Uncertain, UNKNOWN

if TYPE_CHECKING:
    from smart_tire.estimation.friction.waveform_fit import WaveformFit


@dataclass(frozen=True, slots=True)
class MethodResult:
    """What the films show of one crossing, before load and stiffness are used."""

    films_only: SlipFit
    shift: float   # m, by which the crossing was later than detected
    sliding: bool  # the whole patch slides: only slip over normalized slip is determined
    stretch_voltage: Uncertain = UNKNOWN  # V, of film 1
    peak_interval: Uncertain = UNKNOWN    # s, of film 1
    waveform: WaveformFit | None = None   # None if the method fits none


class CrossingMethod(Protocol):
    """Estimates slip and normalized slip of one wheel's crossings."""

    needs_slip: bool  # of the motion of the robot

    def measure(self, crossing: PatchCrossing, slip: Uncertain = UNKNOWN) -> MethodResult | None:
        """Return the result of ``crossing``, None if its samples do not fit the method."""
