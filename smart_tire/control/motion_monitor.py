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

"""Check of odometry, and prediction of the pose from it."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.control.path_geometry import wrap
from smart_tire.parameters.path_following import PathCheckParams
from smart_tire.rotation import euler
from smart_tire.samples import NS_PER_S, Odometry

JUMP_SPEED_SHARE = 1.0  # of the distance that the larger of two speeds explains
YAW_JUMP = 0.5          # rad, more than the yaw rates explain


@dataclass(frozen=True)
class Motion:
    """Pose in ``odom`` and twist in ``base_link``."""

    x: float         # m
    y: float         # m
    yaw: float       # rad
    v_x: float       # m/s
    v_y: float       # m/s
    yaw_rate: float  # rad/s

    def after(self, dt: float) -> Motion:
        """Return the motion ``dt`` [s] later, with the same twist."""
        middle = self.yaw + 0.5 * self.yaw_rate * dt
        cos, sin = math.cos(middle), math.sin(middle)
        return Motion(self.x + (self.v_x * cos - self.v_y * sin) * dt,
                      self.y + (self.v_x * sin + self.v_y * cos) * dt,
                      self.yaw + self.yaw_rate * dt, self.v_x, self.v_y, self.yaw_rate)

    def speed(self) -> float:
        """Return the magnitude of the velocity [m/s]."""
        return math.hypot(self.v_x, self.v_y)


class MotionMonitor:
    """
    Latest valid odometry.

    ``fault`` is the text for the first fault since it was cleared; empty if there is none.
    """

    def __init__(self) -> None:
        self.fault = ''
        self._stamp_ns: int | None = None
        self._motion = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def initialized(self) -> bool:
        """Whether odometry was received."""
        return self._stamp_ns is not None

    def update(self, odometry: Odometry, params: PathCheckParams) -> float:
        """Check and add odometry; return the distance [m] from the last position."""
        motion = Motion(*odometry.position[:2], euler(odometry.orientation)[2]
                        if _is_finite(odometry) else math.nan,
                        *odometry.linear[:2], odometry.angular[2])
        if math.isnan(motion.yaw):
            self._set_fault('odom: pose or twist is not finite, expected finite numbers')
            return 0.0
        last, last_ns = self._motion, self._stamp_ns
        self._motion, self._stamp_ns = motion, odometry.stamp_ns
        if last_ns is None:
            return 0.0
        dt = (odometry.stamp_ns - last_ns) / NS_PER_S
        if dt < 0.0:
            self._set_fault(f'odom: time runs back by {-dt:.3f} s, expected increasing stamps')
            return 0.0
        return self._check_jump(last, motion, dt, params)

    def _check_jump(self, last: Motion, motion: Motion, dt: float,
                    params: PathCheckParams) -> float:
        moved = math.hypot(motion.x - last.x, motion.y - last.y)
        speed = max(last.speed(), motion.speed())
        if moved > params.odom_jump + JUMP_SPEED_SHARE * speed * dt:
            self._set_fault(f'odom: position jumped by {moved:.2f} m at {speed:.2f} m/s, expected '
                            f'at most {params.odom_jump:g} m more than the speed explains')
            return 0.0
        turned = abs(wrap(motion.yaw - last.yaw))
        if turned > YAW_JUMP + max(abs(last.yaw_rate), abs(motion.yaw_rate)) * dt:
            self._set_fault(f'odom: yaw jumped by {turned:.2f} rad, expected at most '
                            f'{YAW_JUMP:g} rad more than the yaw rate explains')
            return 0.0
        return moved

    def _set_fault(self, text: str) -> None:
        self.fault = self.fault or text

    def age(self, now_ns: int) -> float:
        """Return the age [s] of the latest odometry; infinite if there is none."""
        return math.inf if self._stamp_ns is None else (now_ns - self._stamp_ns) / NS_PER_S

    def predict(self, now_ns: int, delay: float) -> Motion:
        """Return the motion ``delay`` [s] after ``now_ns``."""
        return self._motion.after(self.age(now_ns) + delay)

    def measured(self) -> Motion:
        """Return the latest motion, at its timestamp."""
        return self._motion


def _is_finite(odometry: Odometry) -> bool:
    return all(map(math.isfinite, (*odometry.position, *odometry.orientation, *odometry.linear,
                                   *odometry.angular)))
