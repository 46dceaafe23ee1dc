"""Identified films: what paper A's Table I, Fig. 8 and Fig. 9 show."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.bench.film_parameters import identify_film
from smart_tire.estimation.film.film_file import FilmParams
from smart_tire.estimation.film.recording import FilmRecording
from smart_tire.models.film.elastica import TOUCHING_STROKE
from smart_tire.models.film.hysteresis import respond, TABLE_I_GAIN
from smart_tire.reproduction.experiments import Laboratory, Specimen, specimen
from smart_tire.uncertain import Uncertain

RATE, FREQUENCY, AMPLITUDE = 500.0, 5.0, 6e-3  # Hz, Hz, m: Fig. 8
DURATION = 4.0    # s
BEFORE = 1.05     # s that the film moves before the recording begins, half way in
SEEDS = range(1, 11)
PRODUCTS = ('alpha_gain', 'a_gain', 'b_gain')
CLOSED = 0.01     # of the range: an estimate that is nearer has forgotten its start
DEAD_BAND = 1e-3  # of the input v, far above the laser's noise and below a hundredth of a loop


@dataclass(frozen=True)
class Estimated:
    """Measured charge against the one estimated from deflection and identified operator."""

    time: Array        # s
    deflection: Array  # m
    measured: Array    # C, without the amplifier's zero and drift
    estimated: Array   # C, from a zero initial state
    settled: float     # s, when the estimate has forgotten its start
    slope: float       # of measured over estimated, once settled
    determination: float  # R^2, once settled
    rms: float         # C, once settled


@dataclass(frozen=True)
class Identification:
    """Table I, identified from several noisy recordings."""

    true: dict[str, float]             # products that the bench was given
    estimates: list[dict[str, Uncertain]]  # one per seed
    geometric_gain: float              # C, K of A(15) from geometry and usual constants
    printed_stroke: float              # the printed normalisation's of Fig. 8's deflection
    first: Estimated                   # the first recording

    @property
    def pulls(self) -> Array:
        """Return errors over standard errors, (seeds, products)."""
        return np.array([[(told[name].value - self.true[name]) / told[name].sigma
                          for name in PRODUCTS] for told in self.estimates])

    def constants(self, number: int) -> tuple[float, float, float]:
        """Return alpha [1/C], a and b of an estimate for Table I's K."""
        told = self.estimates[number]
        alpha, a, b = (told[name].value / TABLE_I_GAIN for name in PRODUCTS)
        return alpha, a, b

    @property
    def touches(self) -> bool:
        """Return whether the printed stroke is one at which the film touches itself."""
        return self.printed_stroke >= TOUCHING_STROKE


def identification(laboratory: Laboratory) -> Identification:
    """Return the fits of recordings of Fig. 8's motion, one for each seed."""
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
    """Return Fig. 8's experiment: a film that already moves when the recording begins."""
    time = np.arange(round((DURATION + BEFORE) * RATE)) / RATE
    whole = laboratory.bench(
        film, AMPLITUDE * (1.0 - np.cos(2.0 * math.pi * FREQUENCY * time)), RATE, seed)
    begin = round(BEFORE * RATE)
    return FilmRecording(whole.time[begin:] - whole.time[begin], whole.input[begin:],
                         whole.output[begin:])


def estimated(recording: FilmRecording, film: Specimen, params: FilmParams) -> Estimated:
    """Return what the operator makes of the recorded deflection, beside what was measured."""
    v = film.film.normalized_charge(np.maximum(recording.input, 0.0))
    operator, since = params.operator, recording.time
    # the paper's zero initial condition: no charge, wherever the film stands at the time
    charge = respond(v, operator, start=(float(v[0]), 0.0), dead_band=DEAD_BAND)
    steady = respond(np.tile(v, 2), operator, dead_band=DEAD_BAND)[v.size:]
    far = np.abs(charge - steady) > CLOSED * float(np.ptp(steady))
    first = int(np.flatnonzero(far)[-1]) + 1 if far.any() else 0
    # an amplifier has no zero and drifts slowly to what it takes for one
    drift = np.polyfit(since[first:], recording.output[first:] - charge[first:], 1)
    measured = recording.output - np.polyval(drift, since)
    told, known = charge[first:], measured[first:]
    return Estimated(since, recording.input, measured, charge, float(since[first]),
                     float(np.polyfit(told, known, 1)[0]),
                     float(np.corrcoef(told, known)[0, 1]**2), float(np.std(known - told)))
