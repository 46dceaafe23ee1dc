# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Simulated scenarios of the friction benchmark, with films in both front wheels.

The gains of the simulated robot differ from those of the estimators by their tolerance. Surfaces
and drives of ``SURFACE_SCENARIOS`` are those of the slip benchmark and some more. The grounds of
``GROUND_SCENARIOS`` are those of ``benchmarks.grounds``, which the estimators do not know: their
C_x is that of concrete. There every ground lasts for 15 revolutions of each wheel or more.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from benchmarks.grounds import CONCRETE, GRAVEL, ground, HEAVY_SURFACES, SAND, WET_TILES
from benchmarks.scenarios import by_name, Leg, SAND as PLAIN_SAND, Scenario, scenario, SCENARIOS
from smart_tire.parameters import RobotParams
from smart_tire.parameters.robot import FilmParams, MotorParams, TireParams
from smart_tire.parameters.simulation import (
    DriveParams, GroundParams, PatchParams, RadioParams, SensorErrorParams)

FILM = FilmParams(wheels=('front_right', 'front_left'))
REAR_FILM = FilmParams(wheels=('rear_left',))
EIGHT_DURATION = 90.0     # s, half of the figure-eight
NOISY_SIGMA = 0.02        # V, film noise of the noisy run
NOISY_BATCH_LOSS = 0.075  # share of batches

# Half of a circle each: five wheel revolutions on each surface.
HALVES = GroundParams(
    names=('concrete', 'slippery'), friction=(0.47, 0.20), stiffness=(52.7, 52.7),
    drag=(0.015, 0.015), base='concrete',
    patches=(PatchParams(name='half', surface='slippery', x=(-50.0, 50.0), y=(0.9, 50.0)),))
TOUR_FIELDS = (SAND, 6.6, 12.9), (GRAVEL, 12.9, 19.7), (WET_TILES, 19.7, 26.5)  # m, along x
TO_GRAVEL = ground(CONCRETE, fields=[(GRAVEL, 10.0, 100.0)])

HEAVY = RobotParams(
    mass=30.0, wheel_radius=0.15, track_width=0.6, wheelbase=0.5, yaw_inertia=2.2,
    center_of_mass=(0.0, 0.0, 0.05),
    motor=MotorParams(torque_constant=3.0, coulomb_friction=0.4, inertia=0.04))
HEAVY_TIRE = TireParams(contact_length=0.08, longitudinal_stiffness=HEAVY_SURFACES[CONCRETE][1])
HEAVY_DRIVE = DriveParams(stall_torque=15.0)

TORQUE_RATIO = 1.08              # true torque constants over nominal ones
CALIBRATED_TORQUE_SIGMA = 0.02   # relative, after smart_tire identify motor
CALIBRATED = RobotParams(motor=MotorParams(torque_constant_sigma=CALIBRATED_TORQUE_SIGMA))
BUMPS = {  # other bumps before and after the contact than the film model has
    'bumps_far': ('wide bumps farther away', SensorErrorParams(
        bumps=(0.12, 0.18), bump_distance=(0.015, 0.013), bump_width=(0.013, 0.011),
        bump_shape='gaussian')),
    'bumps_skewed': ('asymmetric bumps', SensorErrorParams(
        bump_distance=(0.008, 0.012), bump_width=(0.007, 0.012), bump_shape='asymmetric')),
    'release_mixed': ('release between fig8 and state', SensorErrorParams(release_share=0.3))}

CURVE: Leg = (40.0, 60.0, 80.0)
CRUISE: Leg = (40.0, 90.0, 90.0)
BRAKING = (*((1.2, 140.0, 140.0), (1.2, 50.0, 50.0)) * 5, (1.0, 0.0, 0.0),
           *((1.2, -140.0, -140.0), (1.2, -50.0, -50.0)) * 5, (1.0, 0.0, 0.0))
STARTS = ((3.0, 90.0, 90.0), (0.8, 0.0, 0.0), (3.0, 70.0, 70.0), (0.8, 0.0, 0.0)) * 4


def s_curves(count: int, fast: float, slow: float, period: float) -> tuple[Leg, ...]:
    """
    Return ``count`` double curves that keep the mean heading.

    Each one turns right, left for half of ``period`` [s], and right; speeds of the sides in rpm.
    """
    quarter = 0.25 * period
    return ((quarter, fast, slow), (2.0 * quarter, slow, fast), (quarter, fast, slow)) * count


def _new(name: str, title: str, *parts: Leg, film: FilmParams = FILM, **properties: Any
         ) -> Scenario:
    return scenario(name, title, *parts, film=film, gain_error=film.stretch_gain_tolerance,
                    **properties)


def _of(base: str, *, film: FilmParams = FILM, **changes: Any) -> Scenario:
    """Return a scenario of the slip benchmark with films and ``changes``."""
    return replace(SCENARIOS[base], film=film, gain_error=film.stretch_gain_tolerance, **changes)


def _half_eight(**changes: Any) -> Scenario:
    legs = tuple(leg for leg in SCENARIOS['figure_eight'].legs if leg[0] < EIGHT_DURATION)
    return _of('figure_eight', legs=legs, duration=EIGHT_DURATION, **changes)


SURFACE_SCENARIOS = by_name(
    _of('concrete'),
    _new('curve', 'concrete, 60/80 rpm', CURVE),
    _of('sweep_60'),
    _of('mu_jumps'),
    _new('mu_jumps_fast', 'mu jumps .47/.20, 30/90 rpm', (50.0, 30.0, 90.0), ground=HALVES),
    _of('figure_eight'),
    _half_eight(name='noisy', title='20 mV, 7.5 % lost, 4 Hz', wheel_rate=4.0,
                film=replace(FILM, noise=NOISY_SIGMA), radio=RadioParams(loss=NOISY_BATCH_LOSS)),
    _of('sand', title='sand, 120/60 rpm, C_x of concrete'),
    _of('sand', name='sand_given', title='sand, 120/60 rpm, C_x given', tire=TireParams(
        longitudinal_stiffness=PLAIN_SAND.stiffness[PLAIN_SAND.names.index('sand')])),
    _new('cruise', 'straight, 90 rpm', CRUISE),
    _new('cruise_sand', 'straight on sand, 90 rpm', CRUISE, ground=PLAIN_SAND),
    _new('braking', 'straight, drive and brake', *BRAKING))
GROUND_SCENARIOS = by_name(
    _new('tour', 'concrete, sand, gravel, wet tiles, concrete', *s_curves(9, 120.0, 70.0, 6.0),
         ground=ground(CONCRETE, fields=TOUR_FIELDS)),
    _half_eight(name='gravel_eight', title='figure-eight on gravel', ground=ground(GRAVEL)),
    _of('concrete', name='sand_turn', title='sand, 120/60 rpm, drag .11', ground=ground(SAND)),
    _new('sand_straight', 'straight on sand, starts and stops', *STARTS, ground=ground(SAND)),
    _new('concrete_straight', 'straight on concrete, 90 and 70 rpm', (18.0, 90.0, 90.0),
         (1.0, 0.0, 0.0), (14.0, 70.0, 70.0), ground=ground(CONCRETE)),
    _new('center_of_mass', 'center of mass off by 20 and -10 mm', *s_curves(6, 120.0, 70.0, 6.0),
         ground=ground(CONCRETE), center_of_mass_error=(0.020, -0.010)),
    _new('torque_constant', 'torque constants 8 % off', *s_curves(6, 120.0, 70.0, 6.0),
         ground=TO_GRAVEL, torque_ratio=TORQUE_RATIO,
         errors=SensorErrorParams(torque_constant=0.0)),
    _new('torque_calibrated', 'torque constants identified', *s_curves(6, 120.0, 70.0, 6.0),
         ground=TO_GRAVEL, platform=CALIBRATED,
         errors=SensorErrorParams(torque_constant=CALIBRATED_TORQUE_SIGMA)),
    *(_new(name, f'60/80 rpm, {title}', (30.0, 60.0, 80.0), ground=ground(CONCRETE),
           errors=errors) for name, (title, errors) in BUMPS.items()),
    _new('heavy', '30 kg, rear film, concrete and sand', *s_curves(5, 80.0, 50.0, 8.0),
         ground=ground(CONCRETE, HEAVY_SURFACES, [(SAND, 14.0, 100.0)]), film=REAR_FILM,
         platform=HEAVY, tire=HEAVY_TIRE, drive=HEAVY_DRIVE))
