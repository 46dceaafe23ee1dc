# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Conversion of vectors and attitudes between device axes and REP-103 axes (x forward, z up)."""

from __future__ import annotations

import math

from smart_tire.errors import FrameError
from smart_tire.samples import ImuSample, MAX_ANGULAR_RATE, MAX_SPECIFIC_FORCE, Vector3

Quaternion = tuple[float, float, float, float]  # x, y, z, w; body axes to world axes

MAX_QUATERNION_COMPONENT = 1.1  # -, 1 with a margin for rounding and missing normalization

_SQRT_HALF = math.sqrt(0.5)


def flip_vector(vector: Vector3) -> Vector3:
    """Convert a vector from forward-right-down to forward-left-up axes, or vice versa."""
    return vector[0], -vector[1], -vector[2]


def flip_quaternion(quaternion: Quaternion) -> Quaternion:
    """
    Convert an attitude from forward-right-down in NED to forward-left-up in ENU, or vice versa.

    q' = q(NED to ENU) q q(left-up to right-down); this conversion is its own inverse.
    """
    x, y, z, w = quaternion
    return (_SQRT_HALF * (x + y), _SQRT_HALF * (x - y),
            _SQRT_HALF * (w - z), _SQRT_HALF * (w + z))


def checked_sample(stamp_ns: int, acceleration: Vector3, rate: Vector3,
                   orientation: Quaternion | None) -> ImuSample:
    """Return the sample; raise FrameError if a value is not finite or out of range."""
    for name, values, limit in (('acceleration', acceleration, MAX_SPECIFIC_FORCE),
                                ('angular rate', rate, MAX_ANGULAR_RATE),
                                ('orientation', orientation or (), MAX_QUATERNION_COMPONENT)):
        if not all(map(math.isfinite, values)):
            raise FrameError(f'{name} is {values}, expected finite numbers')
        if max(map(abs, values), default=0.0) > limit:
            raise FrameError(f'{name} is {values}, expected magnitudes up to {limit:g}')
    return ImuSample(stamp_ns, acceleration, rate, orientation)


def sample_from_flipped(stamp_ns: int, acceleration: Vector3, rate: Vector3,
                        attitude: Quaternion | None) -> ImuSample:
    """Return ``checked_sample`` of values in forward-right-down axes, with the attitude in NED."""
    return checked_sample(stamp_ns, flip_vector(acceleration), flip_vector(rate),
                          None if attitude is None else flip_quaternion(attitude))
