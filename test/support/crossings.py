# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Samples of a wheel's films in one patch crossing, drawn from the tread model with all errors."""

from __future__ import annotations

import math

import numpy as np

from smart_tire.estimation.contact.detection import CrossingDetector
from smart_tire.estimation.contact.records import (
    CrossingSamples, FilmSamples, TrajectoryErrors)
from smart_tire.estimation.friction.waveform_shape import ShapeEstimator, ShapePrior
from smart_tire.models.tire import tread_film
from smart_tire.parameters import RobotParams

WHEEL = 'front_right'
KNOWN = 1e9  # precision of a shape that is known
SAMPLE_MARGIN = 0.028  # m, of samples before and after a film's crossing


def known_shape() -> ShapeEstimator:
    """Return the nominal shape of release and bumps, with negligible standard deviations."""
    shape = ShapeEstimator()
    shape.prior = ShapePrior(shape.prior.value, KNOWN * np.eye(len(shape.prior.value)))
    return shape


def crossing_samples(
        rng: np.random.Generator, robot: RobotParams, *, slip: float, normalized_slip: float,
        rpm: float = 60.0, films: tuple[int, ...] = (0, 1), gain_error: float = 0.03,
        growth: float = 0.0, spread: float | None = None, scale: float = 0.0,
        errors: TrajectoryErrors | None = None, other_normalized_slip: float | None = None,
        edge: float | None = None, bending: float = 1.0) -> CrossingSamples:
    """
    Return the samples of one crossing with the detection of each film.

    ``growth`` is the relative change of slip over a contact length and ``spread`` that of
    normalized slip, by default the same; ``scale`` is the relative error of distances and
    ``gain_error`` the standard deviation of the gains. ``other_normalized_slip`` applies to all
    films but the first, or to all films from the distance ``edge`` [m] on.
    """
    spread = growth if spread is None else spread
    speed = rpm / 60.0 * 2.0 * math.pi * robot.wheel_radius
    other = normalized_slip if other_normalized_slip is None else other_normalized_slip
    samples = [_film_samples(rng, robot, film, i, slip, (normalized_slip, other, edge), speed,
                             gain_error, growth, spread, scale, bending)
               for i, film in enumerate(films)]
    detector = CrossingDetector(robot)
    detections = []
    for i, film in enumerate(samples):
        unclipped, center = film.rail == 0, i * robot.film.spacing
        detections.append(detector.detect(
            film.distance[unclipped], film.volts[unclipped],
            bending=robot.film.bending(WHEEL)[film.film], gain=robot.film.gains(WHEEL)[film.film],
            between=(center - 0.02, center + 0.018)))
    return CrossingSamples(tuple(samples), tuple(detections), 0.0, errors or TrajectoryErrors())


def _film_samples(
        rng: np.random.Generator, robot: RobotParams, index: int, position: int, slip: float,
        normalized_slips: tuple[float, float, float | None], speed: float, gain_error: float,
        growth: float, spread: float, scale: float, bending: float) -> FilmSamples:
    film, patch = robot.film, robot.tire.contact_length
    reach, step = 0.5 * (patch + film.length) + SAMPLE_MARGIN, speed / film.sample_rate
    distance = np.arange(-reach + step * rng.uniform(), reach, step)  # from the film's center
    x = distance + 0.5 * (patch - film.length)
    center = position * film.spacing
    slip_factor, spread_factor = (1.0 + change * (distance + center) / patch
                                  for change in (growth, spread))
    first, other, edge = normalized_slips
    normalized = np.where((position > 0) if edge is None else (distance + center > edge), other,
                          first)
    total = 1.3 * abs(slip)
    peak = bending * film.bending(WHEEL)[index] * (1.0 + rng.uniform(-0.15, 0.15))
    volts = tread_film.crossing_voltage(
        x, slip=slip * slip_factor, total_slip=total * spread_factor,
        critical_slip=total / normalized if slip else 0.5, film_length=film.length,
        contact_length=patch, bending_peak=peak, bending_alpha=film.bending_alpha,
        stretch_gain=film.gains(WHEEL)[index] * (1.0 + gain_error * rng.standard_normal()),
        release=film.release)
    heights = np.where(distance < 0.0, *rng.uniform(0.10, 0.15, 2))
    volts = volts - heights * peak * tread_film.bumps(x, film.length, patch)[0]
    volts = volts + film.noise * rng.standard_normal(len(x)) + film.rest_voltage
    codes = np.clip(np.rint(volts / film.code_voltage), 0, 2**film.bits - 1)
    rail = np.where(codes == 0, -1, np.where(codes == 2**film.bits - 1, 1, 0))
    return FilmSamples(index, (center + distance) * (1.0 + scale),
                       codes * film.code_voltage - film.rest_voltage, rail.astype(np.int8))
