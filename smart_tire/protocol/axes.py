"""Device axes to those of REP-103 (x forward, y left, z up) and back, for vectors and attitude."""

from __future__ import annotations

import math

from smart_tire.errors import FrameError
from smart_tire.samples import ImuSample, MAX_FORCE, MAX_RATE, Vector3

Quaternion = tuple[float, float, float, float]  # x, y, z, w; body axes to world axes

MAX_COMPONENT = 1.1  # of a quaternion: 1, and a device's rounding and lack of normalisation

_HALF = math.sqrt(0.5)


def flip_vector(vector: Vector3) -> Vector3:
    """Return a vector of forward-right-down axes in forward-left-up axes, or back."""
    return vector[0], -vector[1], -vector[2]


def flip_quaternion(quaternion: Quaternion) -> Quaternion:
    """
    Return the attitude of a forward-left-up body in east-north-up from right-down in NED, or back.

    The change of both axes is its own inverse: q' = q(NED to ENU) q q(left-up to right-down).
    """
    x, y, z, w = quaternion
    return _HALF * (x + y), _HALF * (x - y), _HALF * (w - z), _HALF * (w + z)


def checked_sample(stamp_ns: int, acceleration: Vector3, rate: Vector3,
                   orientation: Quaternion | None) -> ImuSample:
    """Return the sample; raise FrameError naming what is not finite or beyond any sensor."""
    for name, values, limit in (('acceleration', acceleration, MAX_FORCE),
                                ('angular rate', rate, MAX_RATE),
                                ('orientation', orientation or (), MAX_COMPONENT)):
        if not all(map(math.isfinite, values)):
            raise FrameError(f'{name} is {values}, expected finite numbers')
        if max(map(abs, values), default=0.0) > limit:
            raise FrameError(f'{name} is {values}, expected at most {limit:g} either way')
    return ImuSample(stamp_ns, acceleration, rate, orientation)


def sample_from_flipped(stamp_ns: int, acceleration: Vector3, rate: Vector3,
                        attitude: Quaternion | None) -> ImuSample:
    """Return the sample for values in forward-right-down axes and NED, as ``checked_sample``."""
    return checked_sample(stamp_ns, flip_vector(acceleration), flip_vector(rate),
                          None if attitude is None else flip_quaternion(attitude))
