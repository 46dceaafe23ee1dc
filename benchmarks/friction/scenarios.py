"""
The simulated runs by which friction is judged: films in both front wheels.

The robot that is simulated has gains that are off by their tolerance, as its estimators' are.
Grounds and drives are those of ``scenarios``, with two more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from benchmarks.scenarios import SAND, Scenario, SCENARIOS, sequence
from smart_tire.parameters.robot import FilmParams, TireParams
from smart_tire.parameters.simulation import GroundParams, RadioParams

INSTRUMENTED = ('front_right', 'front_left')  # the published runs had the first only
FILM = FilmParams(wheels=INSTRUMENTED)
NOISE = 0.02   # V, of the noisy run
LOSS = 0.075   # of the batches, in it
RATE = 4.0     # Hz, of its wheels
HALF = 90.0    # s, of the figure-eight: enough for it

# half of a circle each, so that a wheel turns five times on each ground
HALVES = GroundParams(
    names=('concrete', 'slippery'), friction=(0.47, 0.20), stiffness=(52.7, 52.7),
    drag=(0.015, 0.015), base='concrete', patches=('slippery=-50,0.9,50,50',))


def _of(base: str, *, film: FilmParams = FILM, **changes: Any) -> Scenario:
    """Return a scenario of those for slip with films, and with ``changes``."""
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
            legs=tuple(leg for leg in SCENARIOS['figure_eight'].legs if leg[0] < HALF),
            duration=HALF, film=replace(FILM, noise=NOISE), wheel_rate=RATE,
            radio=RadioParams(loss=LOSS)),
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
