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

"""Which crossings count: from the fifth revolution of the wheel on each ground."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.friction.records import FUSED, Mask, Rows
from benchmarks.friction.scoring import MAX_SAME_FRICTION
from benchmarks.slip.scoring import FAST_ACCELERATION, MIN_ROLLING_SPEED, wheel_accelerations
from benchmarks.slip.series import Truth
import numpy as np
from smart_tire.analysis.series import Floats
from smart_tire.samples import NS_PER_S

GROUND = FUSED, 'stiffness'  # true quantities of a ground
COUNTED_FROM = 5         # revolution of the film's wheel after the start or a change of ground
MIN_MOTION = 5.0         # s on the same ground, for estimates without torque
MIN_TURN_RATE = 0.2      # rad/s, of a turn


def revolutions_on_ground(rows: Rows, quantities: Sequence[str] = GROUND) -> Floats:
    """
    Return which revolution (n,) on the present ground each crossing is, from 1.

    The ground changes with any of its true ``quantities``.
    """
    changed = np.zeros(len(rows.stamp_ns), bool)
    for name in quantities:
        true = rows.true[name]
        changed[1:] |= np.abs(np.diff(true)) > MAX_SAME_FRICTION * true[:-1]
    index = np.arange(len(changed))
    begin = np.maximum.accumulate(np.where(changed, index, 0))
    return np.asarray(index - begin + 1, np.float64)


def counted(rows: Rows, first: int = COUNTED_FROM) -> Mask:
    """Return which crossings (n,) count; those on two grounds do not."""
    mask: Mask = revolutions_on_ground(rows) >= first
    return mask


def excited(rows: Rows, truth: Truth) -> Mask:
    """
    Return which crossings (n,) can be expected to be estimated without torque.

    These are crossings after ``MIN_MOTION`` of motion with the same C_x and with a turn, start or
    stop in it.
    """
    moving = np.abs(truth.rolling).max(axis=1) > MIN_ROLLING_SPEED
    busy = (np.abs(truth.poses.twist[:, 2]) > MIN_TURN_RATE) | (
        np.abs(wheel_accelerations(truth)).max(axis=1) > FAST_ACCELERATION)
    step = np.diff(truth.stamp_ns, prepend=truth.stamp_ns[0]) / NS_PER_S
    motion, events = np.cumsum(moving * step), np.cumsum(moving & busy)
    now = np.clip(np.searchsorted(truth.stamp_ns, rows.stamp_ns), 0, len(step) - 1)
    revolution = revolutions_on_ground(rows, ('stiffness',)).astype(np.intp)
    first = np.arange(len(now)) - revolution + 1  # crossing on the present ground
    begin = np.where(first > 0, now[first], 0)    # the first ground begins with the run
    mask: Mask = (motion[now] - motion[begin] >= MIN_MOTION) & (events[now] > events[begin])
    return mask
