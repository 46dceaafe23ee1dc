# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Experiments on films: interface of the laboratory, loops and identified films of paper A."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.estimation.film.calibration import FilmParams, PRODUCTS
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.models.film.hysteresis import respond, series, TABLE_I_GAIN
from smart_tire.papers.film_bench import identify_film
from smart_tire.papers.film_files import FilmRecording
from smart_tire.simulation.film import AmplifierState, FilmTestStand, OVERSAMPLING
from smart_tire.uncertain import Uncertain


def bench(film: FilmTestStand, deflection: ArrayLike, rate: float, seed: int) -> FilmRecording:
    """
    Return the recording of ``deflection`` [m] (n,) at ``rate`` [Hz] by the test stand.

    The film is flat and without hysteresis at first; between two samples the stage moves at
    constant speed.
    """
    path, rng = series('deflection', deflection), np.random.default_rng(seed)
    fine = np.interp(np.arange((path.size - 1) * OVERSAMPLING + 1) / OVERSAMPLING,
                     np.arange(path.size), path)
    output = replace(film, rate=rate).amplified(fine, AmplifierState())[::OVERSAMPLING]
    output = output + film.charge_noise * rng.standard_normal(path.size)
    return FilmRecording(np.arange(path.size) / rate, path + film.laser_noise
                         * rng.standard_normal(path.size), film.converted(output))


SAMPLES = 200                                     # per cycle, at every frequency
SETTLING_CYCLES, AVERAGED_CYCLES = 24, 12         # the smallest loops converge slowly
FREQUENCIES = np.arange(1.0, 11.0)                # Hz, Fig. 6(b)
AMPLITUDES = np.linspace(0.25, 2.5, 10) * 1e-3    # m, Fig. 7: range up to half the film
END_SAMPLES = 3                                   # averaged around each reversal
PEAK_SIGMA_FACTOR = math.sqrt(2.0 / END_SAMPLES)  # of the difference of two such means
ASYMPTOTIC_REVERSALS = 200  # after which a loop has converged to machine precision


@dataclass(frozen=True)
class Loop:
    """A steady-state cycle, averaged, with the charge relative to its mean."""

    deflection: Array    # m (n,), from the flat film
    charge: Array        # C (n,)
    charge_sigma: float  # C, standard error of each point
    peak: float          # C, half the range of the charge
    peak_sigma: float    # C
    lag: float           # rad, of the charge behind the deflection, at the loop's frequency

    @property
    def height(self) -> float:
        """Return the largest distance of the branches over the range of the charge."""
        # a sine has the same deflection at equal times before and after a reversal
        half = self.charge.size // 2
        loading, unloading = self.charge[1:half], self.charge[:half:-1]
        return float(np.max(np.abs(loading - unloading)) / np.ptp(self.charge))


@dataclass(frozen=True)
class Trace:
    """Fig. 4(a) with the loop of Fig. 4(b)."""

    time: Array        # s
    deflection: Array  # m
    charge: Array      # C, as recorded
    loop: Loop


@dataclass(frozen=True)
class RateIndependence:
    """Fig. 6: loops at two frequencies, and peaks over frequency."""

    loops: dict[float, Loop]  # by frequency [Hz]
    difference: float         # rms of the loops' difference over its standard error
    frequency: Array          # Hz
    peak: Array               # C
    sigma: Array              # C
    slope: float              # relative change of the peak per decade of frequency
    slope_sigma: float

    @property
    def spread(self) -> float:
        """Return the range of the peaks over their mean."""
        return float(np.ptp(self.peak) / np.mean(self.peak))


@dataclass(frozen=True)
class Proportionality:
    """Fig. 7: peaks over amplitude, and those of the models without noise."""

    amplitude: Array           # m, half the range of the deflection
    peak: Array                # C
    sigma: Array               # C
    line: tuple[float, float]  # C/m and C: regression line of the measured peaks
    models: dict[str, Array]   # peaks [C] by charge model, with hysteresis
    elastica_rise: float  # relative excess of the exact charge over A(16) at the largest stroke
    loop_rise: float           # relative rise from hysteresis alone: larger loops are steeper

    @property
    def determination(self) -> float:
        """Return R^2 of the straight line."""
        residual = self.peak - np.polyval(self.line, self.amplitude)
        return float(1.0 - np.sum(residual**2) / np.sum((self.peak - self.peak.mean())**2))

    @property
    def curvature(self) -> float:
        """Return the largest distance of the exact peaks from their line, over the largest."""
        exact = self.models['exact']
        line = np.polyval(np.polyfit(self.amplitude, exact, 1), self.amplitude)
        return float(np.max(line - exact) / exact[-1])

    @property
    def rise(self) -> tuple[float, float]:
        """Return the relative rise of charge per amplitude from first to last, and its sigma."""
        rise = _rise(self.amplitude, self.peak)
        sigma = math.hypot(*(self.sigma / self.peak)[[0, -1]])
        return rise, (1.0 + rise) * sigma

    def exact_rise(self, share: float = 1.0) -> float:
        """Return the rise of the exact model without noise, up to a share of the amplitudes."""
        selected = self.amplitude <= share * self.amplitude[-1]
        return _rise(self.amplitude[selected], self.models['exact'][selected])


def buckling_test() -> Trace:
    """Return Fig. 4: 5 Hz, ``Delta = 4 (-1 + sin(10 pi t))`` mm."""
    film, rate = FilmTestStand.of(FILMS['32x3']), 5.0 * SAMPLES
    time = np.arange(2 * SAMPLES + SETTLING_CYCLES * SAMPLES) / rate
    recording = bench(film, 4e-3 * (1.0 - np.sin(10.0 * math.pi * time)), rate, 1)
    shown = slice(-2 * SAMPLES, None)
    return Trace(time[:2 * SAMPLES], recording.input[shown], recording.output[shown],
                 settled_loop(film, 4e-3, 5.0))


def rate_independence() -> RateIndependence:
    """Return Fig. 6: 8 mm at 5 and 10 Hz, and 2 mm of a small film from 1 to 10 Hz."""
    loops = {f: settled_loop(FilmTestStand.of(FILMS['32x3']), 8e-3, f) for f in (5.0, 10.0)}
    first, second = loops.values()
    sigma = math.hypot(first.charge_sigma, second.charge_sigma)
    difference = float(np.sqrt(np.mean((first.charge - second.charge)**2))) / sigma
    film = FilmTestStand.of(FILMS['10x1'])
    small_film = [settled_loop(film, 2e-3, float(f)) for f in FREQUENCIES]
    peak = np.array([loop.peak for loop in small_film])
    sigmas = np.array([loop.peak_sigma for loop in small_film])
    fit, covariance = np.polyfit(np.log10(FREQUENCIES), peak / peak.mean(), 1,
                                 w=peak.mean() / sigmas, cov='unscaled')
    return RateIndependence(loops, difference, FREQUENCIES, peak, sigmas, float(fit[0]),
                            math.sqrt(float(covariance[0, 0])))


def proportionality() -> Proportionality:
    """Return Fig. 7: amplitudes at 2 Hz."""
    film = FilmTestStand.of(FILMS['10x1'])
    loops = [settled_loop(film, float(top), 2.0) for top in AMPLITUDES]
    peak = np.array([loop.peak for loop in loops])
    models = {name: np.array([asymptotic_peak(film, 2.0 * top, name) for top in AMPLITUDES])
              for name in ('exact', 'printed', 'linear')}
    top = 2.0 * AMPLITUDES[-1:]
    exact, linear = (float(film.film.normalized_charge(top, name)[0])
                     for name in ('exact', 'linear'))
    slope, offset = np.polyfit(AMPLITUDES, peak, 1)
    return Proportionality(AMPLITUDES, peak, np.array([loop.peak_sigma for loop in loops]),
                           (float(slope), float(offset)), models, exact / linear - 1.0,
                           _rise(AMPLITUDES, models['linear']))


def asymptotic_peak(film: FilmTestStand, top: float, model: str) -> float:
    """Return half the range of the charge [C] of a film that moves between 0 and ``top`` [m]."""
    # the operator is rate-independent: the reversals determine the loop
    reversals = film.charge(np.array([top, 0.0]), model)
    charge = respond(np.tile(reversals, ASYMPTOTIC_REVERSALS), film.hysteresis)
    return 0.5 * abs(float(charge[-1] - charge[-2]))


def settled_loop(film: FilmTestStand, amplitude: float,
                 frequency: float) -> Loop:
    """Return the loop of a sine with ``amplitude`` [m] about its mean deflection."""
    phase = 2.0 * math.pi * np.arange((SETTLING_CYCLES + AVERAGED_CYCLES) * SAMPLES) / SAMPLES
    recording = bench(film, amplitude * (1.0 - np.cos(phase)), frequency * SAMPLES,
                      round(1e6 * amplitude + frequency))
    cycles = slice(SETTLING_CYCLES * SAMPLES, None)
    deflection = recording.input[cycles].reshape(AVERAGED_CYCLES, SAMPLES)
    charge = _without_drift(recording.output[cycles])
    mean, path = charge.mean(axis=0), deflection.mean(axis=0)
    # one value for all points, which have the same noise
    sigma = float(np.sqrt(np.mean(charge.var(axis=0, ddof=1)) / AVERAGED_CYCLES))
    start, reversal = _end_charges(mean)
    return Loop(path, mean, sigma, 0.5 * (start - reversal), sigma * 0.5 * PEAK_SIGMA_FACTOR,
                (_phase(path) - _phase(-mean)) % (2.0 * math.pi))


def _rise(amplitude: Array, peak: Array) -> float:
    steepness = peak / amplitude
    return float(steepness[-1] / steepness[0]) - 1.0


def _end_charges(charge: Array) -> tuple[float, float]:
    """Return the charge at the flat and at the most buckled end (a maximum would be biased)."""
    near = np.arange(END_SAMPLES) - END_SAMPLES // 2
    return float(charge[near].mean()), float(charge[SAMPLES // 2 + near].mean())


def _without_drift(charge: Array) -> Array:
    """Return cycles (AVERAGED_CYCLES, SAMPLES) of charge without the drift of the amplifier."""
    cycles = charge.reshape(AVERAGED_CYCLES, SAMPLES)
    slope = float(np.polyfit(np.arange(AVERAGED_CYCLES), cycles.mean(axis=1), 1)[0]) / SAMPLES
    level: Array = charge - slope * np.arange(charge.size)
    return (level - level.mean()).reshape(AVERAGED_CYCLES, SAMPLES)


def _phase(cycle: Array) -> float:
    """Return the phase [rad] of a cycle's fundamental."""
    return float(np.angle(np.fft.rfft(cycle)[1]))


RATE, FREQUENCY, AMPLITUDE = 500.0, 5.0, 6e-3  # Hz, Hz, m: Fig. 8
DURATION = 4.0                                 # s
PRE_RECORDING = 1.05  # s of motion before the recording, which begins at half the stroke
SEEDS = range(1, 11)
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
class TableOneFits:
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


def identification() -> TableOneFits:
    """Return the fits of recordings of the motion of Fig. 8, one per seed."""
    film = FilmTestStand()
    recordings = [record(film, seed) for seed in SEEDS]
    fits = [identify_film(recording, film.film)[:2] for recording in recordings]
    p, K = film.hysteresis, film.gain
    return TableOneFits(
        {'alpha_gain': p.alpha * K, 'a_gain': p.a * K, 'b_gain': p.b * K},
        [{name: getattr(fit, name) for name in PRODUCTS} for _, fit in fits],
        film.film.gain, 2.0 * AMPLITUDE / film.film.half_length,
        estimated(recordings[0], film, fits[0][0]))


def record(film: FilmTestStand, seed: int) -> FilmRecording:
    """Return the experiment of Fig. 8: the film is in motion when the recording begins."""
    time = np.arange(round((DURATION + PRE_RECORDING) * RATE)) / RATE
    full = bench(
        film, AMPLITUDE * (1.0 - np.cos(2.0 * math.pi * FREQUENCY * time)), RATE, seed)
    begin = round(PRE_RECORDING * RATE)
    return FilmRecording(full.time[begin:] - full.time[begin], full.input[begin:],
                         full.output[begin:])


def estimated(recording: FilmRecording, film: FilmTestStand, params: FilmParams) -> Estimated:
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
