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

"""The equations of ``body_model`` with numpy, for many runs at once: where it is not compiled."""

from __future__ import annotations

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.ground import body_model as model
from smart_tire.models.vehicle.skid_steer import AXLE_SIGNS, SIDE_SIGNS


def simulate(rolling: Array, offsets: Array, heading: Array, runs: Array, robot: Array,
             out: Array) -> None:
    """Simulate all runs as ``body_model.simulate``."""
    step, mass, inertia, half_base, half_track, height, slip_floor, drag_floor, gravity = robot
    p = runs.T[:, :, np.newaxis]  # (PARAMETERS, runs, 1): broadcasts with the wheels
    x, y = half_base * AXLE_SIGNS - p[model.COM_X], half_track * SIDE_SIGNS - p[model.COM_Y]
    sides, share, ratio = SIDE_SIGNS, p[model.LATERAL_SHARE], p[model.LATERAL_RATIO]
    side_scales = [p[row] ** sides for row in (
        model.SIDE_STIFFNESS, model.SIDE_FRICTION, model.SIDE_RESISTANCE)]
    grounds = [[p[first + k] * scale for k, scale in enumerate(side_scales)]
               for first in (model.OLD_STIFFNESS, model.STIFFNESS)]
    level = 0.25 * mass * gravity * (1.0 + p[model.COM_X] / half_base * AXLE_SIGNS
                                     + p[model.COM_Y] / half_track * sides)
    by_x, by_y = (0.25 * mass * height / half_base * AXLE_SIGNS,
                  0.25 * mass * height / half_track * sides)
    now = p[model.START_U:model.START_W + 1].copy()  # (3, runs, 1): u, v, w
    last, acceleration = now, np.zeros((2, len(runs), 1))
    for n in range(len(rolling)):
        rate = (1.5 if n else 1.0) / step
        old = (2.0 * now - 0.5 * last if n else now) / step
        u, v, w = 2.0 * now - last
        cos, sin = heading[n]
        rise = gravity * (p[model.SLOPE_X:model.SLOPE_Y + 1]
                          + ((n + 0.5) / len(rolling) - 0.5) * p[model.BEND_X:model.BEND_Y + 1])
        slope = np.stack([cos * rise[0] + sin * rise[1], cos * rise[1] - sin * rise[0]])
        before = n < p[model.CHANGE_STEP]
        stiffness, friction, resistance = (
            np.where(before, *both) for both in zip(*grounds))
        load = np.maximum(level - by_x * acceleration[0] - by_y * acceleration[1], 0.0)
        drag = resistance * load
        roll = p[model.RADIUS] * rolling[n] + offsets[:, n][:, [0, 1, 0, 1]]
        v_x, v_y = u - y * w, v + x * w
        scale = 1.0 / np.maximum(np.abs(roll), slip_floor)
        total = np.hypot((roll - v_x) * scale, ratio * v_y * scale)
        limit = friction * load
        sliding = stiffness * total >= 3.0 * limit
        t = stiffness * total / np.where(sliding, 1.0, 3.0 * limit)
        fallen = 1.0 - p[model.FALL] * (1.0 - 3.0 * limit / np.where(
            sliding, stiffness * total, 3.0 * limit + 1e-9))
        grip = scale * np.where(sliding, limit * fallen / np.maximum(total, 1e-9),
                                stiffness * (1.0 - t + t * t / 3.0))
        drag_y = share * drag / np.maximum(np.hypot(v_x, v_y), drag_floor)
        along = grip + drag_y + (1.0 - share) * drag / np.maximum(np.abs(v_x), drag_floor)
        across = ratio * grip + drag_y
        uu, vv, uw, vw, ww, bu, bw = (
            total.sum(axis=1, keepdims=True) for total in (
                along, across, -along * y, across * x, across * x * x + along * y * y,
                grip * roll, -y * grip * roll))
        uu, vv, ww = uu + mass * rate, vv + mass * rate, ww + inertia * rate
        bu += mass * (old[0] + w * v - slope[0])
        bv = mass * (old[1] - w * u - slope[1])
        bw += inertia * old[2]
        w = (bw - uw * bu / uu - vw * bv / vv) / (ww - uw * uw / uu - vw * vw / vv)
        u, v = (bu - uw * w) / uu, (bv - vw * w) / vv
        last, now = now, np.stack([u, v, w])
        rates = rate * now - old
        acceleration = np.stack([rates[0] - w * v + slope[0], rates[1] + w * u + slope[1]])
        out[:, n, :model.FORCE] = np.concatenate(
            [*now, *acceleration, rates[2]], axis=1)
        out[:, n, model.FORCE:] = grip * (roll - u + y * w)
