"""
Gains of the films, contact length, and where the films sit, out of the passages of recordings.

The slip comes from the slip estimator and never from the films, and gains are in proportion to it:
its error is what limits them. Contact length and spacing are as true as the rulers are by which
ways are measured: the wheel radius to its ``wheel_radius_sigma``, and the films' length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.film.adjustment import Adjustment, combine
from smart_tire.calibration.film.crossing_collector import CrossingWithSlip
from smart_tire.calibration.film.observations import EvidenceReader, GainObservation
from smart_tire.calibration.film.results import (
    apart, bendings, FEWEST, Found, GainFit, LEAST_SLIP, middle, Results, SIGNIFICANT, WORST_PLACE)
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams


MOST_ROUNDS = 5      # of fits, each with what the one before found
SETTLED = 0.3        # standard errors, below which the next one changes nothing
LARGEST_CHANGE = 3.0, 1.3  # factor of gains and contact length in one round


def identify_gains(runs: Sequence[Sequence[CrossingWithSlip]], robot: RobotParams) -> GainFit:
    """
    Return what the passages of one or more recordings tell together.

    Raises EstimatorError where there are none that can be understood.
    """
    robot = _unfolded(robot)
    told, run, found = _settle(runs, robot)
    fit = GainFit(found.robot, passages=len(told), telling=sum(one.gains for one in told),
                  manoeuvres=found.result.manoeuvres, excess=found.result.spread)
    Results(fit, told, run, found).fill()
    return fit


def _unfolded(robot: RobotParams) -> RobotParams:
    """Return ``robot`` with a value for each film of each wheel."""
    film = robot.film
    gains, bending = ([value for wheel in film.wheels for value in values(wheel)]
                      for values in (film.gains, film.bending))
    return replace(robot, film=replace(film, stretch_gain=tuple(gains),
                                       bending_peak=tuple(bending)))


def _settle(runs: Sequence[Sequence[CrossingWithSlip]],
            robot: RobotParams) -> tuple[list[GainObservation], list[int], Found]:
    """Fit all passages until what they have in common stays the same."""
    groups, near = robot.film_groups, False
    for _ in range(MOST_ROUNDS):
        reader = EvidenceReader(robot, near=near)
        read = [(one, i) for i, passages in enumerate(runs) for known in passages
                if (one := reader.read(known, gains=_tells(known))) is not None]
        told, run = [one for one, _ in read], [i for _, i in read]
        if len(told) < FEWEST:
            raise EstimatorError(
                f'{len(told)} passages of films that could be fitted, of '
                f'{sum(map(len, runs))} with known slip; expected at least {FEWEST}')
        result = combine(told, run, robot)
        found = Found(robot, groups, reader, result)
        moved = result.value / np.sqrt(np.diag(result.covariance))
        robot = _moved(found, told)
        if near and np.max(np.abs(moved[:result.layout.radius])) < SETTLED:
            break
        near = bool(np.all(_factors(result) > 0.0))  # of films the right way round
    return told, run, found


def _tells(known: CrossingWithSlip) -> bool:
    slip, sigma = known.slip
    return abs(slip) > max(LEAST_SLIP, SIGNIFICANT * sigma)


def _moved(found: Found, told: Sequence[GainObservation]) -> RobotParams:
    """Return the robot with what was found, as far as it can be."""
    robot, result = found.robot, found.result
    film, layout = robot.film, result.layout
    most, longest = LARGEST_CHANGE
    factor = _factors(result)
    factor = np.where(factor > 0.0, np.clip(factor, 1.0 / most, most), 1.0)
    length, alpha = np.exp(np.clip(result.value[[layout.length, layout.alpha]],
                                   -math.log(longest), math.log(longest))).tolist()
    bending = [middle(values).value if values else nominal for values, nominal in zip(
        (bendings(told, wheel, i) for wheel in film.wheels for i in range(film.count)),
        film.bending_peak)]
    places = [place + off for place, off in zip(film.places, _offsets(found))]
    where = ({'positions': tuple(places)} if film.positions != (-1.0,)
             else {'spacing': places[1]}) if places == sorted(places) else {}
    film = replace(film, stretch_gain=tuple((factor * film.stretch_gain).tolist()),
                   bending_peak=tuple(bending), bending_alpha=alpha * film.bending_alpha, **where)
    return replace(robot, film=film, tire=replace(
        robot.tire, contact_length=length * robot.tire.contact_length))


def _factors(result: Adjustment) -> Array:
    """Return gains over the nominal ones."""
    factors: Array = 1.0 + result.value[:result.layout.length]
    return factors


def _offsets(found: Found) -> list[float]:
    """Return how far [m] each film is from its nominal place, as seen from its group's first."""
    off = [0.0] * found.robot.film.count
    for group in found.groups:
        for film in group[1:]:
            seen = apart(found.result, film, group[0])
            if seen.sigma < WORST_PLACE:
                off[film] = seen.value
    return off
