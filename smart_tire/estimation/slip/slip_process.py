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

"""Process model of side slip: change detection and the prior after a change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.state import WheelMeasurement
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import SlipEstimatorParams

MIN_SLIP_VELOCITY = 0.02        # m/s, standard deviation of the slip velocity at standstill
STAMP_JITTER_SIGMAS = 2.5       # of a wheel speed change due to timestamps; more is a change
MIN_GROUND_SPEED_CHANGE = 0.01  # m/s; a larger change of the speed over ground changes the slip
SLIP_SETTLING_TIME = 0.3        # s, that slip takes to settle after a change of speed
LOST_SLIP_SIGMA = 0.05          # -, at which the estimated slip is as good as lost; assumed
UNOBSERVABLE_SLOPE = 0.02        # rad, standard deviation of the slope that hides common slip
SOFT_GROUND_WINDOW = 3.0        # s, over which the observed slip indicates soft ground
STRAIGHT_SPEED_DIFFERENCE = 0.15  # -, of the sides, over their mean; assumed
MAX_SLIP_PER_ACCEL = 1.0 / GRAVITY  # s2/m, at a C_x equal to the load; lower: of another tire
INNOVATION_SIGMAS = 2.0         # exceeded twice in a row with one sign: the slip has changed


@dataclass(frozen=True, slots=True)
class SlipChange:
    """Possible change of one side's slip velocity at a wheel measurement."""

    variance: float              # m2/s2, of the change
    speed: float                 # m/s, of wheel or ground, whichever is faster
    acceleration: float          # m/s2, over ground
    unexplained_variance: float  # m2/s2, of the slip velocity beyond a share of the speed


@dataclass(frozen=True, slots=True)
class FreeRollingPrior:
    """Common slip of freely rolling wheels: its estimate and its prior."""

    slip: float              # -, mean of both sides, of the state
    variance: float          # -, of ``slip``
    prior_variance: float    # -, of the slip on firm ground
    firm_probability: float  # -, 0 to 1, of firm ground and straight driving
    information: float       # -, inverse variance of zero slip, on firm and on any other ground


class InnovationChangeDetector:
    """
    Detects a change by two consecutive innovations of the same sign.

    A single outlier is followed by an innovation of the opposite sign. Innovations up to
    ``min_sigmas`` standard deviations are ignored.
    """

    def __init__(self, min_sigmas: float) -> None:
        self._min_sigmas, self._innovation = min_sigmas, 0.0

    def update(self, innovation: float, sigma: float) -> float:
        """Return the variance of the change, 0 if ``sigma`` explains the innovations."""
        before, self._innovation = self._innovation, innovation
        lasting = min(abs(before), abs(innovation)) if before * innovation > 0.0 else 0.0
        return lasting ** 2 if lasting > self._min_sigmas * sigma else 0.0


class SlipChangeDetector:
    """
    Detects changes of one side's slip from its wheel and ground speeds.

    Slip is constant while nothing changes. It changes with the wheel speed, with the speed over
    ground (another surface brakes or accelerates the body), and when innovations persist.
    """

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._params = params
        self._smoothed: tuple[float, float] | None = None  # m/s, of wheel and ground
        self._innovations = InnovationChangeDetector(INNOVATION_SIGMAS)

    def update(self, duration: float, wheel: float, ground: float, innovation: float,
               sigma: float, accel_density: float) -> SlipChange:
        """
        Return the possible change of the slip velocity.

        ``wheel`` and ``ground`` [m/s] are mean speeds over ``duration`` [s]; ``innovation`` [m/s]
        is that of the wheel speed, with its ``sigma``; ``accel_density`` [(m/s2)^2 s] is the noise
        density of the acceleration that the ground speed is integrated from.
        """
        speed = max(abs(wheel), abs(ground))
        persistent = self._innovations.update(innovation, sigma)
        if self._smoothed is None:  # first measurement: the slip velocity is unknown
            self._smoothed = wheel, ground
            return SlipChange(math.inf, speed, 0.0, 0.0)
        wheel_step, ground_step = wheel - self._smoothed[0], ground - self._smoothed[1]
        gain = 1.0 - math.exp(-duration / SLIP_SETTLING_TIME)
        self._smoothed = (self._smoothed[0] + gain * wheel_step,
                          self._smoothed[1] + gain * ground_step)
        jitter = math.sqrt(2.0) * self._params.robot.encoder.stamp_jitter / duration
        # m/s, of the ground speed
        noise = STAMP_JITTER_SIGMAS * math.sqrt(accel_density * SLIP_SETTLING_TIME)
        change = self._params.slip_change_gain * (
            max(0.0, abs(wheel_step) - STAMP_JITTER_SIGMAS * abs(wheel) * jitter)
            + max(0.0, abs(ground_step) - max(MIN_GROUND_SPEED_CHANGE, noise)))
        return SlipChange(
            change ** 2 * duration / SLIP_SETTLING_TIME + persistent, speed,
            ground_step / SLIP_SETTLING_TIME if abs(ground_step) > noise else 0.0,
            (ground_step - wheel_step) ** 2 + persistent)


class SlipPrior:
    """
    Prior covariance of the two slip velocities.

    The sum of the slips gives the force that accelerates the robot, which is small at constant
    speed; their difference only yaws the robot and may be large.
    """

    def __init__(self, params: SlipEstimatorParams) -> None:
        robot = params.robot
        self._differential = params.differential_slip_sigma ** 2
        self._common = params.common_slip_sigma ** 2
        self._firm = params.free_rolling_slip_sigma ** 2
        self._lost = LOST_SLIP_SIGMA ** 2
        self._soft = 0.0          # -, mean square of the recently observed common slip
        self._acceleration = 0.0  # m/s2, latest
        # s2/m, of a robot whose wheels are all below their critical slip
        self._slip_per_accel = min(
            robot.mass / (4.0 * robot.tire.longitudinal_stiffness), MAX_SLIP_PER_ACCEL)

    def covariance(self, changes: Sequence[SlipChange]) -> Array:
        """Return the prior [m2/s2], shape (2, 2), for the changes of the two sides."""
        self._acceleration = 0.5 * sum(change.acceleration for change in changes)
        common = self._common + self._soft + (self._slip_per_accel * self._acceleration) ** 2
        left, right = changes
        shared = (common - self._differential) * left.speed * right.speed
        own = [(common + self._differential) * change.speed ** 2 + MIN_SLIP_VELOCITY ** 2
               + change.unexplained_variance for change in changes]
        return np.array([[own[0], shared], [shared, own[1]]])

    def update_soft_ground(self, slip: float, variance: float, duration: float) -> None:
        """
        Add a common ``slip`` [-] that was estimated with ``variance`` for ``duration`` [s].

        The surface persists: where common slip was large, it is likely to be large after a
        change, too.
        """
        gain = 1.0 - math.exp(-duration / SOFT_GROUND_WINDOW)
        self._soft += gain * (max(0.0, slip ** 2 - variance) - self._soft)

    def free_rolling(self, slip: float, variance: float, turn: float,
                     radius_variance: float = 0.0, slope_sigma: float = 0.0) -> FreeRollingPrior:
        """
        Return the prior of the common ``slip`` [-] that is estimated with ``variance``.

        ``turn`` [-] is the difference of the side speeds over their mean; ``radius_variance`` [-]
        is the variance of apparent slip due to the wheel radius. The prior is that of firm ground
        with its probability, by Bayes' rule with firm and soft ground equally likely, otherwise
        the one after a change. Its information is small while the slip is well known, because an
        observed slip is better than the prior; ``slope_sigma`` [rad], the standard deviation of
        the slope, lowers the variance at which that is so.
        """
        driving = (self._slip_per_accel * self._acceleration) ** 2
        firm = self._firm + driving
        near = variance + firm + radius_variance
        far = near + self._differential
        odds = math.sqrt(far / near) * math.exp(-0.5 * slip ** 2 * (1.0 / near - 1.0 / far))
        straight = math.exp(-(turn / STRAIGHT_SPEED_DIFFERENCE) ** 2)
        threshold = self._lost / (1.0 + (slope_sigma / UNOBSERVABLE_SLOPE) ** 2)
        lost = 1.0 / (1.0 + (threshold / max(variance, 1e-12)) ** 2)
        probability = straight * odds / (1.0 + odds)
        return FreeRollingPrior(
            slip, variance, firm + radius_variance, probability,
            lost * (probability / (firm + radius_variance) + (1.0 - probability) / (
                self._common + self._soft + driving + radius_variance)))


class SlipProcess:
    """Share of the slip information that a wheel measurement invalidates, and the prior."""

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._detectors = [SlipChangeDetector(params), SlipChangeDetector(params)]
        self.prior = SlipPrior(params)

    def update(self, wheels: WheelMeasurement, ground_speeds: Sequence[float], innovation: Array,
               sigma: Array, accel_density: float) -> tuple[float, Array]:
        """
        Return the share (0 to 1) of the slip velocities to replace, and their prior (2, 2).

        ``ground_speeds`` [m/s] are those of the two sides; ``innovation`` (2,) [m/s] is that of
        the side speeds, with its ``sigma`` (2,); see ``SlipChangeDetector`` for the noise density.
        """
        changes = [
            detector.update(wheels.duration, wheels.side_speeds[row], ground_speeds[row],
                            float(innovation[row]), float(sigma[row]), accel_density)
            for row, detector in enumerate(self._detectors)]
        prior = self.prior.covariance(changes)
        share = min(1.0, max(change.variance / prior[row, row]
                             for row, change in enumerate(changes)))
        return share, prior
