# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Cases of synthesized crossings: slip, surface, speed and noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import Any

from smart_tire.models.tire import brush_tire
from smart_tire.parameters import RobotParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.parameters.simulation import SensorErrorParams
from smart_tire.samples import GRAVITY

RPM = math.tau / 60.0  # rad/s
WHEEL = 'front_right'  # instrumented wheel
ROBOT = RobotParams()  # paper B's Table I
ERRORS = SensorErrorParams()  # variation of bending and bumps as in the simulator
LOAD = 0.25 * ROBOT.mass * GRAVITY  # N, F_z of every wheel

SLIPS = (0.02, 0.03, 0.05, 0.1, 0.15, 0.2, 0.3)
COARSE_SLIPS = (0.05, 0.1, 0.2)  # for cases that vary another quantity
FASTER_SPEED = 80.0             # rpm; paper B uses 60 and 80
EXTREME_SPEEDS = (15.0, 120.0, 200.0)
NOISES = (0.002, 0.010, 0.020)  # V, in addition to the nominal one
FRICTIONS = (0.1, 0.2, 0.9)     # -, in addition to concrete
CONCRETE_FRICTION = 0.47        # -, paper B, Table I

SMALL_SLIPS = (0.05, 0.07)      # where the shape outside the contact matters most
# shapes that differ from those of the estimator's model: values of a case
OTHER_SHAPES: dict[str, dict[str, Any]] = {
    'Gaussian bumps at 6 mm, 14 mm wide': {
        'bump_shape': 'gaussian', 'bump_distance': (0.006, 0.006), 'bump_width': (0.014, 0.014)},
    'Gaussian bumps at 16 mm, 5 mm wide': {
        'bump_shape': 'gaussian', 'bump_distance': (0.016, 0.016), 'bump_width': (0.005, 0.005)},
    'asymmetric bumps at 13 and 8 mm': {
        'bump_shape': 'asymmetric', 'bump_distance': (0.013, 0.008),
        'bump_width': (0.012, 0.007)},
    'exponential bumps at 7 and 9 mm': {
        'bump_shape': 'exponential', 'bump_distance': (0.007, 0.009),
        'bump_width': (0.011, 0.008)},
    'release fig8 with a share of 0.3 of state': {'release_share': 0.3}}


@dataclass(frozen=True, kw_only=True)
class Case:
    """Parameters of random crossings."""

    slip: float              # -, B(3)'s lambda
    mu: float = CONCRETE_FRICTION
    rpm: float = 60.0
    noise: float = 0.005     # V, standard deviation of a sample
    combined: float = 1.0    # total slip over longitudinal slip
    release: str = 'fig8'
    release_share: float = 0.0  # share of the other release in the signal
    bump_distance: tuple[float, ...] = ERRORS.bump_distance  # m, before and after the contact
    bump_width: tuple[float, ...] = ERRORS.bump_width  # m, full width at half height
    bump_shape: str = ERRORS.bump_shape

    @property
    def robot(self) -> RobotParams:
        """Return the robot with films on one wheel."""
        return replace(ROBOT, film=TreadFilmParams(
            wheels=(WHEEL,), noise=self.noise, release=self.release))

    @property
    def speed(self) -> float:
        """Return |r w| [m/s]."""
        return self.rpm * RPM * ROBOT.wheel_radius

    @property
    def total_slip(self) -> float:
        """Return the magnitude of the combined slip."""
        return self.combined * abs(self.slip)

    @property
    def critical_slip(self) -> float:
        """Return the total slip above which the whole patch slides."""
        return float(brush_tire.critical_slip(
            self.mu, LOAD, ROBOT.tire.longitudinal_stiffness))

    @property
    def normalized_slip(self) -> float:
        """Return total slip / critical slip."""
        return self.total_slip / self.critical_slip


def all_cases() -> dict[str, list[Case]]:
    """Return the cases by the quantity that they vary."""
    signed, few = ([sign * slip for slip in slips for sign in (1.0, -1.0)]
                   for slips in (SLIPS, COARSE_SLIPS))
    return {
        'slip': [Case(slip=slip) for slip in signed],
        'slip, faster': [Case(slip=slip, rpm=FASTER_SPEED) for slip in (*few, 0.3)],
        'noise': [Case(slip=slip, noise=noise) for noise in NOISES for slip in COARSE_SLIPS],
        'noise, braking': [Case(slip=-slip, noise=max(NOISES)) for slip in COARSE_SLIPS],
        'friction': [Case(slip=slip, mu=mu) for mu in FRICTIONS for slip in few],
        'combined slip: total slip 1.3 times longitudinal slip': [
            Case(slip=slip, combined=1.3) for slip in few],
        'speed': [Case(slip=0.1, rpm=rpm) for rpm in EXTREME_SPEEDS],
        **{title: [Case(slip=sign * slip, **values)
                   for slip in SMALL_SLIPS for sign in (1.0, -1.0)]
           for title, values in OTHER_SHAPES.items()},
        'release as a state': [Case(slip=slip, release='state') for slip in (0.1, -0.1)]}


def quick_cases() -> dict[str, list[Case]]:
    """Return a subset of the cases."""
    return {'slip': [Case(slip=slip) for slip in (0.03, 0.05, 0.1, 0.3, -0.1)],
            'noise': [Case(slip=0.1, noise=0.020)],
            'friction': [Case(slip=0.1, mu=mu) for mu in (0.1, 0.9)]}
