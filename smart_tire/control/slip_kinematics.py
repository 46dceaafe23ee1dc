# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Inverse kinematics that compensate slip: docs/theory.md, "Slip-compensated kinematics".

Two coefficients that carry over from the present motion to the next one are learned from the
estimated slip, and the lateral speed from similar motions; feedback of the reached velocity
removes what they leave.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.control import constants as c
from smart_tire.control.ground_motion import Motion
from smart_tire.control.history import History
from smart_tire.control.motion_limits import command_share
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.samples import LEFT, MAX_SPEED, NS_PER_S, RIGHT, WheelSlip

Velocity = tuple[float, float]  # v_x [m/s], yaw rate [rad/s]
Moved = Sequence[float]  # v_x, v_y [m/s], yaw rate [rad/s], cosine and sine of the yaw


class SlipCoefficient:
    """
    Scalar Kalman filter of the coefficient in ``measured = value * regressor``.

    The coefficient is an Ornstein-Uhlenbeck process: its correlation decreases with e to the power
    of ``change``, the sum of changes of all that it depends on over their correlation lengths.

    The variance of the measurement is that of past innovations, which contains the noise of the
    estimates as well as what the linear model leaves out.
    """

    def __init__(self, mean: float, sigma: float, low: float, high: float) -> None:
        """Begin with the prior ``mean``; the value remains within ``low`` and ``high``."""
        self._mean, self._prior_variance, self._range = mean, sigma ** 2, (low, high)
        self.value, self._variance, self._spread2 = mean, sigma ** 2, c.SPREAD ** 2

    def after(self, change: float) -> float:
        """Return the value that is expected after a ``change`` since the last update."""
        return self._mean + math.exp(-change) * (self.value - self._mean)

    def correct(self, regressor: float, measured: float, sigma: float, change: float,
                duration: float) -> None:
        """
        Advance by ``change`` within ``duration`` [s], and correct with a measurement [m/s].

        Innovations beyond ``GATE`` times their spread are clipped; so one outlier changes little,
        while another ground widens the spread and is learned.
        """
        kept = math.exp(-2.0 * change)
        self.value = self.after(change)
        self._variance = kept * self._variance + (1.0 - kept) * self._prior_variance
        if not math.isfinite(regressor * regressor + measured):
            return
        limit = c.GATE * max(math.sqrt(self._spread2), c.MIN_SPREAD)
        innovation = min(max(measured - self.value * regressor, -limit), limit)
        noise = max(self._spread2, sigma * sigma, c.MIN_SPREAD * c.MIN_SPREAD)
        gain = self._variance * regressor / (self._variance * regressor * regressor + noise)
        low, high = self._range
        self.value = min(max(self.value + gain * innovation, low), high)
        self._variance *= 1.0 - gain * regressor
        share = min(duration / c.SPREAD_TIME, 1.0)
        self._spread2 += share * (innovation * innovation - self._spread2)


class SlideModel:
    """
    Motion of the body that its wheels do not make, by regression over similar motions.

    ``v_y = -c |v_x| v_x yaw_rate + s (b_y cos yaw - b_x sin yaw)``: slip angles of tires that bear
    the lateral acceleration, and the slide on a slope, along b in ``odom``, with the larger speed
    s of both sides. On curves of less than half of the track one side rolls back, and the tires
    slide in all directions: there the body slides ahead of its wheels, too, by
    ``s (b_x cos yaw + b_y sin yaw)``, and turns about a point x ahead of ``base_link``, with
    ``v_y = -x yaw_rate``. Of these turns in place, and of all other motions, the last
    ``HISTORY_NS`` of their kind are known.
    """

    def __init__(self, compliance: float, half_track: float) -> None:
        """Begin with the expected ``compliance`` c [s2/m], on level ground."""
        self._half_track = half_track
        self._prior = np.array([compliance, 0.0, 0.0, 0.0])
        # driving, turning in place: inverse variances of the prior; the equations of each motion,
        # which are share of the turn, factors of c, b_x, b_y and x, and the sum of these products
        self._information = [np.diag(np.array([compliance, sigma, sigma, c.PIVOT_SIGMA]) ** -2.0)
                             for sigma in (c.SLIDE_SIGMA, c.SPIN_SLIDE_SIGMA)]
        self._known = History(), History()
        self._latest_ns = 0

    def add(self, motion: Moved, slip: float, stamp_ns: int) -> None:
        """Add a motion and the mean slip velocity [m/s] beyond that which the drive causes."""
        elapsed_ns = min(max(stamp_ns - self._latest_ns, 0), c.MAX_GAP_NS)
        self._latest_ns = stamp_ns
        v_x, v_y, yaw_rate, cos, sin = motion
        share, speed = self.share(v_x, yaw_rate), self._side_speed(v_x, yaw_rate)
        in_place, less = int(share), c.AHEAD_WEIGHT * speed
        lateral = (share, -abs(v_x) * v_x * yaw_rate, -speed * sin, speed * cos,
                   -yaw_rate * in_place, v_y)
        ahead = share, 0.0, less * cos, less * sin, 0.0, -c.AHEAD_WEIGHT * slip
        known = self._known[in_place]
        known.add((known.times[-1] if known.times else 0) + elapsed_ns,
                  *lateral, *(ahead if in_place else ()))

    def expected(self, v_x: float, yaw_rate: float, yaw: ArrayLike) -> tuple[Array, Array]:
        """
        Return the slide ahead and the lateral speed [m/s] at yaws [rad], (n,) or one.

        A slide is at most ``MAX_SLIDE`` times the speed of the wheels: a fit to its onset may
        give more.
        """
        share, speed = self.share(v_x, yaw_rate), self._side_speed(v_x, yaw_rate)
        compliance, b_x, b_y, x = self._coefficients(share).tolist()
        speed /= max(math.hypot(b_x, b_y) / c.MAX_SLIDE, 1.0)
        cos, sin, in_place = np.cos(yaw), np.sin(yaw), int(share)
        return (in_place * speed * (b_x * cos + b_y * sin), speed * (b_y * cos - b_x * sin)
                - (compliance * abs(v_x) * v_x + in_place * x) * yaw_rate)

    def share(self, v_x: float, yaw_rate: float) -> float:
        """Return the speed of the sides by the turn over that of the faster one; 1 in place."""
        return self._half_track * abs(yaw_rate) / max(self._side_speed(v_x, yaw_rate), c.TINY)

    def _side_speed(self, v_x: float, yaw_rate: float) -> float:
        """Return the larger one of the speeds [m/s] of the drive and of the turn."""
        return max(abs(v_x), self._half_track * abs(yaw_rate))

    def _coefficients(self, share: float) -> Array:
        """Return c, b_x, b_y and x of motions with this share of the turn."""
        in_place = int(share)
        prior, known = self._coefficients(0.0) if in_place else self._prior, self._known[in_place]
        if not known.times:
            return prior
        equations = np.array(known.values).reshape(-1, 6)
        factors, measured = equations[:, 1:5], equations[:, 5]
        weighted = factors.T * np.exp(
            np.abs(equations[:, 0] - share) / -c.SIMILAR_TURNING) / c.SLIDE_SPREAD ** 2
        found: Array = prior + np.linalg.solve(
            weighted @ factors + self._information[in_place],
            weighted @ (measured - factors @ prior))
        return found


class VelocityFeedback:
    """
    Correction of the wanted velocity by what the body has reached of the earlier ones.

    With the feed-forward the base is a gain near 1 with a delay, for which integral control
    suffices. Times are nanoseconds of the message clock.
    """

    def __init__(self) -> None:
        """Begin without correction, at rest."""
        self.wanted = History()  # v_x, yaw rate; to be added when they are commanded
        self._correction: Velocity = 0.0, 0.0
        self._reached_ns: int | None = None

    def correction(self, reached: Velocity, reached_ns: int, delay: float,
                   bounds: Velocity) -> Velocity:
        """
        Return what to add to the wanted velocity; at most ``bounds``, where the integral ends.

        ``reached`` is the velocity at ``reached_ns``, ``delay`` [s] that of the base.
        """
        before, self._reached_ns = self._reached_ns, reached_ns
        elapsed = (reached_ns - (before or reached_ns)) / NS_PER_S
        # integral gain 1 / (e delay): critically damped for a pure delay
        share = min(max(elapsed, 0.0) / max(delay, c.TINY), 1.0) / math.e
        wanted = self.wanted.held(reached_ns - round(delay * NS_PER_S)) or (0.0, 0.0)
        v_x, yaw_rate = (
            min(max(last + share * (one - got), -bound), bound)
            for last, one, got, bound in zip(self._correction, wanted, reached, bounds))
        self._correction = v_x, yaw_rate
        return self._correction


class SlipKinematics:
    """
    Commands for a base with ideal kinematics, so that the real body moves as wanted.

    The base turns its wheels at r w = v -+ effective_track / 2 * yaw rate. Times are nanoseconds
    of the message clock.
    """

    def __init__(self, params: TrajectoryControllerParams) -> None:
        self._track, self._wheelbase = params.robot.track_width, params.robot.wheelbase
        self._effective_track, self._fade_time = params.effective_track, params.friction.fade_time
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Begin with the priors."""
        robot = self._params.robot
        self._resistance = SlipCoefficient(*c.RESISTANCE)
        self._widening = SlipCoefficient(
            _prior_widening(self._params), c.WIDENING_SIGMA, 0.0, c.MAX_WIDENING)
        self._slide = SlideModel(
            0.25 * robot.mass / robot.tire.longitudinal_stiffness, 0.5 * robot.track_width)
        self._feedback = VelocityFeedback()
        self._learned_ns: int | None = None             # time of the coefficients
        self._turning = 0.0                             # turning share that they belong to
        self._motions = History()                       # ``Moved``
        self._window = list[tuple[float, ...]]()        # motion, slip velocity, sigma of sides
        self._window_ns = 0                             # its first timestamp

    def add_motion(self, motion: Motion, stamp_ns: int) -> None:
        """Add an estimate of the motion of the body; older ones than the last are ignored."""
        times = self._motions.times
        if times and stamp_ns <= times[-1]:
            if stamp_ns > times[-1] - c.CLOCK_JUMP_NS:
                return
            self.reset()
        self._motions.add(stamp_ns, motion.v_x, motion.v_y, motion.yaw_rate, math.cos(motion.yaw),
                          math.sin(motion.yaw))

    def add_slip(self, slip: WheelSlip) -> None:
        """Add estimated slips; without motion of the same time, or at rest, they are ignored."""
        motion = self._motions.held(slip.stamp_ns, c.SLIP_WINDOW_NS)
        if motion is None or slip.stamp_ns < self._window_ns:
            return
        if math.hypot(*motion[:2]) < c.STANDSTILL_SPEED and abs(motion[2]) < c.STANDSTILL_RATE:
            return  # a slide with released motors has another slip than a drive
        half = 0.5 * self._track * motion[2]
        left = _side(slip, LEFT, motion[0] - half)
        right = _side(slip, RIGHT, motion[0] + half)
        if left is None or right is None:
            return
        if self._window and slip.stamp_ns - self._window_ns >= c.SLIP_WINDOW_NS:
            self._learn()
        if not self._window:
            self._window_ns = slip.stamp_ns
        self._window.append((*motion, *left, *right))

    def command(self, v_x: float, yaw_rate: float, now_ns: int, delay: float,
                params: TrajectoryControllerParams) -> Velocity:
        """
        Return v_x [m/s] and yaw rate [rad/s] to command for wanted ones of the body.

        ``delay`` [s] is that of the base.
        """
        if v_x == yaw_rate == 0.0:
            self._feedback = VelocityFeedback()
            return 0.0, 0.0
        (speed, turn), added, slide = self.factors(v_x, yaw_rate, now_ns), (0.0, 0.0), 0.0
        if self._motions.times:
            reached, lateral, reached_rate, cos, sin = self._motions.latest
            added = self._feedback.correction(
                (reached, reached_rate), self._motions.times[-1], delay,
                (c.MAX_SPEED_SHARE * abs(v_x), c.MAX_YAW_SHARE * params.limits.yaw_rate))
            if math.hypot(reached, lateral) <= c.MAX_HOLD_SPEED:  # else it slides off
                slide = float(self._slide.expected(
                    v_x, yaw_rate, math.atan2(sin, cos) + delay * reached_rate)[0])
        command = speed * (v_x + added[0] - slide), turn * (yaw_rate + added[1])
        share = command_share(command, params)
        self._feedback.wanted.add(now_ns, share * v_x, share * yaw_rate)
        return share * command[0], share * command[1]

    def factors(self, v_x: float, yaw_rate: float, now_ns: int) -> Velocity:
        """Return commanded over reached speed and yaw rate, for wanted ones of the body."""
        learned_ns = now_ns if self._learned_ns is None else self._learned_ns
        aged = max(now_ns - learned_ns, 0) / NS_PER_S / self._fade_time
        widening = 1.0 + self._widening.after(aged + self._change(v_x, yaw_rate))
        return (widening if self._in_place(v_x, yaw_rate) else 1.0 + self._resistance.after(aged),
                widening * self._track / self._effective_track)

    def lateral_speed(self, v_x: float, yaw_rate: float, yaw: ArrayLike) -> Array:
        """Return the lateral speeds [m/s] of the body to be expected at yaws [rad] (n,) or one."""
        return self._slide.expected(v_x, yaw_rate, yaw)[1]

    def _change(self, v_x: float, yaw_rate: float) -> float:
        """Return the change of the turning share from the one learned last, over its length."""
        return abs(self._turning_share(v_x, yaw_rate) - self._turning) / c.TURNING_LENGTH

    def _in_place(self, v_x: float, yaw_rate: float) -> bool:
        """Return whether one side rolls back, so that both have the slip ratio of the turn."""
        return self._slide.share(v_x, yaw_rate) == 1.0

    def _turning_share(self, v_x: float, yaw_rate: float) -> float:
        """Return the share of sideways motion of the wheels: 0 straight on, 1 in place."""
        sideways = 0.5 * self._wheelbase * abs(yaw_rate)
        return sideways / (sideways + abs(v_x) + c.STANDSTILL_SPEED)

    def _learn(self) -> None:
        """Correct the coefficients with the means of the window, and empty it."""
        count, stamp_ns, last_ns = len(self._window), self._window_ns, self._learned_ns
        *motion, left, left_sigma, right, right_sigma = (
            sum(column) / count for column in zip(*self._window))
        self._window.clear()
        self._learned_ns = stamp_ns
        duration = 0.0 if last_ns is None else max(stamp_ns - last_ns, 0) / NS_PER_S
        self._correct(motion, left, right, 0.5 * (left_sigma + right_sigma), duration)
        slip = 0.5 * (left + right)
        if self._in_place(motion[0], motion[2]):  # the turn's share of the speed of the wheels
            slip -= (1.0 - 1.0 / (1.0 + self._widening.value)) * (slip + motion[0])
        else:
            slip -= self._resistance.value * motion[0]
        if abs(slip) <= MAX_SPEED:
            self._slide.add(motion, slip, stamp_ns)

    def _correct(self, motion: Moved, left: float, right: float, sigma: float,
                 duration: float) -> None:
        """Correct the coefficients, ``duration`` [s] after the last time, with slip velocities."""
        v_x, _, yaw_rate, *_ = motion
        aged = duration / self._fade_time
        change = aged + self._change(v_x, yaw_rate)
        self._turning = self._turning_share(v_x, yaw_rate)
        if not self._in_place(v_x, yaw_rate):
            self._resistance.correct(v_x, 0.5 * (left + right), sigma, aged, duration)
        self._widening.correct(
            0.5 * self._track * yaw_rate, 0.5 * (right - left), sigma, change, duration)


def _prior_widening(params: TrajectoryControllerParams) -> float:
    """Return that of a calibrated ``effective_track``, else of isotropic tires in a wide turn."""
    robot = params.robot
    added = params.effective_track / robot.track_width - 1.0
    return added if added > 0.0 else (robot.wheelbase / robot.track_width) ** 2


def _side(slip: WheelSlip, wheels: tuple[int, int], v_x: float) -> tuple[float, float] | None:
    """Return slip velocity and its sigma [m/s] of a side; None if no wheel of it is known."""
    known = [(slip.slip_velocity[i], slip.sigma[i]) for i in wheels
             if math.isfinite(slip.slip_velocity[i]) and math.isfinite(slip.sigma[i])]
    if not known:
        return None
    velocities, sigmas = zip(*known)
    velocity = sum(velocities) / len(known)
    return velocity, max(sigmas) * abs(v_x + velocity)
