# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Result of an identification: quantities with standard errors, and what is not observable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
import math
from typing import TypeVar

from smart_tire.errors import EstimatorError
from smart_tire.uncertain import Uncertain

SIGNIFICANT_SIGMAS = 3.0   # standard errors, of a difference or outlier that is not chance
CONTRADICTION_SIGMAS = 4.0  # standard errors, of a difference for which data are refused
MIN_ROBUST = 5  # below this number values determine neither their spread nor outliers
MIN_ROWS = 30   # below this number residuals do not determine their noise

Fit = TypeVar('Fit')


def differ(first: Uncertain, second: Uncertain) -> bool:
    """Return whether two values differ significantly."""
    return abs(first.value - second.value) > CONTRADICTION_SIGMAS * math.hypot(
        first.sigma, second.sigma)


@dataclass(frozen=True)
class ReportedQuantity:
    """An identified quantity: one line of the report."""

    name: str
    estimate: Uncertain
    unit: str
    note: str = ''
    parameter: str = ''  # name of the parameter, '' if there is none
    spread: float = 0.0  # half the difference of the values from both halves of a recording

    @property
    def written(self) -> Uncertain:
        """Return the value for a parameter file, whose sigma is at least the spread."""
        return Uncertain(self.estimate.value, max(self.estimate.sigma, self.spread))


@dataclass
class Found:
    """Identified quantities, reasons of those not observable, and notes."""

    quantities: list[ReportedQuantity] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)  # name -> why it is not observable
    kept: dict[str, str] = field(default_factory=dict)     # parameter -> why it is not written
    notes: list[str] = field(default_factory=list)

    def get(self, name: str) -> Uncertain | None:
        """Return the estimate of the quantity ``name``, None if it is not observable."""
        return next((item.estimate for item in self.quantities if item.name == name), None)

    def add(self, name: str, estimate: Uncertain, unit: str, note: str = '',
            parameter: str = '') -> None:
        """Append a quantity."""
        self.quantities.append(ReportedQuantity(name, estimate, unit, note, parameter))

    def attempt(self, name: str, fit: Callable[[], Fit]) -> Fit | None:
        """Return what ``fit`` returns; if it fails, store the reason under ``name``."""
        try:
            return fit()
        except EstimatorError as error:
            self.refused[name] = str(error)
            return None
