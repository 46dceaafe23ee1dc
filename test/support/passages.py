"""Passages of a wheel's films, drawn from the passage model with all that varies and errs."""

from __future__ import annotations

import math

import numpy as np

from smart_tire.estimation.contact.detection import CrossingDetector
from smart_tire.estimation.contact.records import CrossingSamples, FilmSamples
from smart_tire.estimation.contact.trajectory_error import TrajectoryErrors
from smart_tire.models.tire import tread_film
from smart_tire.parameters import RobotParams

WHEEL = 'front_right'
MARGIN = 0.028  # m, before and after the contact


def passage(rng: np.random.Generator, robot: RobotParams, *, slip: float, sliding: float,
            rpm: float = 60.0, films: tuple[int, ...] = (0, 1), gain_error: float = 0.03,
            growth: float = 0.0, spread: float | None = None, scale: float = 0.0,
            errors: TrajectoryErrors | None = None, other_sliding: float | None = None,
            edge: float | None = None, bending: float = 1.0) -> CrossingSamples:
    """
    Return one passage of the wheel's films as they were sighted.

    ``growth`` is the relative change of the slip over a contact length, ``spread`` that of the
    sliding share if it is another, ``scale`` the error of the distances, ``other_sliding`` the
    sliding share that films behind the first one meet, or all of them from the distance ``edge``
    [m] on; ``gain_error`` is the spread of the gains.
    """
    spread = growth if spread is None else spread
    speed = rpm / 60.0 * 2.0 * math.pi * robot.wheel_radius
    other = sliding if other_sliding is None else other_sliding
    samples = [_film(rng, robot, one, i, slip, (sliding, other, edge), speed, gain_error, growth,
                     spread, scale, bending) for i, one in enumerate(films)]
    sighter = CrossingDetector(robot)
    sightings = []
    for i, one in enumerate(samples):
        seen, middle = one.rail == 0, i * robot.film.spacing
        sightings.append(sighter.look(
            one.distance[seen], one.volts[seen], bending=robot.film.bending(WHEEL)[one.film],
            gain=robot.film.gains(WHEEL)[one.film], between=(middle - 0.02, middle + 0.018)))
    return CrossingSamples(tuple(samples), tuple(sightings), 0.0, errors or TrajectoryErrors())


def _film(rng: np.random.Generator, robot: RobotParams, index: int, position: int, slip: float,
          slidings: tuple[float, float, float | None], speed: float, gain_error: float,
          growth: float, spread: float, scale: float, bending: float) -> FilmSamples:
    film, patch = robot.film, robot.tire.contact_length
    reach, step = 0.5 * (patch + film.length) + MARGIN, speed / film.sample_rate
    way = np.arange(-reach + step * rng.uniform(), reach, step)
    x = way + 0.5 * (patch - film.length)
    middle = position * film.spacing
    grown, spreads = (1.0 + change * (way + middle) / patch for change in (growth, spread))
    sliding, other, edge = slidings
    share = np.where((position > 0) if edge is None else (way + middle > edge), other, sliding)
    total = 1.3 * abs(slip)
    peak = bending * film.bending(WHEEL)[index] * (1.0 + rng.uniform(-0.15, 0.15))
    volts = tread_film.crossing_voltage(
        x, slip=slip * grown, total_slip=total * spreads,
        critical_slip=total / share if slip else 0.5, film_length=film.length,
        contact_length=patch, bending_peak=peak, bending_alpha=film.bending_alpha,
        stretch_gain=film.gains(WHEEL)[index] * (1.0 + gain_error * rng.standard_normal()),
        release=film.release)
    heights = np.where(way < 0.0, *rng.uniform(0.10, 0.15, 2))
    volts = volts - heights * peak * tread_film.bumps(x, film.length, patch).value
    volts = volts + film.noise * rng.standard_normal(len(x)) + film.rest_voltage
    codes = np.clip(np.rint(volts / film.code), 0, 2**film.bits - 1)
    rail = np.where(codes == 0, -1, np.where(codes == 2**film.bits - 1, 1, 0))
    return FilmSamples(index, middle + way * (1.0 + scale), codes * film.code - film.rest_voltage,
                       rail.astype(np.int8))
