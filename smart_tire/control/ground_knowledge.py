# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction of the present ground: measured by the films, and shown by the robot."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.control import constants as c
from smart_tire.models.vehicle.drive import traction_force
from smart_tire.parameters.path_following import FrictionLimitParams, GroundParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GRAVITY, GroundState, MAX_SPEED, NS_PER_S, WHEELS, WheelSample
from smart_tire.uncertain import fused, Uncertain


@dataclass(frozen=True)
class Measured:
    """Properties of the ground from one ``ground_state``."""

    friction: Uncertain       # -
    slip_per_load: Uncertain  # 1/N, critical slip over load: 3 mu / C_x
    stamp_ns: int
    distance: float           # m, driven until then


class GroundKnowledge:
    """
    Latest plausible ``ground_state`` with a friction coefficient.

    Its weight decreases exponentially with the distance driven and the time since; times are
    nanoseconds of the message clock.
    """

    def __init__(self) -> None:
        self._driven, self._now_ns = 0.0, 0
        self._measured: Measured | None = None

    def clear(self) -> None:
        """Discard what was measured."""
        self._measured = None

    def drive(self, distance: float, now_ns: int) -> None:
        """Add a distance driven [m] until ``now_ns``."""
        self._driven += distance
        self._now_ns = now_ns

    def set_ground(self, ground: GroundState, behind: float = 0.0) -> None:
        """
        Use the state of the ground, ``behind`` [m] back; without plausible friction it is ignored.

        The standard deviations are at least that of the wheel load.
        """
        (mu, mu_sigma), (stiffness, stiffness_sigma) = (ground.friction_coefficient,
                                                        ground.stiffness)
        if not (c.MIN_FRICTION <= mu <= c.MAX_FRICTION and 0.0 <= mu_sigma < math.inf
                and c.MIN_GROUND_STIFFNESS <= stiffness <= c.MAX_GROUND_STIFFNESS
                and 0.0 <= stiffness_sigma < math.inf
                and abs(ground.stiffness_friction_correlation) <= 1.0):
            return
        one, other = mu_sigma / mu, stiffness_sigma / stiffness
        common = 2.0 * ground.stiffness_friction_correlation * one * other
        slip = 3.0 * mu / stiffness
        sigma = math.sqrt(max(one * one + other * other - common, c.MIN_RELATIVE_SIGMA ** 2))
        self._measured = Measured(
            Uncertain(mu, max(mu_sigma, c.MIN_RELATIVE_SIGMA * mu)), Uncertain(slip, slip * sigma),
            ground.stamp_ns, self._driven - behind)

    def latest(self, fading: GroundParams) -> tuple[Measured, float] | None:
        """Return the latest measurement and its weight, None if it is too old."""
        one = self._measured
        if one is None:
            return None
        lengths = ((self._driven - one.distance) / fading.fade_distance
                   + abs(self._now_ns - one.stamp_ns) / NS_PER_S / fading.fade_time)
        return (one, math.exp(-lengths)) if lengths <= c.MAX_FADE_LENGTHS else None

    def friction(self, unknown: float, fading: GroundParams) -> Uncertain:
        """Return the friction coefficient: the measured one fused with that of unknown ground."""
        prior = Uncertain(unknown, c.PRIOR_SIGMA)
        if (known := self.latest(fading)) is None:
            return prior
        one, weight = known
        mean, sigma = fused(prior, one.friction)
        return Uncertain(prior.value + weight * (mean - prior.value),
                         prior.sigma + weight * (sigma - prior.sigma))

    def acceleration(self, params: FrictionLimitParams) -> float:
        """
        Return the acceleration [m/s2] of the body, in any direction, that is allowed.

        It is a share of the lower bound of the friction, mu - k sigma. That of unknown ground is
        ``unknown``; an estimate that is less certain does not lower the bound.
        """
        mu, sigma = self.friction(params.unknown + params.sigmas * c.PRIOR_SIGMA, params)
        return params.share * max(mu - params.sigmas * sigma, params.minimum) * GRAVITY


class ShownFriction:
    """
    Friction coefficient that the robot shows at the limit of slip, from forces and slips.

    The force over the weight is that of the acceleration and of the resistance, by which the motor
    torques exceed it. It is a lower bound of the friction; the largest friction with which the
    softest ground has this force at this slip is an upper one. On ground with a large rolling
    resistance, which is soft, friction is raised.
    """

    def __init__(self, robot: RobotParams, value: float) -> None:
        """Begin with the friction ``value`` of unknown ground."""
        self._robot, self.value = robot, value
        self._resistance = 0.0            # -, against the motion
        self._slip = 0.0                  # -, mean of the wheels
        self._wheels: WheelSample | None = None
        self._force: float | None = None  # N, of all motors at the tires, without inertia

    def period_ns(self, stamp_ns: int) -> int:
        """Return the time [ns] since the latest reading, 0 if it is not plausible."""
        gap_ns = 0 if self._wheels is None else stamp_ns - self._wheels.stamp_ns
        return gap_ns if 0 < gap_ns <= c.MAX_GAP_NS else 0

    def add_wheels(self, wheels: WheelSample, v_x: float, time_constant: float) -> None:
        """
        Add wheel speeds and motor torques; ``v_x`` [m/s] is the speed of the robot then.

        Slip and force pass low-pass filters with the ``time_constant`` [s] of the acceleration.
        """
        elapsed = self.period_ns(wheels.stamp_ns) / NS_PER_S
        gain = elapsed / (elapsed + time_constant) if elapsed else 1.0
        slip, force = self._slip, self._force
        self._wheels, self._force, self._slip = wheels, None, 0.0
        robot, torques = self._robot, wheels.effort or (math.nan,)
        rolling = robot.wheel_radius * sum(wheels.velocity) / len(WHEELS)
        if abs(rolling) <= MAX_SPEED:  # false for NaN, too
            new = (rolling - v_x) / max(abs(rolling), abs(v_x), c.MIN_SPEED)
            self._slip = slip + gain * (new - slip)
            if all(abs(torque) <= c.MAX_TORQUE for torque in torques):
                new = float(traction_force(
                    torques, wheels.velocity, 0.0, robot.mass * GRAVITY / len(WHEELS),
                    robot.motor, robot.wheel_radius).sum())
                self._force = new if force is None else force + gain * (new - force)

    def begin(self, expected: float) -> None:
        """Begin an acceleration at the limit, on ground of the ``expected`` friction."""
        self.value = min(expected, c.MAX_FRICTION)

    def learn_resistance(self, acceleration: float, v_x: float, period: float,
                         time_constant: float) -> None:
        """Learn the resistance at an acceleration [m/s2] and a speed [m/s]."""
        if self._force is None or abs(v_x) < c.MIN_SPEED:
            return
        robot = self._robot
        inertia = robot.mass + len(WHEELS) * robot.motor.inertia / robot.wheel_radius ** 2
        excess = (self._force - inertia * acceleration) / (robot.mass * GRAVITY)
        self._resistance += period / (period + time_constant) * (
            math.copysign(1.0, v_x) * excess - self._resistance)

    def learn_friction(self, acceleration: float, v_x: float, direction: int, aimed: float,
                       period: float) -> None:
        """
        Use the measured acceleration [m/s2] at the limit, ``period`` [s] after the last one.

        A slip far below the one ``aimed`` at, as when the wheels lag behind, is no evidence.
        """
        driving = direction * v_x >= 0.0
        used = max(direction * acceleration / GRAVITY
                   + (self._resistance if driving else -self._resistance), 0.0)
        soft = self._resistance > c.MASS_ERROR * abs(acceleration) / GRAVITY + c.SOFT_RESISTANCE
        share = c.RAISE_SHARE if soft else c.SOFT_SHARE
        if soft:
            self.value = max(self.value, used / share)
        # the force of a stop builds up late: an early doubt would prolong it
        if driving and direction * self._slip > c.REACHED_SHARE * aimed:
            bound = max(self._largest(used), used / share)
            if self.value > bound:
                self.value = bound + math.exp(-period / c.DROP_TIME) * (self.value - bound)
        self.value = min(max(used, self.value), c.MAX_FRICTION)

    def _largest(self, used: float) -> float:
        """
        Return the largest friction with which a tire has the force ``used`` (over its load) now.

        The brush model for small slip, F = p (1 - t + t^2 / 3) with p = C_x s and t = p / (3 mu).
        """
        robot = self._robot
        elastic = c.MIN_STIFFNESS * robot.tire.longitudinal_stiffness * abs(self._slip) / (
            robot.mass * GRAVITY / len(WHEELS))
        if used >= elastic:
            return c.MAX_FRICTION
        if 3.0 * used <= elastic:
            return used
        return elastic / (1.5 * (3.0 - math.sqrt(12.0 * used / elastic - 3.0)))
