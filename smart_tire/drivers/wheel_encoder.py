"""One wheel's encoder: unwrapped angle, speed, and whether it follows the duty of its motor."""

from __future__ import annotations

import math

from smart_tire.protocol.roboclaw import count_step

MAX_SPEED = 100.0        # rad/s; a count that went further means that the board lost its counts
MIN_DRIVING_DUTY = 0.05  # -; below, friction in the gear may hold a wheel
MIN_ROLLING_SPEED = 0.5  # rad/s; above, a wheel rolls
MIN_COUNTS = 5           # that a rolling wheel makes within the time that a stop is watched
DECELERATION = 0.85      # share of its speed that is left to a wheel that brakes
# Motor torque against the rotation over stall torque, duty + speed / free speed. The ground can
# keep a wheel turning against it up to friction * load * radius: 0.47 * 26.7 N * 0.087 m are
# 0.27 of a stall torque of 4 N m, and on the best of grounds twice that.
MAX_OPPOSING_TORQUE = 0.5


class WheelEncoder:
    """Follows the counts of one encoder; ``sign`` is -1 if it counts backwards."""

    def __init__(self, sign: int, counts_per_revolution: float) -> None:
        self.sign = sign
        self._radians_per_count = math.tau / counts_per_revolution
        self._count: int | None = None
        self.position = 0.0  # rad, unwrapped
        self.step = 0.0      # rad, of the latest reading
        self.jumped = False  # whether the latest reading was farther off than a wheel can turn

    def update(self, count: int, elapsed: float) -> None:
        """Take the count that was read ``elapsed`` seconds after the latest one."""
        self.step, self.jumped = 0.0, False
        if self._count is not None and elapsed > 0.0:
            step = self.sign * count_step(count, self._count) * self._radians_per_count
            self.jumped = abs(step) > MAX_SPEED * elapsed
            if not self.jumped:
                self.position += step
                self.step = step
        self._count = count

    @property
    def resolution(self) -> float:
        """Return the angle of one count [rad]."""
        return self._radians_per_count


class MotionCheck:
    """
    Compares what an encoder reports with the duty of its motor.

    A wheel that rolled and stands still although its duty goes on, or that does not start at
    ``stall_duty``, is blocked or its encoder is broken. One that turns against so much torque
    that it would have to slow down has its encoder or its motor reversed. Both are a fault after
    ``stall_time`` [s], which is short enough for zero duty within 0.5 s. ``free_speed`` [rad/s]
    is that of the unloaded motor at full duty, ``resolution`` the angle of a count [rad].
    """

    def __init__(self, resolution: float, free_speed: float, stall_duty: float,
                 stall_time: float) -> None:
        self._free_speed = free_speed
        self._stall_duty, self._stall_time = stall_duty, stall_time
        self._rolling_speed = max(MIN_ROLLING_SPEED, MIN_COUNTS * resolution / stall_time)
        self.reset()

    def reset(self) -> None:
        """Forget what was observed, after a pause in the readings."""
        self._rolling = 0         # direction in which it rolled when it last moved
        self._still = 0.0         # s under duty without a count
        self._opposed = 0.0       # s of turning against the torque without slowing down
        self._opposed_from = 0.0  # rad/s, the speed when that began

    def update(self, duty: float, step: float, elapsed: float) -> str:
        """
        Take a reading: angle ``step`` [rad] in ``elapsed`` [s] under ``duty`` [-1, 1].

        Returns what is wrong, '' if nothing is.
        """
        return self._check_still(duty, step, elapsed) or self._check_opposed(duty, step, elapsed)

    def _check_still(self, duty: float, step: float, elapsed: float) -> str:
        if step != 0.0:
            rolls = abs(step) >= self._rolling_speed * elapsed
            self._rolling = int(math.copysign(rolls, step))
            self._still = 0.0
        elif abs(duty) < (MIN_DRIVING_DUTY if duty * self._rolling > 0.0 else self._stall_duty):
            self._rolling, self._still = 0, 0.0
        else:
            self._still += elapsed
        if self._still < self._stall_time:
            return ''
        return f'no encoder counts under duty {duty:.2f}: wheel blocked or encoder broken'

    def _check_opposed(self, duty: float, step: float, elapsed: float) -> str:
        speed = abs(step) / elapsed
        if (duty * step >= 0.0 or speed < MIN_ROLLING_SPEED
                or abs(duty) + speed / self._free_speed < MAX_OPPOSING_TORQUE):
            self._opposed = self._opposed_from = 0.0
        elif speed < DECELERATION * self._opposed_from or self._opposed_from == 0.0:
            self._opposed, self._opposed_from = 0.0, speed
        else:
            self._opposed += elapsed
        if self._opposed < self._stall_time:
            return ''
        return f'turns against duty {duty:.2f}: encoder or motor reversed'
