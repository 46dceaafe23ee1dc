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
Simulated scenarios of the friction benchmark, with films in both front wheels.

The gains of the simulated robot differ from those of the estimators by their tolerance. Surfaces
and drives are those of the slip benchmark and some more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from benchmarks.scenarios import SAND, Scenario, SCENARIOS, sequence
from smart_tire.parameters.robot import FilmParams, TireParams
from smart_tire.parameters.simulation import GroundParams, PatchParams, RadioParams

INSTRUMENTED = ('front_right', 'front_left')  # the reference runs have the first only
FILM = FilmParams(wheels=INSTRUMENTED)
NOISY_SIGMA = 0.02      # V, film noise of the noisy run
NOISY_BATCH_LOSS = 0.075  # share of batches
NOISY_WHEEL_RATE = 4.0  # Hz
NOISY_DURATION = 90.0   # s, half of the figure-eight

# Half of a circle each: five wheel revolutions on each surface.
HALVES = GroundParams(
    names=('concrete', 'slippery'), friction=(0.47, 0.20), stiffness=(52.7, 52.7),
    drag=(0.015, 0.015), base='concrete',
    patches=(PatchParams(name='half', surface='slippery', x=(-50.0, 50.0), y=(0.9, 50.0)),))


def _of(base: str, *, film: FilmParams = FILM, **changes: Any) -> Scenario:
    """Return a scenario of the slip benchmark with films and ``changes``."""
    return replace(SCENARIOS[base], film=film, gain_error=film.stretch_gain_tolerance, **changes)


def _all() -> tuple[Scenario, ...]:
    curve, curve_end = sequence((40.0, 60.0, 80.0))
    tight, tight_end = sequence((50.0, 30.0, 90.0))
    cruise, cruise_end = sequence((40.0, 90.0, 90.0))
    pulses = (1.2, 140.0, 140.0), (1.2, 50.0, 50.0)
    back = (1.2, -140.0, -140.0), (1.2, -50.0, -50.0)
    rest = 1.0, 0.0, 0.0
    braking, braking_end = sequence(*pulses * 5, rest, *back * 5, rest)
    sand = SCENARIOS['sand'].title
    return (
        _of('concrete'),
        _of('concrete', name='curve', title='concrete, 60/80 rpm', legs=curve,
            duration=curve_end),
        _of('sweep_60'),
        _of('mu_jumps'),
        _of('concrete', name='mu_jumps_fast', title='mu jumps .47/.20, 30/90 rpm', legs=tight,
            duration=tight_end, ground=HALVES),
        _of('figure_eight'),
        _of('figure_eight', name='noisy', title='20 mV, 7.5 % lost, 4 Hz',
            legs=tuple(leg for leg in SCENARIOS['figure_eight'].legs if leg[0] < NOISY_DURATION),
            duration=NOISY_DURATION, film=replace(FILM, noise=NOISY_SIGMA),
            wheel_rate=NOISY_WHEEL_RATE, radio=RadioParams(loss=NOISY_BATCH_LOSS)),
        _of('sand', title=f'{sand}, C_x of concrete'),
        _of('sand', name='sand_given', title=f'{sand}, C_x given',
            tire=TireParams(longitudinal_stiffness=_stiffness(SAND))),
        _of('concrete', name='cruise', title='straight, 90 rpm', legs=cruise,
            duration=cruise_end),
        _of('sand', name='cruise_sand', title='straight on sand, 90 rpm', legs=cruise,
            duration=cruise_end),
        _of('concrete', name='braking', title='straight, drive and brake', legs=braking,
            duration=braking_end))


def _stiffness(ground: GroundParams) -> float:
    return ground.stiffness[ground.names.index(ground.base)]


FRICTION_SCENARIOS: Mapping[str, Scenario] = {scenario.name: scenario for scenario in _all()}
