"""A number and how well it is known: what every identification returns."""

from __future__ import annotations

from dataclasses import dataclass

UNDETERMINED = 0.2  # of a value: a larger standard error tells nothing


@dataclass(frozen=True)
class Estimate:
    """A number and its standard error."""

    value: float
    sigma: float

    @property
    def determined(self) -> bool:
        """Return whether the recording tells the value."""
        return self.sigma <= UNDETERMINED * abs(self.value)
