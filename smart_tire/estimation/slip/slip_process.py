"""When the sliding of a side may have changed, by how much, and what is known of it then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.parameters import SlipEstimatorParams


SLIDE_FLOOR = 0.02    # m/s, sliding that a wheel shows at any speed
CHANGE = 2.5          # sigmas of a change of wheel speed by stamps alone; more is real
GROUND_CHANGE = 0.01  # m/s; a larger change of the speed over ground changes the slip
CHANGE_TIME = 0.3     # s, that slip takes to settle after a change of speed
LOST = 0.05           # -, one sigma of slip that was seen too long ago; assumed
GROUND_TIME = 3.0     # s, over which the kind of ground is remembered
STRAIGHT = 0.15       # -, difference of the sides' speeds over their mean; assumed
SURPRISE = 2.0        # sigmas; beyond, twice in a row, the sliding has changed


@dataclass(frozen=True, slots=True)
class SlipChange:
    """What is seen of one side at a wheel reading."""

    variance: float      # m2/s2, by which its sliding may have changed
    speed: float         # m/s, of wheel or ground, whichever is faster
    acceleration: float  # m/s2, over ground
    beyond: float        # m2/s2, of sliding that such speed alone does not explain


@dataclass(frozen=True, slots=True)
class FreeRollingPrior:
    """The slip that both sides share while they roll, and what is to be expected of it."""

    slip: float      # -, forward force over that of unit slip, of the state
    variance: float  # -, of it
    usual: float     # -, variance of what is usual on firm ground
    firm: float      # -, 0 to 1, how likely this is firm ground and a straight way
    weight: float    # -, 0 to 1, how much what is usual should count


class InnovationChangeDetector:
    """
    Tells a change from bad readings by innovations that contradict the state twice in a row.

    A single bad reading errs the other way the next time. Innovations up to ``least`` sigmas tell
    nothing.
    """

    def __init__(self, least: float) -> None:
        self._least, self._innovation = least, 0.0

    def update(self, innovation: float, sigma: float) -> float:
        """Return the variance of a change that explains what ``sigma`` does not."""
        before, self._innovation = self._innovation, innovation
        lasting = min(abs(before), abs(innovation)) if before * innovation > 0.0 else 0.0
        return lasting ** 2 if lasting > self._least * sigma else 0.0


class SlipChangeDetector:
    """
    Watches one side's wheel and ground speeds for signs that its slip is no longer what it was.

    Slip stays while nothing happens. It changes with the wheels' speed, with the speed over
    ground (another surface shows as a braking or pushing of the body), and where readings
    surprise.
    """

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._params = params
        self._usual: tuple[float, float] | None = None  # m/s, of wheels and ground of late
        self._surprise = InnovationChangeDetector(SURPRISE)

    def update(self, duration: float, wheel: float, ground: float, innovation: float,
               sigma: float, accel_density: float) -> SlipChange:
        """
        Return how the sliding may have changed.

        ``wheel`` and ``ground`` [m/s] are mean speeds over ``duration`` [s]; ``innovation`` [m/s]
        is the reading beyond its expectation, with its ``sigma``; ``accel_density`` [(m/s2)^2 s]
        is that of the noise by which the ground's speed seems to change.
        """
        speed = max(abs(wheel), abs(ground))
        surprise = self._surprise.update(innovation, sigma)
        if self._usual is None:  # until now nothing was known of the wheels
            self._usual = wheel, ground
            return SlipChange(math.inf, speed, 0.0, 0.0)
        wheel_step, ground_step = wheel - self._usual[0], ground - self._usual[1]
        share = 1.0 - math.exp(-duration / CHANGE_TIME)
        self._usual = self._usual[0] + share * wheel_step, self._usual[1] + share * ground_step
        jitter = math.sqrt(2.0) * self._params.robot.encoder.stamp_jitter / duration
        change = self._params.slip_agility * (
            max(0.0, abs(wheel_step) - CHANGE * abs(wheel) * jitter)
            + max(0.0, abs(ground_step) - max(
                GROUND_CHANGE, CHANGE * math.sqrt(accel_density * CHANGE_TIME))))
        return SlipChange(change ** 2 * duration / CHANGE_TIME + surprise, speed,
                      ground_step / CHANGE_TIME, (ground_step - wheel_step) ** 2 + surprise)


class SlipPrior:
    """
    Covariance of the two sides' sliding where nothing is known of it.

    The slips over the wheels' speeds add up to the force that moves the robot, which is small
    while it does not accelerate; their difference, which only turns it, may be large.
    """

    def __init__(self, params: SlipEstimatorParams) -> None:
        robot = params.robot
        self._apart = params.slip_sigma ** 2
        self._common = params.common_slip_sigma ** 2
        self._firm = params.rolling_slip_sigma ** 2
        self._lost = LOST ** 2
        self._soft = 0.0          # -, mean square of common slip that was seen of late
        self._acceleration = 0.0  # m/s2, of late
        # s2/m, of a robot whose wheels are all below their critical slip
        self._slip_per_accel = robot.mass / (4.0 * robot.tire.longitudinal_stiffness)

    def of(self, changes: Sequence[SlipChange]) -> Array:
        """Return it [m2/s2], shape (2, 2), for what is seen of the two sides."""
        self._acceleration = 0.5 * sum(change.acceleration for change in changes)
        common = self._common + self._soft + (self._slip_per_accel * self._acceleration) ** 2
        left, right = changes
        shared = (common - self._apart) * left.speed * right.speed
        own = [(common + self._apart) * change.speed ** 2 + SLIDE_FLOOR ** 2 + change.beyond
               for change in changes]
        return np.array([[own[0], shared], [shared, own[1]]])

    def watch(self, slip: float, variance: float, duration: float) -> None:
        """
        Take note of a ``slip`` [-] that both sides shared for ``duration`` [s].

        Soft ground stays soft: where much slip was seen, much slip is likely after a change, too.
        """
        share = 1.0 - math.exp(-duration / GROUND_TIME)
        self._soft += share * (max(0.0, slip ** 2 - variance) - self._soft)

    def rolling(self, slip: float, variance: float, turn: float,
                unsure: float = 0.0) -> FreeRollingPrior:
        """
        Return what to expect of the ``slip`` [-] that both sides share, known with ``variance``.

        ``turn`` [-] is the difference of the sides' speeds over their mean. The weight is the
        probability of firm ground, Bayes' rule with two kinds of ground that are as common. What
        was seen a while ago is better than what is usual: that counts once the slip is lost.
        ``unsure`` [-] is the variance of slip that a wrong wheel radius feigns.
        """
        driving = (self._slip_per_accel * self._acceleration) ** 2
        firm = self._firm + driving
        near = variance + firm + unsure
        far = near + self._apart
        odds = math.sqrt(far / near) * math.exp(-0.5 * slip ** 2 * (1.0 / near - 1.0 / far))
        straight = math.exp(-(turn / STRAIGHT) ** 2)
        lost = 1.0 / (1.0 + (self._lost / max(variance, 1e-12)) ** 2)
        likely = straight * odds / (1.0 + odds)
        return FreeRollingPrior(slip, variance, firm + unsure, likely, lost * likely)
