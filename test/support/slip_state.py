"""States of the slip EKF for tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def random_state(seed: int) -> NDArray[np.float64]:
    """Return a state (N,) of plausible magnitude."""
    rng = np.random.default_rng(seed)
    return rng.normal(0.0, [1, 1, 1, .01, .01, .8, .1, .01, .05, .05, .1, .1, .05, .001, .001])
