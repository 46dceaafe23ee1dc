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

"""
Straight segments simulated with fitted parameters, to measure the bias of the fit.

The most likely motion is smoother than the true one, so a fit to noisy samples is biased:
timestamp jitter makes a tire seem too stiff and the wheels too early. The same fit of segments
whose parameters are known shows by how much (indirect inference, Gourieroux et al. 1993).
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.tire.stiffness_model import Common, Noise, SegmentModel, SLIP_FLOOR
from smart_tire.calibration.tire.straight_segments import StraightSegment
from smart_tire.models.constants import GRAVITY

TIME_STEP = 0.002   # s, of the integration of the force balance
SMOOTHING = np.array([1.0, 2.0, 3.0, 2.0, 1.0])  # weights of neighboring steps
DRAG_SPEED = 0.02   # m/s, below which drag is linear in the speed


def simulated(model: SegmentModel, common: Array, local: Array, noise: Noise,
              rng: np.random.Generator) -> StraightSegment:
    """Return the segment of ``model`` with the fitted wheel speeds and new random errors."""
    segment, scale = model.segment, 1.0 + float(common[Common.ACCEL_SCALE])
    count = max(1, round(float(np.ptp(segment.time)) / TIME_STEP))
    time = np.linspace(segment.time[0], segment.time[-1], count + 1)
    wheels = np.interp(time, segment.time, _smooth(model.speeds(local)[1]))
    speed = _driven(model, common, wheels, time[1] - time[0])
    force = scale * np.diff(np.interp(segment.time, time, speed)) / np.diff(segment.time) + (
        model.slope(local) + common[Common.ACCEL_BIAS]
        + segment.noise * rng.standard_normal(len(segment.force)))
    late = noise.stamp * rng.standard_normal(len(segment.stamps))
    rolled = np.concatenate([[0.0], np.cumsum(0.5 * (wheels[1:] + wheels[:-1])
                                              * np.diff(time))])
    angle = np.interp(segment.stamps - common[Common.LATENCY_ERROR] - late, time, rolled)
    resolution = model.distance_resolution
    angle = angle + resolution / math.sqrt(2.0) * rng.standard_normal(len(angle))
    return StraightSegment(segment.time, force, segment.noise, segment.stamps, np.diff(angle),
                           segment.stationary)


def _smooth(speed: Array) -> Array:
    """Return fitted wheel speeds without their noise, which would add to the bias."""
    reach = len(SMOOTHING) // 2
    return np.asarray(np.convolve(np.pad(speed, reach, 'edge'), SMOOTHING / SMOOTHING.sum(),
                                  'valid'))


def _driven(model: SegmentModel, common: Array, wheels: Array,
            step: float) -> Array:
    """Return the speeds [m/s] of a body driven by ``wheels``, from rest or free rolling."""
    robot, drag = model.robot, GRAVITY * float(common[Common.DRAG])
    stiffness, friction = np.exp(common[[Common.STIFFNESS, Common.FRICTION]]).tolist()
    limit = friction * GRAVITY                       # m/s2
    slope = 4.0 * stiffness / (3.0 * limit * robot.mass)
    speed, v = [float(wheels[0])], float(wheels[0])
    for u in (0.5 * (wheels[1:] + wheels[:-1])).tolist():
        # the middle of the step, where the slip of small speeds is stable
        middle = v
        for _ in range(3):
            slip = (u - middle) / max(abs(u), SLIP_FLOOR)
            t = min(abs(slip) * slope, 1.0)
            force = math.copysign(limit * t * (3.0 - 3.0 * t + t * t), slip)
            change = force - drag * math.tanh(middle / DRAG_SPEED)
            middle = v + 0.5 * step * change
        v += step * change
        speed.append(v)
    return np.array(speed)
