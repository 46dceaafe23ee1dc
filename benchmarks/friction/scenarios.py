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
and drives are those of the slip benchmark and some more.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from benchmarks.scenarios import by_name, Leg, SAND, Scenario, scenario, SCENARIOS
from smart_tire.parameters.robot import TireParams, TreadFilmParams
from smart_tire.parameters.simulation import PatchParams, RadioParams, SurfaceParams

FILM = TreadFilmParams(wheels=('front_right', 'front_left'))
EIGHT_DURATION = 90.0     # s, half of the figure-eight
NOISY_SIGMA = 0.02        # V, film noise of the noisy run
NOISY_BATCH_LOSS = 0.075  # share of batches

# Half of a circle each: five wheel revolutions on each surface.
HALVES = SurfaceParams(
    names=('concrete', 'slippery'), friction=(0.47, 0.20), stiffness=(52.7, 52.7),
    drag=(0.015, 0.015), base='concrete',
    patches=(PatchParams(name='half', surface='slippery', x=(-50.0, 50.0), y=(0.9, 50.0)),))
CURVE: Leg = (40.0, 60.0, 80.0)
CRUISE: Leg = (40.0, 90.0, 90.0)
BRAKING = (*((1.2, 140.0, 140.0), (1.2, 50.0, 50.0)) * 5, (1.0, 0.0, 0.0),
           *((1.2, -140.0, -140.0), (1.2, -50.0, -50.0)) * 5, (1.0, 0.0, 0.0))


def _new(name: str, title: str, *parts: Leg, **properties: Any) -> Scenario:
    return scenario(name, title, *parts, film=FILM, gain_error=FILM.stretch_gain_tolerance,
                    **properties)


def _of(base: str, *, film: TreadFilmParams = FILM, **changes: Any) -> Scenario:
    """Return a scenario of the slip benchmark with films and ``changes``."""
    return replace(SCENARIOS[base], film=film, gain_error=film.stretch_gain_tolerance, **changes)


FRICTION_SCENARIOS = by_name(
    _of('concrete'),
    _new('curve', 'concrete, 60/80 rpm', CURVE),
    _of('sweep_60'),
    _of('mu_jumps'),
    _new('mu_jumps_fast', 'mu jumps .47/.20, 30/90 rpm', (50.0, 30.0, 90.0), ground=HALVES),
    _of('figure_eight'),
    _of('figure_eight', name='noisy', title='20 mV, 7.5 % lost, 4 Hz', wheel_rate=4.0,
        legs=tuple(leg for leg in SCENARIOS['figure_eight'].legs if leg[0] < EIGHT_DURATION),
        duration=EIGHT_DURATION, film=replace(FILM, noise=NOISY_SIGMA),
        radio=RadioParams(loss=NOISY_BATCH_LOSS)),
    _of('sand', title='sand, 120/60 rpm, C_x of concrete'),
    _of('sand', name='sand_given', title='sand, 120/60 rpm, C_x given', tire=TireParams(
        longitudinal_stiffness=SAND.stiffness[SAND.names.index('sand')])),
    _new('cruise', 'straight, 90 rpm', CRUISE),
    _new('cruise_sand', 'straight on sand, 90 rpm', CRUISE, ground=SAND),
    _new('braking', 'straight, drive and brake', *BRAKING))
