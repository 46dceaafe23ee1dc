"""Results on the same scenarios before forces were estimated."""

from __future__ import annotations

from collections.abc import Mapping

PREVIOUS_RESULTS: Mapping[tuple[str, str], dict[str, float]] = {}
