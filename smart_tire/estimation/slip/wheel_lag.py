# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, cdivision=True, infer_types=True, initializedcheck=False
# cython: show_performance_hints=False

"""
Delay of the wheels behind the gyroscope, from the turns that both measure.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler.
"""

from __future__ import annotations

from collections import deque

from smart_tire.estimation.slip import state

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.libc.math import log, sqrt
else:
    from math import log, sqrt

COMPILED: bool = cython.compiled

# constants that are numbers of C
cython.declare(
    LAG_SIGMA=cython.double, LAG_WINDOW=cython.double, MAX_LAG_RATE=cython.double,
    MIN_LAG=cython.double, SLIP_CORRELATION_TIME=cython.double, SLIP_LEARNING_TIME=cython.double,
    LAG_STEP=cython.double, MAX_SAMPLE_GAP=cython.double, COUNT=cython.int)
LAG_SIGMA, LAG_WINDOW, MIN_LAG = state.LAG_SIGMA, state.LAG_WINDOW, state.MIN_LAG
MAX_LAG_RATE, SLIP_CORRELATION_TIME = state.MAX_LAG_RATE, state.SLIP_CORRELATION_TIME
SLIP_LEARNING_TIME, MAX_SAMPLE_GAP = state.SLIP_LEARNING_TIME, state.MAX_SAMPLE_GAP
COUNT = 16  # lags that are compared: up to three sigmas
LAG_STEP = 0.2 * LAG_SIGMA  # s
MAX_LAG = (COUNT - 1) * LAG_STEP


@cython.cclass
class WheelLag:
    """
    Most probable delay ``value`` [s] of the wheels, beyond the known one.

    Over windows of ``LAG_WINDOW`` the difference of the side speeds is a linear function of the
    yaw rate at the right delay, with an error that is correlated as the slip is. ``n`` independent
    errors with the correlation coefficient r have the log likelihood -n/2 ln(1 - r^2); the prior
    is half a normal distribution. Slip that builds up looks like a delay of up to ``MIN_LAG``.
    """

    value = cython.declare(cython.double, visibility='readonly')
    _angles = cython.declare(object)
    _rate: cython.double      # rad/s, last one
    _turned: cython.double    # m, difference of the distances of both sides in the window
    _open: cython.bint        # there is a window, ...
    _begin: cython.double     # s, ... since
    _duration: cython.double  # s, of all windows
    # means of the wheels' turns, and of the yaw rate by lag; their central second moments
    _mean: cython.double
    _own: cython.double
    _means: cython.double[16]
    _mixed: cython.double[16]
    _others: cython.double[16]

    def __init__(self) -> None:
        self.value = self._rate = self._turned = self._begin = self._duration = 0.0
        self._mean = self._own = 0.0
        self._open = False
        self._angles = deque()  # time [s] and yaw angle [rad]
        self._means, self._mixed, self._others = [0.0] * 16, [0.0] * 16, [0.0] * 16

    @cython.ccall
    def add_rate(self, time: cython.double, rate: cython.double) -> None:
        """Add a yaw rate [rad/s] of ``time`` [s]."""
        angles = self._angles
        if not angles:
            angles.append((time, 0.0))
        last = angles[-1]
        before: cython.double = last[0]
        angle: cython.double = last[1]
        if time > before:
            angles.append((time, angle + 0.5 * (time - before) * (self._rate + rate)))
        self._rate = rate
        while time - angles[0][0] > MAX_SAMPLE_GAP:
            angles.popleft()

    @cython.ccall
    def add_turn(self, time: cython.double, difference: cython.double, dt: cython.double,
                 moving: cython.bint) -> None:
        """Add the difference [m/s] of the side speeds over ``dt`` [s] before ``time`` [s]."""
        if not moving:
            self._open = False
            return
        if not self._open:
            self._open, self._begin, self._turned = True, time - dt, 0.0
        self._turned += difference * dt
        span = time - self._begin
        if span < LAG_WINDOW:
            return
        if self._angles and self._angles[0][0] <= self._begin - MAX_LAG:
            self._compare(span, time)
        self._open = False

    @cython.cfunc
    def _compare(self, span: cython.double, end: cython.double) -> cython.void:
        self._duration += span
        gain = span / min(self._duration, SLIP_LEARNING_TIME)
        keep = 1.0 - gain
        own = self._turned / span - self._mean
        self._mean += gain * own
        self._own = keep * (self._own + gain * own * own)
        points = list(self._angles)
        new = old = len(points) - 1
        for i in range(COUNT):
            time = end - i * LAG_STEP
            new = _before(points, time, new)
            old = _before(points, time - span, old)
            rate = (_angle(points, new, time) - _angle(points, old, time - span)) / span
            other = rate - self._means[i]
            self._means[i] += gain * other
            self._mixed[i] = keep * (self._mixed[i] + gain * own * other)
            self._others[i] = keep * (self._others[i] + gain * other * other)
        lag = self._most_probable()
        step = (lag if lag > MIN_LAG else 0.0) - self.value
        self.value += min(max(step, -MAX_LAG_RATE * span), MAX_LAG_RATE * span)

    @cython.cfunc
    def _most_probable(self) -> cython.double:
        n = min(self._duration, SLIP_LEARNING_TIME) / SLIP_CORRELATION_TIME
        scores: cython.double[16] = [0.0] * 16
        best = 0
        for i in range(COUNT):
            scale = self._own * self._others[i]
            r = max(self._mixed[i], 0.0) / sqrt(scale) if scale > 0.0 else 0.0
            lags = 0.2 * i  # in sigmas
            scores[i] = -0.5 * n * log(max(1.0 - r * r, 1e-9)) - 0.5 * lags * lags
            if scores[i] > scores[best]:
                best = i
        if not 0 < best < COUNT - 1:
            return best * LAG_STEP
        # the top of the parabola through three points
        left, middle, right = scores[best - 1], scores[best], scores[best + 1]
        return (best + 0.5 * (left - right) / min(left - 2.0 * middle + right, -1e-9)) * LAG_STEP


@cython.cfunc
def _before(points: list[tuple[float, float]], time: cython.double, i: cython.int) -> cython.int:
    """Return the index, up to ``i``, of the last one of ``points`` that is not after ``time``."""
    while i > 0 and points[i][0] > time:
        i -= 1
    return i


@cython.cfunc
def _angle(points: list[tuple[float, float]], i: cython.int, time: cython.double
           ) -> cython.double:
    """Return the angle [rad] at ``time`` [s], from that of the point before on."""
    begin: cython.double = points[i][0]
    angle: cython.double = points[i][1]
    if i + 1 == len(points) or time <= begin:
        return angle
    end: cython.double = points[i + 1][0]
    after: cython.double = points[i + 1][1]
    return angle + (after - angle) / (end - begin) * (time - begin)
