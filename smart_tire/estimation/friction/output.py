# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The ``Friction`` record of a patch crossing, and friction from a single one."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction import constants as c
from smart_tire.estimation.friction.waveform_method import FilmResult, SlipFit
from smart_tire.estimation.ground.estimator import WheelState
from smart_tire.estimation.ground.unknowns import MAX_SIGMA
from smart_tire.models.tire.brush_tire import critical_slip, LN_FRICTION
from smart_tire.samples import Friction, NS_PER_S
from smart_tire.uncertain import Uncertain, UNKNOWN


def friction_record(wheel: str, contact_length: float, crossing: PatchCrossing,
                    result: FilmResult | None, state: WheelState) -> Friction:
    """
    Return the record of ``crossing``, while the wheel was in ``state``.

    There is no friction if the films contradict the state: the ground has just changed.
    """
    if result is not None and _contradicts(result, state):
        state = replace(state, friction=UNKNOWN, critical_slip=UNKNOWN)
    total = _product(state.normalized_slip, state.critical_slip)
    found = {} if result is None else _of_films(result, state, total, contact_length)
    return Friction(
        stamp_of(crossing, result), wheel, slip=state.slip, total_slip=total,
        normal_load=state.load, stiffness=state.stiffness,
        friction_coefficient=state.friction, critical_slip=state.critical_slip,
        traction_force=state.traction_force, **found)


def _contradicts(result: FilmResult, state: WheelState) -> bool:
    """Return whether slip and normalized slip of the films differ from those of the motion."""
    films, slip, normalized = result.slips, state.slip, state.normalized_slip
    if result.sliding or not math.isfinite(slip.value * normalized.value):
        return False
    difference = np.array([films.slip - slip.value, films.normalized_slip - normalized.value])
    covariance = films.covariance + np.diag([slip.sigma ** 2, normalized.sigma ** 2])
    return float(difference @ np.linalg.solve(covariance, difference)) > c.MAX_CONTRADICTION


def stamp_of(crossing: PatchCrossing, result: FilmResult | None) -> int:
    """Return the instant [ns] at which the films are at the patch's middle."""
    shift = 0.0 if result is None else result.shift / crossing.speed
    return crossing.stamp_ns + round(shift * NS_PER_S)


def _of_films(result: FilmResult, state: WheelState, total: Uncertain, contact_length: float
              ) -> dict[str, Uncertain]:
    """Return the quantities that need the films."""
    films, adhesion = result.slips, UNKNOWN
    if films.normalized_slip_sigma < MAX_SIGMA:
        adhesion = Uncertain(min(max(1.0 - films.normalized_slip, 0.0), 1.0),
                             films.normalized_slip_sigma)
    return {'film_slip': Uncertain(films.slip, films.slip_sigma)
            if films.slip_sigma < MAX_SIGMA else UNKNOWN,
            'adhesion_ratio': adhesion,
            'adhesion_length': Uncertain(
                adhesion.value * contact_length, adhesion.sigma * contact_length),
            'stretch_voltage': result.stretch_voltage, 'peak_interval': result.peak_interval,
            'friction_coefficient_single': _single(films, total, state)}


def _single(films: SlipFit, total: Uncertain, state: WheelState) -> Uncertain:
    """
    Return mu from one crossing alone, C_x |s| / (3 F_z t).

    Its normalized slip t is that of the films, given the slip of the motion.
    """
    if not (total.value > 0.0 and state.load.value > 0.0 and state.stiffness.value > 0.0):
        return UNKNOWN
    covariance = films.covariance
    gain = float(covariance[0, 1] / (covariance[0, 0] + state.slip.sigma ** 2))
    normalized = films.normalized_slip + gain * (state.slip.value - films.slip)
    sigma = math.sqrt(max(float(covariance[1, 1]) - gain * float(covariance[0, 1]), 0.0))
    scale = float(critical_slip(1.0, state.load.value, state.stiffness.value)) / total.value
    mu, spread = friction_estimate(scale * normalized, scale * sigma, state.friction.value)
    if not math.isfinite(mu):
        return UNKNOWN
    return Uncertain(mu, math.hypot(spread, *(mu * one.sigma / one.value for one in (
        state.load, state.stiffness, total))))


def friction_estimate(inverse_mu: float, sigma: float, likely: float = math.nan) -> Uncertain:
    """
    Return mu from 1 / mu with its ``sigma``.

    Posterior median and deviation with a log-normal prior, since the reciprocal of a noisy 1 / mu
    would be arbitrarily large. UNKNOWN where the measurement adds little to the prior, on a
    typical surface and on one with friction ``likely``. That decision must not depend on the
    measured value: keeping only the low outcomes of noisy measurements would bias mu low.
    """
    lowest = float(np.fmin(math.exp(LN_FRICTION.value), likely))
    if not sigma < MAX_SIGMA / lowest:
        return UNKNOWN
    # in sigmas, to those whose density is below the rounding error of the largest one
    edge = math.sqrt(-2.0 * math.log(np.finfo(float).eps))
    deviation = np.linspace(-edge, edge, c.POSTERIOR_POINTS)
    inverse = inverse_mu + sigma * deviation
    possible = inverse > 0.0
    grid = 1.0 / inverse[possible]
    # density over 1 / mu: that of ln mu times mu
    weight = grid * np.exp(-0.5 * (((np.log(grid) - LN_FRICTION.value) / LN_FRICTION.sigma)**2
                                   + deviation[possible]**2))
    total = float(weight.sum())
    if not total > 0.0:
        return UNKNOWN
    mu = float(np.interp(0.5 * total, weight.cumsum() - 0.5 * weight, grid))
    return Uncertain(mu, math.sqrt(float(weight @ (grid - mu)**2) / total))


def _product(first: Uncertain, second: Uncertain) -> Uncertain:
    """Return the product of two independent quantities, UNKNOWN if one of them is."""
    if not math.isfinite(first.value * second.value):
        return UNKNOWN
    return Uncertain(first.value * second.value, math.hypot(
        first.value * second.sigma, first.sigma * second.value))
