# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Response of the base to commands, and the motion at which a command takes effect."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.control import constants as c
from smart_tire.control.ground_motion import Motion
from smart_tire.samples import NS_PER_S

LAGS = c.DELAY_STEP * 2.0 ** np.arange(5)  # s
DECAYS = -1.0 / NS_PER_S / LAGS  # 1/ns
USUAL_LAGS = [int(np.abs(LAGS - lag).argmin()) for lag in c.USUAL_LAGS]  # indices
NEVER_NS = -1 << 62  # time at which the base was at rest


class BaseResponse:
    """
    The base follows commands after a dead time, speed and yaw rate each with a lag of first order.

    Of all dead times and lags, those count with which the commands explain the speed and the yaw
    rate of the last ``HISTORY_NS`` best, each times one factor: slip that is not known yet is no
    delay. The present ones remain unless they leave ``DELAY_RATIO`` times as much unexplained.
    What the commands over their ``factors`` leave is a disturbance. Times are nanoseconds of the
    message clock.
    """

    def __init__(self, given: float, arm: float) -> None:
        """Begin with the ``given`` delay [s]; ``arm`` [m] is half of the track."""
        self._scale = np.array([[1.0], [arm]])
        self.given = given          # may be replaced at run time
        self._rest()
        # over time: squares of the commands and products with the motion, by dead time, axis and
        # lag; squares of the motion
        self._sums, self._squares = np.zeros((2, len(c.DELAYS), 2, len(LAGS))), 0.0
        self.factors = np.ones(2)   # commanded over reached speed and yaw rate
        self._learned_ns: int | None = None
        self._learned: tuple[int, int, int] | None = None
        self._disturbance = np.zeros(2)  # m/s, rad/s

    def _rest(self) -> None:
        """Begin at rest: without commands."""
        self._times_ns = np.array([NEVER_NS])
        # v_x and yaw rate, and how far they were away from it with each of the lags
        self._commands = np.zeros((1, 2, 1 + len(LAGS)))

    @property
    def delay(self) -> float:
        """Return the delay [s] from a command to the motion of the base, at least the given."""
        if self._learned is None:
            return self.given
        dead_time, lag, _ = self._learned
        return max(self.given, float(c.DELAYS[dead_time] + LAGS[lag]))

    def command(self, v_x: float, yaw_rate: float, now_ns: int) -> None:
        """Add the velocity [m/s, rad/s] that is commanded from now on."""
        velocity = np.array([[v_x], [yaw_rate]])
        added = np.append(velocity, self._modeled(np.array([now_ns]))[0] - velocity, axis=1)
        if now_ns < self._times_ns[-1]:
            self._rest()
        old = max(int(np.searchsorted(self._times_ns, now_ns - c.HISTORY_NS, 'right')) - 1, 0)
        self._times_ns = np.append(self._times_ns[old:], now_ns)
        self._commands = np.append(self._commands[old:], added[None], axis=0)

    def learn(self, motion: Motion, stamp_ns: int) -> None:
        """Compare the motion at ``stamp_ns`` with the commands before it, each ``DELAY_STEP``."""
        last_ns = self._learned_ns
        if last_ns is not None and 0 < stamp_ns - last_ns < c.DELAYS_NS[1]:
            return
        self._learned_ns = stamp_ns
        if last_ns is None or not 0 < stamp_ns - last_ns <= c.MAX_GAP_NS or (
                self._times_ns[-1] == NEVER_NS):
            return
        elapsed, reached = (stamp_ns - last_ns) / NS_PER_S, _twist(motion)
        modeled = self._modeled(stamp_ns - c.DELAYS_NS)
        self._correlate(modeled, reached, elapsed)
        explained = self._explained()
        if self._squares - explained[self._present()] > c.DELAY_MARGIN + c.DELAY_RATIO * (
                self._squares - explained.max()):
            delay, speed, turn = map(int, np.unravel_index(explained.argmax(), explained.shape))
            self._learned = delay, speed, turn
        row, *columns = self._present()
        self._disturbance += elapsed / (elapsed + c.DELAYS[row] + LAGS[columns]) * (
            reached - modeled[row, (0, 1), columns] / self.factors - self._disturbance)

    def _correlate(self, modeled: Array, reached: Array, elapsed: float) -> None:
        """Add to the sums over the latest seconds."""
        m, y = modeled * self._scale, reached[:, None] * self._scale
        kept, weighted = math.exp(-elapsed * NS_PER_S / c.HISTORY_NS), elapsed * m
        self._sums *= kept
        self._sums[0] += weighted * m
        self._sums[1] += weighted * y
        self._squares = kept * self._squares + elapsed * float(np.vdot(y, y))

    def _explained(self) -> Array:
        """Return what the commands explain of the motion [(m/s)^2 s], by dead time and lags."""
        squares, products = self._sums
        explained = np.maximum(products, 0.0) ** 2 / np.maximum(squares, c.TINY)
        return explained[:, 0, :, None] + explained[:, 1, None]

    def predicted(self, motion: Motion, stamp_ns: int, now_ns: int) -> Motion:
        """
        Return the motion at which a command of now takes effect.

        Over the part of the delay that is beyond the given one, the commands under way act on the
        present motion, through the lags; over the given one, which contains them, it is kept.
        """
        row, *columns = self._present()
        beyond = self.delay - self.given
        end_ns, found = now_ns + round(beyond * NS_PER_S), motion
        duration = (end_ns - stamp_ns) / NS_PER_S
        if beyond == 0.0 or duration <= 0.0:
            return motion.after(duration + self.given)
        count = max(round(duration / c.DELAY_STEP), 1)
        time = duration * np.append(0.0, (np.arange(count) + 0.5) / count)
        expected = self._disturbance + self._modeled(
            stamp_ns + _ns(time - c.DELAYS[row]))[:, (0, 1), columns] / self.factors
        expected += (_twist(motion) - expected[0]) * np.exp(-time[:, None] / LAGS[columns])
        for v_x, yaw_rate in expected[1:].tolist():
            found = replace(found, v_x=v_x, yaw_rate=yaw_rate).after(duration / count)
        return found.after(self.given)

    def _present(self) -> tuple[int, int, int]:
        """Return the indices of the present dead time and lags."""
        if self._learned is not None:
            return self._learned
        steps, (speed, turn) = round((self.given - c.USUAL_LAGS[0]) / c.DELAY_STEP), USUAL_LAGS
        return min(max(steps, 0), len(c.DELAYS) - 1), speed, turn

    def _modeled(self, times_ns: Instants) -> Array:
        """Return speed and yaw rate at times (n,) without dead time, by lag: (n, 2, lags)."""
        index = np.searchsorted(self._times_ns, times_ns, 'right') - 1
        age, at = times_ns - self._times_ns[index], self._commands[index]
        modeled: Array = at[..., :1] + at[..., 1:] * np.exp(age[:, None, None] * DECAYS)
        return modeled


def _twist(motion: Motion) -> Array:
    """Return speed [m/s] and yaw rate [rad/s]."""
    return np.array([motion.v_x, motion.yaw_rate])


def _ns(seconds: Array) -> Instants:
    """Return times in nanoseconds."""
    return np.round(seconds * NS_PER_S).astype(np.int64)
