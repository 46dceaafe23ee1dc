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

"""Identified films: Table I, Fig. 8 and Fig. 9 of paper A."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.film_bench import identify_film
from smart_tire.estimation.film.files import FilmParams, FilmRecording
from smart_tire.models.film.elastica import TOUCHING_STROKE
from smart_tire.models.film.hysteresis import respond, TABLE_I_GAIN
from smart_tire.reproduction.experiments import Laboratory, Specimen, specimen
from smart_tire.uncertain import Uncertain

RATE, FREQUENCY, AMPLITUDE = 500.0, 5.0, 6e-3  # Hz, Hz, m: Fig. 8
DURATION = 4.0                                 # s
PRE_RECORDING = 1.05  # s of motion before the recording, which begins at half the stroke
SEEDS = range(1, 11)
PRODUCTS = ('alpha_gain', 'a_gain', 'b_gain')
CONVERGED_SHARE = 0.01  # of the range: smaller differences to the steady state are converged
DEAD_BAND = 1e-3        # of the input v, above the laser's noise and below 1 % of a loop


@dataclass(frozen=True)
class Estimated:
    """Measured charge and charge estimated from deflection by the identified operator."""

    time: Array           # s
    deflection: Array     # m
    measured: Array       # C, without offset and drift of the amplifier
    estimated: Array      # C, from a zero initial state
    settled: float        # s, time of convergence from the initial state
    slope: float          # of measured over estimated, after convergence
    determination: float  # R^2, after convergence
    rms: float            # C, after convergence


@dataclass(frozen=True)
class Identification:
    """Table I, identified from several simulated recordings."""

    true: dict[str, float]                 # products of the simulated film
    estimates: list[dict[str, Uncertain]]  # one per seed
    geometric_gain: float                  # C, K of A(15) from geometry and typical constants
    printed_stroke: float                  # of Fig. 8's deflection with the printed normalization
    first: Estimated                       # the first recording

    @property
    def pulls(self) -> Array:
        """Return errors over standard errors, (seeds, products)."""
        return np.array([[(fitted[name].value - self.true[name]) / fitted[name].sigma
                          for name in PRODUCTS] for fitted in self.estimates])

    def constants(self, number: int) -> tuple[float, float, float]:
        """Return alpha [1/C], a and b of an estimate for the K of Table I."""
        fitted = self.estimates[number]
        alpha, a, b = (fitted[name].value / TABLE_I_GAIN for name in PRODUCTS)
        return alpha, a, b

    @property
    def touches(self) -> bool:
        """Return whether the film touches itself at the printed stroke."""
        return self.printed_stroke >= TOUCHING_STROKE


def identification(laboratory: Laboratory) -> Identification:
    """Return the fits of recordings of the motion of Fig. 8, one per seed."""
    film = specimen('25x3')
    recordings = [record(laboratory, film, seed) for seed in SEEDS]
    fits = [identify_film(recording, film.film)[:2] for recording in recordings]
    p, K = film.hysteresis, film.gain
    return Identification(
        {'alpha_gain': p.alpha * K, 'a_gain': p.a * K, 'b_gain': p.b * K},
        [{name: getattr(fit, name) for name in PRODUCTS} for _, fit in fits],
        film.film.gain, 2.0 * AMPLITUDE / film.film.half_length,
        estimated(recordings[0], film, fits[0][0]))


def record(laboratory: Laboratory, film: Specimen, seed: int) -> FilmRecording:
    """Return the experiment of Fig. 8: the film is in motion when the recording begins."""
    time = np.arange(round((DURATION + PRE_RECORDING) * RATE)) / RATE
    full = laboratory.bench(
        film, AMPLITUDE * (1.0 - np.cos(2.0 * math.pi * FREQUENCY * time)), RATE, seed)
    begin = round(PRE_RECORDING * RATE)
    return FilmRecording(full.time[begin:] - full.time[begin], full.input[begin:],
                         full.output[begin:])


def estimated(recording: FilmRecording, film: Specimen, params: FilmParams) -> Estimated:
    """Return the estimated and the measured charge of a recording."""
    v = film.film.normalized_charge(np.maximum(recording.input, 0.0))
    operator, elapsed = params.operator, recording.time
    # the paper's zero initial condition: no charge at any deflection
    charge = respond(v, operator, start=(float(v[0]), 0.0), dead_band=DEAD_BAND)
    steady = respond(np.tile(v, 2), operator, dead_band=DEAD_BAND)[v.size:]
    not_converged = np.abs(charge - steady) > CONVERGED_SHARE * float(np.ptp(steady))
    first = int(np.flatnonzero(not_converged)[-1]) + 1 if not_converged.any() else 0
    # offset and slow drift of the amplifier
    drift = np.polyfit(elapsed[first:], recording.output[first:] - charge[first:], 1)
    measured = recording.output - np.polyval(drift, elapsed)
    estimate, reference = charge[first:], measured[first:]
    return Estimated(
        elapsed, recording.input, measured, charge, float(elapsed[first]),
        float(np.polyfit(estimate, reference, 1)[0]),
        float(np.corrcoef(estimate, reference)[0, 1]**2), float(np.std(reference - estimate)))
