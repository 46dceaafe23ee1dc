"""A number with its standard error: what every calibration returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

UNDETERMINED = 0.2  # of a value: a larger standard error tells nothing


@dataclass(frozen=True)
class Uncertain:
    """A number and its standard error."""

    value: float
    sigma: float

    @property
    def determined(self) -> bool:
        """Return whether the recording tells the value."""
        return self.sigma <= UNDETERMINED * abs(self.value)


def weighted_mean(estimates: Sequence[Uncertain]) -> Uncertain:
    """Return the mean weighted by the sigmas; where they scatter more, its sigma grows (Birge)."""
    weights = [item.sigma ** -2 for item in estimates]
    value = sum(w * item.value for w, item in zip(weights, estimates)) / sum(weights)
    squares = sum(w * (item.value - value) ** 2 for w, item in zip(weights, estimates))
    birge = math.sqrt(max(1.0, squares / max(len(estimates) - 1, 1)))
    return Uncertain(value, birge / math.sqrt(sum(weights)))
