"""
What a reference estimator reached on such runs: the published targets of the project.

A waveform fit with the slip of a reference filter: two films on one wheel, 400 Hz, 10 bits, 5 mV
noise, bending that varies by 15 % from cycle to cycle, gains known to 3 %, total slip from the
filter. It knew the film's angle and the wheel's speed exactly. The same kinds of runs, not the
same random numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
import math


@dataclass(frozen=True)
class Published:
    """Relative errors of mu, median and 90 % of their sizes, with the slip of a filter."""

    single: float        # from one revolution
    single_90: float     # NaN where it is not given
    fused: float
    fused_90: float
    revolutions: float   # until the fused value was within 10 %, the most of them


PUBLISHED = {
    'concrete': Published(.017, .05, .018, .022, 1),
    'curve': Published(.11, .25, .017, .11, 4),
    'sweep_60': Published(.06, .20, .011, .027, 1),
    'mu_jumps': Published(.09, .26, .04, .13, 4),
    'figure_eight': Published(.05, math.nan, .013, .022, 3),
    'noisy': Published(.09, math.nan, .034, .12, 12),
}

# Relative, slip -> least sigma of one revolution: two films, 60 rpm, 5 mV, mu 0.47.
PUBLISHED_BOUNDS = {0.05: 0.067, 0.10: 0.018, 0.15: 0.009}
PRINTED_EXCESS = (1.2, 1.9)  # of mu by the paper's two peaks and printed map, on the same data
