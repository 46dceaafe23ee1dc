"""Aliases of array types; shapes and units are stated at their use."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
ArrayLike = npt.ArrayLike
Instants = npt.NDArray[np.int64]  # ns
