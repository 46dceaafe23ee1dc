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

"""Measured and fitted waveforms of a patch crossing, for figures and viewers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.contact.records import FilmSamples
from smart_tire.estimation.friction.waveform_fit import WaveformFit
from smart_tire.estimation.friction.waveform_model import PerFilm, WaveformModel
from smart_tire.parameters.robot import RobotParams

CURVE_STEP = 0.00025  # m, between two points of a fitted curve: its minimum is sharp


@dataclass(frozen=True, slots=True, eq=False)
class FilmWaveform:
    """
    Voltages of one film above its rest voltage.

    Positions are those of the film's center relative to the center of the patch, positive after
    it in the direction of motion, by the rolled distance.
    """

    film: int               # index of the film on the wheel, 0 for film 1
    position: Array         # m, (n,), of the samples
    volts: Array            # V, (n,), measured
    fit_position: Array     # m, (m,), ascending
    fit_volts: Array        # V, (m,)


def fitted_waveforms(fit: WaveformFit, robot: RobotParams, wheel: str) -> list[FilmWaveform]:
    """Return the samples of each film in a crossing of ``wheel``, and the model fitted to them."""
    samples = fit.samples
    curves = [_curve(film) for film in samples.films]
    model = WaveformModel(robot, robot.film.gains(wheel), curves, samples.reference,
                          len(samples.errors.shape_sigmas))
    volts, _ = model.linearized(fit.parameters)
    parts = np.split(volts, np.cumsum([len(curve.distance) for curve in curves])[:-1])
    found = []
    for i, (film, curve, fitted) in enumerate(zip(samples.films, curves, parts)):
        center = fit.film_parameter(i, PerFilm.CENTER).value
        found.append(FilmWaveform(film.film, film.distance - center, film.volts,
                                  curve.distance - center, fitted))
    return found


def _curve(film: FilmSamples) -> FilmSamples:
    """Return the distances of a curve from the first to the last sample of ``film``."""
    low, high = float(film.distance.min()), float(film.distance.max())
    distance = np.linspace(low, high, max(2, round((high - low) / CURVE_STEP) + 1))
    return FilmSamples(film.film, distance, np.zeros_like(distance),
                       np.zeros(len(distance), np.int8))
