# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Delay of the base, and the motion at the time at which a command takes effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from smart_tire.control import constants as c
from smart_tire.control.ground_motion import Motion
from smart_tire.control.history import History
from smart_tire.samples import NS_PER_S

DELAYS = np.arange(0.0, c.MAX_DELAY + 0.5 * c.DELAY_STEP, c.DELAY_STEP)  # s


class BaseResponse:
    """
    The base follows commands after a delay: the one that is given, or one that ``odom`` shows.

    Of all delays, that counts with which the commands differ least from the reached speed and yaw
    rate, if the difference to that of the present one is above ``DELAY_MARGIN``. Only changes of
    the speed show it: they are forgotten as others follow, beyond ``DELAY_EVIDENCE``. Times are
    nanoseconds of the message clock.
    """

    def __init__(self, given: float, arm: float) -> None:
        """Begin with the ``given`` delay [s]; ``arm`` [m] is half of the track."""
        self._arm = arm
        self.given = given            # may be replaced at run time
        self._commands = History()    # v_x, yaw rate
        self._errors = np.zeros(len(DELAYS))  # (m/s)^2 s
        self._learned_ns: int | None = None
        self._learned: float | None = None  # s

    @property
    def delay(self) -> float:
        """Return the delay [s] from a command to the motion of the base."""
        return self.given if self._learned is None else self._learned

    def command(self, v_x: float, yaw_rate: float, now_ns: int) -> None:
        """Add the velocity [m/s, rad/s] that the body is to reach from now on."""
        self._commands.add(now_ns, v_x, yaw_rate)

    def learn(self, motion: Motion, stamp_ns: int) -> None:
        """Compare the motion at ``stamp_ns`` with the commands before it."""
        last_ns, self._learned_ns = self._learned_ns, stamp_ns
        if last_ns is None or not 0 < stamp_ns - last_ns <= c.MAX_GAP_NS or (
                not self._commands.times):
            return
        elapsed = (stamp_ns - last_ns) / NS_PER_S
        v_x, yaw_rate = np.array([
            self._given(stamp_ns - round(delay * NS_PER_S)) for delay in DELAYS]).T
        squares = (motion.v_x - v_x) ** 2 + (self._arm * (motion.yaw_rate - yaw_rate)) ** 2
        self._errors += elapsed * (squares - squares.min())
        self._errors *= min(1.0, c.DELAY_EVIDENCE / max(float(np.ptp(self._errors)), c.TINY))
        best = int(self._errors.argmin())
        # a robot that is blocked does not follow at any delay
        follows = squares[best] < 0.25 * (
            motion.v_x ** 2 + (self._arm * motion.yaw_rate) ** 2)
        if follows and np.interp(
                self.delay, DELAYS, self._errors) > self._errors[best] + c.DELAY_MARGIN:
            self._learned = float(DELAYS[best])

    def predicted(self, motion: Motion, stamp_ns: int, now_ns: int) -> Motion:
        """
        Return the motion at which a command of now takes effect.

        Over the part of the delay that is beyond the given one, which contains the lag, speed and
        yaw rate change by as much as the commands did that are under way.
        """
        beyond_ns = round(max(self.delay - self.given, 0.0) * NS_PER_S)
        end_ns, step_ns = now_ns + beyond_ns, round(c.DELAY_STEP * NS_PER_S)
        time_ns, found = stamp_ns, motion
        before = self._given(stamp_ns - beyond_ns)
        while beyond_ns and time_ns < end_ns:
            later_ns = min(time_ns + step_ns, end_ns)
            v_x, yaw_rate = self._given((time_ns + later_ns) // 2 - beyond_ns)
            found = replace(found, v_x=motion.v_x + v_x - before[0],
                            yaw_rate=motion.yaw_rate + yaw_rate - before[1]).after(
                                (later_ns - time_ns) / NS_PER_S)
            time_ns = later_ns
        return found.after((end_ns - time_ns) / NS_PER_S + min(self.delay, self.given))

    def _given(self, time_ns: int) -> tuple[float, float]:
        """Return the command at a time; zero before the first one."""
        v_x, yaw_rate = self._commands.held(time_ns) or (0.0, 0.0)
        return v_x, yaw_rate
