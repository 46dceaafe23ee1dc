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

"""Brush tires with a common slip: the wheels of a robot that drives straight."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array

MAX_FORCE_SHARE = 0.995  # of friction times load; the slip is not observable above
MAX_ITERATIONS = 30     # of Newton's method, which converges from below
FORCE_TOLERANCE = 1e-9    # relative


def linear_tire_force(force: npt.ArrayLike, friction: float, loads: npt.ArrayLike) -> Array:
    """
    Return C_x times the common slip [N] at which the wheels have the total ``force`` [N].

    Inverse of the sum of ``brush_tire.brush_force``, B(22), over the wheels, for longitudinal slip
    and without knowledge of C_x: the force that each wheel would have without sliding. ``loads``
    [N] has the shape (wheels, ...), where ``force`` has (...); positive when driving. The force is
    limited to ``MAX_FORCE_SHARE`` of ``friction`` (mu) times load.

    >>> print(f'{float(linear_tire_force(20.0, 0.47, [18.0, 18.0, 35.0, 35.0])):.2f} N')
    6.00 N
    """
    force = np.asarray(force, dtype=float)
    limits = friction * np.maximum(np.asarray(loads, dtype=float), 0.0)
    target = np.minimum(np.abs(force), MAX_FORCE_SHARE * limits.sum(axis=0))
    # mu F_z (1 - xi^3) with xi = 1 - C_x s / (3 mu F_z): concave, so Newton never overshoots
    slip = target / len(limits)
    for _ in range(MAX_ITERATIONS):
        xi = _adhesion_ratios(slip, limits)
        square = xi * xi  # much faster than a power of three
        missing = target - (limits * (1.0 - square * xi)).sum(axis=0)
        slip = slip + missing / np.maximum(square.sum(axis=0), 1e-12)
        if np.all(missing <= FORCE_TOLERANCE * np.maximum(target, FORCE_TOLERANCE)):
            break
    return np.asarray(np.copysign(slip, force))


def _adhesion_ratios(slip: Array, limits: Array) -> Array:
    """Return the adhesion ratio xi of each wheel, shape (wheels, ...)."""
    with np.errstate(divide='ignore', invalid='ignore'):
        share = np.where(limits > 0.0, slip / (3.0 * limits), 1.0)
    return np.asarray(np.maximum(1.0 - share, 0.0))
