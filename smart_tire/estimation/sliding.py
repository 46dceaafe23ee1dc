"""When the sliding of a side may have changed, and by how much."""

from __future__ import annotations

import math

from smart_tire.parameters import SlipEstimatorParams

SLIDE_FLOOR = 0.02    # m/s, sliding that a wheel shows at any speed
CHANGE = 2.5          # sigmas of a change of wheel speed by stamps alone; more is real
GROUND_CHANGE = 0.01  # m/s; a larger change of the speed over ground changes the slip
CHANGE_TIME = 0.3     # s, that slip takes to settle after a change of speed
SURPRISE = 2.0        # sigmas; beyond, twice in a row, the sliding has changed


class SlidingChange:
    """
    Watches one side's wheel and ground speeds for signs that its slip is no longer what it was.

    Slip stays while nothing happens. It changes with the wheels' speed, with the speed over
    ground (another surface shows as a braking or pushing of the body), and where readings
    contradict the state twice in a row: a single bad reading errs the other way the next time.
    """

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._params = params
        self._usual: tuple[float, float] | None = None  # m/s, of wheels and ground of late
        self._innovation = 0.0                          # m/s, of the last reading

    def update(self, duration: float, wheel: float, ground: float, innovation: float,
               sigma: float) -> tuple[float, float]:
        """
        Return the variance [m2/s2] by which the sliding changed, and that of not knowing it.

        ``wheel`` and ``ground`` [m/s] are mean speeds over ``duration`` [s]; ``innovation`` [m/s]
        is the reading beyond its expectation, with its ``sigma``.
        """
        spread = (self._params.slip_sigma * max(abs(wheel), abs(ground))) ** 2 + SLIDE_FLOOR ** 2
        surprise = max(0.0, self._lasting(innovation) - SURPRISE * sigma)
        if self._usual is None:  # until now nothing was known of the wheels
            self._usual = wheel, ground
            return spread, spread
        wheel_step, ground_step = wheel - self._usual[0], ground - self._usual[1]
        share = 1.0 - math.exp(-duration / CHANGE_TIME)
        self._usual = self._usual[0] + share * wheel_step, self._usual[1] + share * ground_step
        jitter = math.sqrt(2.0) * self._params.robot.encoder.stamp_jitter / duration
        change = self._params.slip_agility * (
            max(0.0, abs(wheel_step) - CHANGE * abs(wheel) * jitter)
            + max(0.0, abs(ground_step) - GROUND_CHANGE))
        apart = ground_step - wheel_step
        return (change ** 2 * duration / CHANGE_TIME + surprise ** 2,
                spread + surprise ** 2 + apart ** 2)

    def _lasting(self, innovation: float) -> float:
        """Return how much of an innovation there was before: a bad reading comes alone."""
        before, self._innovation = self._innovation, innovation
        return min(abs(before), abs(innovation)) if before * innovation > 0.0 else 0.0
