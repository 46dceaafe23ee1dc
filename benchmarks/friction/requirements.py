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

"""Required figures of friction, stiffness and motion; infinite if there is no requirement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math

from benchmarks.friction.force_results import ALL_GROUNDS, PartKey
from benchmarks.friction.forces import NO_TORQUE, TORQUE, VARIANTS
from benchmarks.grounds import CONCRETE, GRAVEL, SAND, WET_TILES


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of the figures of one run or of one of its grounds, with one variant of inputs."""

    mu_median: float = math.inf   # relative, fused
    mu_90: float = math.inf       # relative, fused
    stiffness: float = math.inf   # relative, median of C_x
    sliding: float = math.inf     # relative, median of the sliding share of the patch
    speed_y: float = math.inf     # m/s, rms
    slip_left: float = math.inf   # -, rms in steady intervals
    slip_right: float = math.inf
    common_slip: float = math.inf     # -, rms while cruising straight
    jump_revolutions: float = math.inf  # until within 10 % after a change


MIN_WITHIN_TWO = 0.88           # share within two sigma, each run
POOLED_WITHIN_TWO = 0.90, 0.99  # all runs together
POOLED_NEES = 0.4, 1.6

_TORQUE = Limits(mu_median=0.05, mu_90=0.12, stiffness=0.06)
_TORQUE_SAND = Limits(mu_median=0.08, mu_90=0.15, stiffness=0.10)
_NO_TORQUE = Limits(mu_median=0.10, mu_90=0.25)  # crossings after 5 s with a turn, start or stop
_STRAIGHT = Limits(common_slip=0.005)            # with torque


def _both(with_torque: Limits, **changes: float) -> dict[str, Limits]:
    """Return the limits of a run of both variants; ``changes`` apply to both."""
    return {NO_TORQUE: replace(_NO_TORQUE, **changes), TORQUE: replace(with_torque, **changes)}


def _same(limits: Limits) -> dict[str, Limits]:
    return dict.fromkeys(VARIANTS, limits)


REQUIREMENTS: Mapping[PartKey, Mapping[str, Limits]] = {
    **{('tour', ground): _both(_TORQUE) for ground in (CONCRETE, GRAVEL, WET_TILES)},
    ('tour', SAND): _both(_TORQUE_SAND),
    ('gravel_eight', ALL_GROUNDS): _both(_TORQUE),
    ('sand_turn', ALL_GROUNDS): _both(_TORQUE_SAND),
    ('sand_straight', ALL_GROUNDS): {
        NO_TORQUE: _NO_TORQUE, TORQUE: replace(_TORQUE_SAND, common_slip=0.005)},
    ('concrete_straight', ALL_GROUNDS): {TORQUE: _STRAIGHT},
    ('center_of_mass', ALL_GROUNDS): _both(_TORQUE),
    **{('torque_calibrated', ground): {TORQUE: _TORQUE} for ground in (CONCRETE, GRAVEL)},
    **{(run, ALL_GROUNDS): _both(_TORQUE, sliding=0.015)
       for run in ('bumps_far', 'bumps_skewed', 'release_mixed')},
    ('heavy', CONCRETE): _both(_TORQUE), ('heavy', SAND): _both(_TORQUE_SAND),
    # the same with both variants
    ('mu_jumps', ALL_GROUNDS): _same(
        Limits(mu_median=0.05, speed_y=0.004, jump_revolutions=3.0)),
    ('curve', ALL_GROUNDS): _same(
        Limits(mu_median=0.04, slip_left=0.009, slip_right=0.007)),
    ('sweep_60', ALL_GROUNDS): _same(
        Limits(mu_median=0.015, slip_left=0.011, slip_right=0.007)),
    ('figure_eight', ALL_GROUNDS): _same(
        Limits(mu_median=0.015, slip_left=0.006, slip_right=0.006)),
    ('cruise', ALL_GROUNDS): {TORQUE: _STRAIGHT},
    ('cruise_sand', ALL_GROUNDS): {TORQUE: _STRAIGHT},
}


def limits_of(run: str, ground: str, variant: str) -> Limits:
    """Return the limits of a row; infinite ones if nothing is required."""
    return REQUIREMENTS.get((run, ground), {}).get(variant, Limits())
