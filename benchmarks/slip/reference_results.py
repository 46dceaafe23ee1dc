"""
What a reference filter reached on such runs: the published targets of the project.

They rest on the same kinds of runs and sensor errors, not on the same random numbers. Its wheel
speeds are smoothed with a lag of 0.13 s. Slips are rms errors of the two sides in the steady
parts, on the straight run at all times against the truth averaged over 125 ms. Its force balance
takes C_x 52.7 N and mu 0.47 for granted: right on concrete, wrong on sand and in the mu jumps.
"""

from __future__ import annotations

from dataclasses import dataclass
import math


@dataclass(frozen=True)
class Published:
    """Errors of one filter on one run."""

    left: float   # -, rms error of the slip
    right: float
    speed: float = math.nan    # m/s, rms error of the forward speed
    end: float = math.nan      # m, position error at the end
    heading_end: float = math.nan  # degrees


@dataclass(frozen=True)
class Target:
    """What was reached on one run."""

    no_slip: Published   # slip 0 assumed
    plain: Published     # IMU + wheels + constraints
    balance: Published   # with force balance


TITLES = {'plain': 'published: with constraints', 'balance': 'published: force balance'}

_SWEEP = Target(Published(.114, .096), Published(.024, .023, .012), Published(.010, .008, .0024))

TARGETS = {
    'concrete': Target(
        Published(.111, .108), Published(.007, .013, .006), Published(.005, .009, .0033)),
    'sand': Target(
        Published(.285, .081), Published(.010, .019, .010), Published(.005, .008, .004)),
    'sweep_60': _SWEEP,
    'mu_jumps': Target(
        Published(.063, .072), Published(.029, .021, .010), Published(.016, .012, .0044)),
    'figure_eight': Target(
        Published(.076, .074), Published(.016, .016, .010, 0.18, 1.5),
        Published(.006, .006, .0036, 0.10, 0.7)),
    'degraded': Target(
        Published(.073, .074), Published(.018, .017, .010), Published(.006, .006, .0056)),
    'straight': Target(
        Published(.109, .110), Published(.041, .042, .012), Published(.035, .037, .0095)),
    'spin_reverse': Target(
        Published(.202, .182), Published(.019, .019, .010), Published(.013, .013, .007)),
}
