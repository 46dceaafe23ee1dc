"""Standstill, seen by wheels and inertial unit together, never assumed."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
import math

QUIET = 0.4         # s that the inertial unit must have been quiet
SETTLED = 1.0       # s over which its rate must not have changed to count as its bias
MIN_SAMPLES = 4     # in the quiet time
NOISE_FACTOR = 3.0  # times the unit's own noise counts as quiet
TREND = 2.5         # sigmas between the two halves of a rate that does not change
UNWINDING = 0.1     # of the last rate of turning, right after the wheels have stopped ...
UNWINDING_TIME = 1.5  # s, ... and in which it decays; soft tires on a plant of linear springs
STILL_WHEEL = 0.01  # m/s of wheel surface; less is a count of the encoder

Reading = tuple[float, float, float]  # rate about z [rad/s], specific force x, y [m/s2]


@dataclass(frozen=True, slots=True)
class StationaryInterval:
    """A robot at rest."""

    rate: float      # rad/s, mean of the unit's rate about z
    sigma: float     # rad/s, of that mean, by noise
    unwinding: float  # rad/s, one sigma of a turn that still goes on, the same for a second or so
    duration: float  # s of rest so far
    settled: bool    # whether the rate is steady, too: after a stop the body still turns a little


class ZeroVelocityDetector:
    """
    Tells whether the robot stands: wheels at rest and the inertial unit quiet for a while.

    A robot that is pushed evenly with locked wheels looks the same to the unit; its owner must
    also believe the speed to be small, or wait.
    """

    def __init__(self, gyro_noise: float, accel_noise: float) -> None:
        self._noise = gyro_noise
        self._limits = (NOISE_FACTOR * gyro_noise, *(NOISE_FACTOR * accel_noise,) * 2)
        self._window: deque[tuple[float, Reading]] = deque()
        self._quiet_since: float | None = None
        self._turning: tuple[float, float] | None = None  # last time [s] and rate [rad/s] of it

    def push(self, time: float, reading: Reading) -> None:
        """Take in a reading of the inertial unit at ``time`` [s]."""
        window = self._window
        window.append((time, reading))
        while window[0][0] < time - SETTLED:
            window.popleft()

    def rest(self, time: float, wheel_speed: float) -> StationaryInterval | None:
        """
        Return the rest at ``time`` [s], None if something moves.

        ``wheel_speed`` [m/s] is the fastest wheel's; to be called at each wheel reading.
        """
        if wheel_speed >= STILL_WHEEL or not self._is_quiet():
            self._quiet_since = None
            if wheel_speed >= STILL_WHEEL and self._window:
                self._turning = time, self._turn()
            return None
        if self._quiet_since is None:
            self._quiet_since = time
        duration = time - self._quiet_since
        rates = [reading[0] for _, reading in self._window]
        half = len(rates) // 2
        drift = abs(_mean(rates[half:]) - _mean(rates[:half]))
        settled = duration >= SETTLED - QUIET and (
            drift < TREND * 2.0 * self._noise / math.sqrt(len(rates)))
        return StationaryInterval(_mean(rates), self._noise / math.sqrt(len(rates)),
                                  self._unwinding(time), duration, settled)

    def _turn(self) -> float:
        """Return the fastest rate [rad/s] of late, of which tires may still be wound up."""
        latest = abs(_mean([reading[0] for _, reading in self._window]))
        if self._turning is None:
            return latest
        time, rate = self._turning
        return max(latest, rate * math.exp((time - self._window[-1][0]) / SETTLED))

    def _unwinding(self, time: float) -> float:
        """
        Return one sigma [rad/s] of the rate at which a robot that stopped still turns.

        Tires that were twisted in a turn unwind after the wheels have stopped: the unit is quiet
        and its rate small, but it is no bias yet.
        """
        if self._turning is None:
            return 0.0
        since, rate = self._turning
        return UNWINDING * rate * math.exp((since - time) / UNWINDING_TIME)

    def _is_quiet(self) -> bool:
        newest = self._window[-1][0] if self._window else 0.0
        recent = [reading for time, reading in self._window if time >= newest - QUIET]
        if len(recent) < MIN_SAMPLES or newest - self._window[0][0] < 0.75 * QUIET:
            return False
        return all(_spread(column) < limit
                   for column, limit in zip(zip(*recent), self._limits))


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _spread(values: Sequence[float]) -> float:
    mean = _mean(values)
    return math.sqrt(sum((value - mean) ** 2 for value in values) / len(values))
