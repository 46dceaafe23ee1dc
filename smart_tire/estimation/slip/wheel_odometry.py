"""From wheel samples to mean speeds of the two sides between two readings."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.parameters import RobotParams
from smart_tire.samples import Four, WheelSample

LONGEST = 2.0         # s between readings; beyond, only the newest period is used
JUMP_SPEED = 3.0      # rad/s by which positions may contradict velocities, reset beyond
BEYOND_MEMORY = 0.5   # share of a new reading in a wheel's difference from its side


@dataclass(frozen=True, slots=True)
class WheelReading:
    """Mean speeds over the time that ends with a reading."""

    duration: float             # s
    wheel_speeds: Four          # m/s, r w
    sides: tuple[float, float]  # m/s, left and right
    variance: float             # (m/s)^2 of a side, by quantisation
    stamped: bool               # from positions and stamps, so stamp errors show


class WheelReader:
    """
    Turns positions, or velocities where there are none, into mean speeds.

    Velocities are means over the period that ends at the stamp: after a lost message they still
    describe one period, while positions bridge the gap.
    """

    def __init__(self, robot: RobotParams) -> None:
        self.radius = robot.wheel_radius  # m, effective rolling radius; its owner may learn it
        self._count = 2.0 * math.pi / robot.encoder.counts_per_revolution * robot.wheel_radius
        self._last: tuple[float, WheelSample] | None = None
        self._period: float | None = None
        self.side_speeds = (0.0, 0.0)                  # m/s, of the last reading
        self.beyond_side: Four = (0.0, 0.0, 0.0, 0.0)  # m/s, each wheel's beyond its side's mean
        self.jumps = 0

    @property
    def started(self) -> bool:
        """Return whether a sample has been seen."""
        return self._last is not None

    def read(self, time: float, sample: WheelSample) -> WheelReading | None:
        """Return the reading that ends at ``time`` [s]; None if it is older than the last."""
        if self._last is None:
            self._last = (time, sample)
            return self._from_velocity(sample, 0.05)
        before, previous = self._last
        if time <= before:
            return None
        gap, self._last = time - before, (time, sample)
        self._period = gap if self._period is None else (
            self._period + 0.1 * (min(gap, 2.0 * self._period) - self._period))
        speeds = self._differences(previous, sample, gap)
        if speeds is not None and gap < LONGEST:
            return self._reading(gap, speeds, stamped=True)
        return self._from_velocity(sample, min(gap, 1.5 * self._period))

    def _differences(self, previous: WheelSample, sample: WheelSample, gap: float) -> Four | None:
        if previous.position is None or sample.position is None:
            return None
        rates = [(new - old) / gap for new, old in zip(sample.position, previous.position)]
        if any(abs(rate - velocity) > JUMP_SPEED + abs(velocity)
               for rate, velocity in zip(rates, sample.velocity)):
            self.jumps += 1
            return None
        return tuple(self.radius * rate for rate in rates)  # type: ignore[return-value]

    def _from_velocity(self, sample: WheelSample, duration: float) -> WheelReading:
        speeds: Four = tuple(self.radius * w for w in sample.velocity)  # type: ignore[assignment]
        return self._reading(duration, speeds, stamped=False)

    def _reading(self, duration: float, speeds: Four, stamped: bool) -> WheelReading:
        left, right = 0.5 * (speeds[0] + speeds[2]), 0.5 * (speeds[1] + speeds[3])
        self.side_speeds = left, right
        self.beyond_side = tuple(  # type: ignore[assignment]
            old + BEYOND_MEMORY * (speeds[i] - self.side_speeds[i % 2] - old)
            for i, old in enumerate(self.beyond_side))
        # each end of the stretch is uniform over a count; a side is the mean of two wheels
        variance = (self._count / duration) ** 2 / 12.0
        return WheelReading(duration, speeds, self.side_speeds, variance, stamped)
