# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motion of the robot in ``odom``: latest estimate, its faults, and the motion at a later time."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from operator import add, sub

from smart_tire.control import constants as c
from smart_tire.control.history import History
from smart_tire.parameters.path_following import PathCheckParams
from smart_tire.rotation import yaw_of
from smart_tire.samples import GRAVITY, MAX_ANGULAR_RATE, MAX_SPEED, NS_PER_S, Odometry


@dataclass(frozen=True)
class Motion:
    """Pose in ``odom`` and twist in ``base_link``."""

    x: float         # m
    y: float         # m
    yaw: float       # rad
    v_x: float       # m/s
    v_y: float       # m/s
    yaw_rate: float  # rad/s

    def after(self, dt: float, acceleration: float = 0.0) -> Motion:
        """
        Return the motion ``dt`` [s] later, with the same twist but for the ``acceleration``.

        The latter [m/s2] is that of ``v_x``; braking ends at standstill.
        """
        later = self.v_x + acceleration * dt
        if later * self.v_x < 0.0 and abs(self.v_x) > c.STANDSTILL_SPEED:
            later = 0.0
        v_x, middle = 0.5 * (self.v_x + later), self.yaw + 0.5 * self.yaw_rate * dt
        cos, sin = math.cos(middle), math.sin(middle)
        return Motion(self.x + (v_x * cos - self.v_y * sin) * dt,
                      self.y + (v_x * sin + self.v_y * cos) * dt,
                      self.yaw + self.yaw_rate * dt, later, self.v_y, self.yaw_rate)

    def since(self, last: Motion) -> tuple[float, float]:
        """Return the distance forward [m] and the turned angle [rad] from a pose before."""
        turned = wrap(self.yaw - last.yaw)
        heading = last.yaw + 0.5 * turned
        return ((self.x - last.x) * math.cos(heading)
                + (self.y - last.y) * math.sin(heading), turned)

    def speed(self) -> float:
        """Return the magnitude of the velocity [m/s]."""
        return math.hypot(self.v_x, self.v_y)

    def at_rest(self) -> bool:
        """Return whether the robot stands."""
        return self.speed() < c.STANDSTILL_SPEED and abs(self.yaw_rate) < c.STANDSTILL_RATE


def wrap(angle: float) -> float:
    """Return ``angle`` [rad] in [-pi, pi]."""
    return math.remainder(angle, math.tau)


def motion_of(odometry: Odometry) -> Motion | None:
    """Return the motion in a message; None if it is not plausible or not finite."""
    if not (all(map(math.isfinite, (*odometry.position, *odometry.orientation, *odometry.linear,
                                    *odometry.angular)))
            and max(map(abs, odometry.linear)) <= MAX_SPEED
            and max(map(abs, odometry.angular)) <= MAX_ANGULAR_RATE):
        return None
    return Motion(*odometry.position[:2], yaw_of(odometry.orientation), *odometry.linear[:2],
                  odometry.angular[2])


class LatestMotion:
    """Latest plausible odometry; all times are nanoseconds of the message clock."""

    def __init__(self) -> None:
        self.motion = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # at ``stamp_ns``
        self.stamp_ns: int | None = None                    # None without any odometry

    @property
    def initialized(self) -> bool:
        """Whether odometry was received."""
        return self.stamp_ns is not None

    def age(self, now_ns: int) -> float:
        """Return the age [s] of the latest odometry; infinite if there is none."""
        return math.inf if self.stamp_ns is None else (now_ns - self.stamp_ns) / NS_PER_S


class Travel(History):
    """Distances and angles driven, as sums over the samples of one input."""

    def elapsed(self, stamp_ns: int) -> float:
        """Return the time [s] since the latest sample; 0 if there is none in ``CLOCK_JUMP_NS``."""
        if self.times and not 0 <= stamp_ns - self.times[-1] <= c.CLOCK_JUMP_NS:
            self.clear()
        return (stamp_ns - self.times[-1]) / NS_PER_S if self.times else 0.0

    def extend(self, stamp_ns: int, *driven: float) -> None:
        """Add what was driven since the latest sample."""
        before = self.latest if self.times else (0.0,) * len(driven)
        self.add(stamp_ns, *map(add, before, driven))

    def between(self, begin_ns: int, end_ns: int) -> tuple[float, ...]:
        """Return what was driven in an interval within that of the samples."""
        return tuple(map(sub, self.at(end_ns), self.at(begin_ns)))


class TwistCheck:
    """
    Compares the twist in ``odom`` with the changes of its poses, over ``TWIST_WINDOW_NS``.

    Odometry of others may leave its twist at zero, or have it in other units or another frame. A
    jump of the pose is in one half of the window only.
    """

    def __init__(self) -> None:
        # of the poses: distance forward [m] and turned angle [rad]; the same of the twist
        self.travel = Travel()
        self._last: Motion | None = None
        self._begin_ns = 0  # of poses without a gap
        self.fault = ''  # what contradicts, empty if nothing does

    def corrected(self, motion: Motion, stamp_ns: int) -> Motion:
        """Return ``motion`` with a speed or yaw rate of the poses, where the twist contradicts."""
        half = 0.5 * self.travel.elapsed(stamp_ns)
        last = self._last if self._last and self.travel.times else motion
        self._last = motion
        if not self.travel.times or 2.0 * half > c.MAX_GAP_NS / NS_PER_S:
            self._begin_ns = stamp_ns
        self.travel.extend(stamp_ns, *motion.since(last), half * (last.v_x + motion.v_x),
                           half * (last.yaw_rate + motion.yaw_rate))
        speeds = self._contradicted(stamp_ns)
        found = replace(motion, **speeds) if speeds else motion
        self.fault = '' if found is motion else (
            f'odom: its twist of {motion.v_x:.2f} m/s and {motion.yaw_rate:.2f} rad/s contradicts '
            f'its poses, which move by {found.v_x:.2f} m/s and {found.yaw_rate:.2f} rad/s: the '
            'latter are used')
        return found

    def _contradicted(self, stamp_ns: int) -> dict[str, float]:
        """Return speed and yaw rate of the poses where both halves of the window contradict."""
        half = c.TWIST_WINDOW_NS // 2
        if stamp_ns - self._begin_ns < 2 * half:
            return {}
        late = self.travel.between(stamp_ns - half, stamp_ns)
        axes = [axis for axis in range(2) if _contradiction(late, axis)]
        if not axes:
            return {}
        early = self.travel.between(stamp_ns - 2 * half, stamp_ns - half)
        latest = self.travel.between(stamp_ns - half // 2, stamp_ns)
        return {('v_x', 'yaw_rate')[axis]: latest[axis] * NS_PER_S / (half // 2) for axis in axes
                if _contradiction(late, axis) * _contradiction(early, axis) > 0.0}


def _contradiction(travel: tuple[float, ...], axis: int) -> float:
    """Return by how far [m, rad] a motion by the poses exceeds that by the twist; 0: by noise."""
    posed, twisted = travel[axis::2]
    limit = max(c.MAX_TWIST_ERROR[axis], 0.5 * max(abs(posed), abs(twisted)))
    return posed - twisted if abs(posed - twisted) > limit else 0.0


class MotionMonitor(LatestMotion):
    """
    Latest odometry for following a path.

    ``fault`` is the text for the first fault since it was cleared; empty if there is none.
    ``twist`` checks the twist, and has what was driven by the poses.
    """

    def __init__(self) -> None:
        super().__init__()
        self.fault = ''
        self.twist = TwistCheck()

    def add_odometry(self, odometry: Odometry, params: PathCheckParams) -> float:
        """Check and add odometry; return the distance [m] from the last position."""
        motion, last, age = motion_of(odometry), self.motion, self.age(odometry.stamp_ns)
        if motion is None:
            self.fault = self.fault or (
                f'odom: pose or twist is not plausible, expected finite numbers up to '
                f'{MAX_SPEED:g} m/s and {MAX_ANGULAR_RATE:g} rad/s')
            return 0.0
        motion = self.twist.corrected(motion, odometry.stamp_ns)
        self.motion, self.stamp_ns = motion, odometry.stamp_ns
        if math.isinf(age):
            return 0.0
        fault = _jump(last, motion, age, params)
        self.fault = self.fault or fault
        return 0.0 if fault else math.hypot(motion.x - last.x, motion.y - last.y)


def _jump(last: Motion, motion: Motion, dt: float, params: PathCheckParams) -> str:
    """Return the jump from the ``last`` motion, ``dt`` [s] before; empty if there is none."""
    if dt < 0.0:
        return f'odom: time runs back by {-dt:.3f} s, expected increasing stamps'
    moved = math.hypot(motion.x - last.x, motion.y - last.y)
    speed = max(last.speed(), motion.speed())
    if moved > params.odom_jump + speed * dt:
        return (f'odom: position jumped by {moved:.2f} m at {speed:.2f} m/s, expected '
                f'at most {params.odom_jump:g} m more than the speed explains')
    turned = abs(wrap(motion.yaw - last.yaw))
    if turned > c.YAW_JUMP + max(abs(last.yaw_rate), abs(motion.yaw_rate)) * dt:
        return (f'odom: yaw jumped by {turned:.2f} rad, expected at most '
                f'{c.YAW_JUMP:g} rad more than the yaw rate explains')
    return ''


@dataclass(frozen=True)
class Onset:
    """Begin of an acceleration that estimates do not show yet."""

    time_ns: int = 0
    acceleration: float = 0.0  # m/s2, expected
    settling: float = 0.1      # s, time constant until the measured acceleration counts


class GroundSpeed(LatestMotion):
    """Latest odometry with its filtered acceleration, for traction control."""

    def __init__(self) -> None:
        super().__init__()
        self._acceleration = 0.0  # m/s2

    def add_odometry(self, odometry: Odometry, time_constant: float) -> float | None:
        """
        Add an estimate; return the distance [m] since the one before.

        None if it is not plausible or older. ``time_constant`` [s] is that of the low-pass filter
        of the acceleration.
        """
        motion, elapsed = motion_of(odometry), self.age(odometry.stamp_ns)
        if motion is None or -c.CLOCK_JUMP_NS / NS_PER_S <= elapsed <= 0.0:
            return None
        if 0.0 < elapsed <= c.MAX_GAP_NS / NS_PER_S:
            self._acceleration += (motion.v_x - self.motion.v_x - elapsed * self._acceleration) / (
                elapsed + time_constant)
        else:
            self._acceleration = 0.0
        self.motion, self.stamp_ns = motion, odometry.stamp_ns
        return abs(motion.v_x) * elapsed if 0.0 < elapsed < math.inf else 0.0

    def expected(self, now_ns: int, lead: float, onset: Onset
                 ) -> tuple[Motion, float]:
        """
        Return motion and forward acceleration [m/s2] ``lead`` [s] after ``now_ns``.

        The acceleration is the measured one, at most g, and that expected from the ``onset`` of a
        change until an estimate can show it.
        """
        measured = min(max(self._acceleration, -GRAVITY), GRAVITY)
        horizon = max(self.age(now_ns) + lead, 0.0)
        since = -self.age(onset.time_ns)
        weight = math.exp(-max(since, 0.0) / onset.settling)
        unseen = min(max(horizon + min(since, 0.0), 0.0), horizon)
        acceleration = weight * onset.acceleration + (1.0 - weight) * measured
        mean = measured + unseen / horizon * (acceleration - measured) if horizon else measured
        return self.motion.after(horizon, mean), acceleration
