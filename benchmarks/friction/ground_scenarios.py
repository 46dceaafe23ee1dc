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

"""
Simulated scenarios on several grounds, which are unknown to the estimators.

Their C_x is that of concrete. Surfaces are those of ``benchmarks.grounds``; every ground lasts for
15 revolutions of each wheel or more. Where not stated otherwise both front wheels have films.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from benchmarks.grounds import CONCRETE, GRAVEL, ground, HEAVY_SURFACES, SAND, WET_TILES
from benchmarks.scenarios import Leg, Scenario, SCENARIOS, sequence
from smart_tire.parameters import RobotParams
from smart_tire.parameters.robot import FilmParams, MotorParams, TireParams
from smart_tire.parameters.simulation import DriveParams, SensorErrorParams

FILM = FilmParams(wheels=('front_right', 'front_left'))
REAR_FILM = FilmParams(wheels=('rear_left',))
EIGHT_DURATION = 90.0  # s, half of the figure-eight

TOUR_FIELDS = (SAND, 6.6, 12.9), (GRAVEL, 12.9, 19.7), (WET_TILES, 19.7, 26.5)  # m, along x
GRAVEL_FIELD = GRAVEL, 10.0, 100.0
HEAVY_SAND = SAND, 14.0, 100.0

HEAVY = RobotParams(
    mass=30.0, wheel_radius=0.15, track_width=0.6, wheelbase=0.5, yaw_inertia=2.2,
    center_of_mass=(0.0, 0.0, 0.05),
    motor=MotorParams(torque_constant=3.0, coulomb_friction=0.4, inertia=0.04))
HEAVY_TIRE = TireParams(contact_length=0.08, longitudinal_stiffness=HEAVY_SURFACES[CONCRETE][1])
HEAVY_DRIVE = DriveParams(stall_torque=15.0)

TORQUE_RATIO = 1.08              # true torque constants over nominal ones
UNIFORM_TORQUE_SIGMA = 0.0       # of the torque constants common to all motors, besides the ratio
CALIBRATED_TORQUE_SIGMA = 0.02   # relative, after smart_tire identify motor
CALIBRATED = RobotParams(motor=MotorParams(torque_constant_sigma=CALIBRATED_TORQUE_SIGMA))
BUMPS = {  # other bumps before and after the contact than the film model has
    'bumps_far': ('wide bumps farther away', SensorErrorParams(
        bumps=(0.12, 0.18), bump_distance=(0.015, 0.013), bump_width=(0.013, 0.011),
        bump_shape='gaussian')),
    'bumps_skewed': ('asymmetric bumps', SensorErrorParams(
        bump_distance=(0.008, 0.012), bump_width=(0.007, 0.012), bump_shape='asymmetric')),
    'release_mixed': ('release between fig8 and state', SensorErrorParams(release_share=0.3))}


def s_curves(count: int, fast: float, slow: float, period: float) -> tuple[tuple[Leg, ...], float]:
    """
    Return legs of ``count`` double curves that keep the mean heading, and the end time [s].

    Each one turns right, left for half of ``period`` [s], and right; speeds of the sides in rpm.
    """
    right, left = (fast, slow), (slow, fast)
    quarter = 0.25 * period
    return sequence(*((quarter, *right), (2.0 * quarter, *left), (quarter, *right)) * count)


def _all() -> tuple[Scenario, ...]:
    tour, tour_end = s_curves(9, 120.0, 70.0, 6.0)
    short, short_end = s_curves(6, 120.0, 70.0, 6.0)
    heavy, heavy_end = s_curves(5, 80.0, 50.0, 8.0)
    turn = SCENARIOS['concrete']
    curve, curve_end = sequence((30.0, 60.0, 80.0))
    starts, starts_end = sequence(*((3.0, 90.0, 90.0), (0.8, 0.0, 0.0),
                                    (3.0, 70.0, 70.0), (0.8, 0.0, 0.0)) * 4)
    straight, straight_end = sequence((18.0, 90.0, 90.0), (1.0, 0.0, 0.0), (14.0, 70.0, 70.0))
    own = partial(Scenario, film=FILM, gain_error=FILM.stretch_gain_tolerance)
    torque = own(name='torque_constant', title='torque constants 8 % off', legs=short,
                 duration=short_end, ground=ground(CONCRETE, fields=[GRAVEL_FIELD]),
                 torque_ratio=TORQUE_RATIO,
                 errors=SensorErrorParams(torque_constant=UNIFORM_TORQUE_SIGMA))
    return (
        own(name='tour', title='concrete, sand, gravel, wet tiles, concrete', legs=tour,
            duration=tour_end, ground=ground(CONCRETE, fields=TOUR_FIELDS)),
        own(name='gravel_eight', title='figure-eight on gravel',
            legs=tuple(leg for leg in SCENARIOS['figure_eight'].legs if leg[0] < EIGHT_DURATION),
            duration=EIGHT_DURATION, ground=ground(GRAVEL)),
        own(name='sand_turn', title='sand, 120/60 rpm, drag .11', legs=turn.legs,
            duration=turn.duration, ground=ground(SAND)),
        own(name='sand_straight', title='straight on sand, starts and stops', legs=starts,
            duration=starts_end, ground=ground(SAND)),
        own(name='concrete_straight', title='straight on concrete, 90 and 70 rpm', legs=straight,
            duration=straight_end, ground=ground(CONCRETE)),
        own(name='center_of_mass', title='center of mass off by 20 and -10 mm', legs=short,
            duration=short_end, ground=ground(CONCRETE), center_of_mass_error=(0.020, -0.010)),
        torque,
        replace(torque, name='torque_calibrated', title='torque constants identified',
                torque_ratio=1.0, platform=CALIBRATED,
                errors=SensorErrorParams(torque_constant=CALIBRATED_TORQUE_SIGMA)),
        *(own(name=name, title=f'60/80 rpm, {title}', legs=curve, duration=curve_end,
              ground=ground(CONCRETE), errors=errors)
          for name, (title, errors) in BUMPS.items()),
        own(name='heavy', title='30 kg, rear film, concrete and sand', legs=heavy,
            duration=heavy_end, ground=ground(CONCRETE, HEAVY_SURFACES, [HEAVY_SAND]),
            film=REAR_FILM, platform=HEAVY, tire=HEAVY_TIRE, drive=HEAVY_DRIVE))


GROUND_SCENARIOS: Mapping[str, Scenario] = {scenario.name: scenario for scenario in _all()}
