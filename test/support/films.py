# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""A calibrated film, and its charge in a motion, without ports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from smart_tire.estimation.film.calibration import FilmParams
from smart_tire.estimation.film.estimator import FilmEstimator
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.models.film.hysteresis import DuhemParams, respond, TABLE_I, TABLE_I_GAIN
from smart_tire.papers.film_bench import write_params
from smart_tire.parameters.film import FilmSensorParams
from smart_tire.samples import FilmCharge, NS_PER_S
from smart_tire.uncertain import Uncertain

EPOCH_NS = 1_700_000_000 * NS_PER_S
RATE = 500.0            # Hz
NOISE = 0.02e-9         # C
SIGMAS = 0.02, 0.007, 0.004  # relative, of the products of a calibration
FILM = FILMS['25x3']
QUIET = FilmSensorParams(temperature_rate=0.0, temperature_sigma=0.0)  # constant temperature


def calibration(operator: DuhemParams = TABLE_I, *, low_corner: float = 1e-3,
                rng: np.random.Generator | None = None) -> FilmParams:
    """Return parameters of a film, exact ones or, with ``rng``, with errors of their sigmas."""
    values = np.array([operator.alpha, operator.a, operator.b]) * TABLE_I_GAIN
    sigmas = np.array([*(values * SIGMAS), 1e-4, 1e-12])
    errors = np.zeros(5) if rng is None else rng.standard_normal(5) * sigmas
    alpha, a, b = (values + errors[:3]).tolist()
    return FilmParams(
        film=FILM, alpha_gain=alpha, a_gain=a, b_gain=b, low_corner=low_corner + float(errors[3]),
        drift=float(errors[4]), covariance=np.diag(sigmas**2), span=0.27, noise=NOISE,
        model_error=0.0)


def strokes(seconds: float, *, top: float = 0.01, frequency: float = 3.0,
            begin: float = 1.0) -> np.ndarray:
    """Return the deflection [m] of a sine between flat and ``top`` from ``begin`` [s] on."""
    time = np.maximum(np.arange(round(seconds * RATE)) / RATE - begin, 0.0)
    found: np.ndarray = 0.5 * top * (1.0 - np.cos(2.0 * math.pi * frequency * time))
    return found


def charge_of(deflection: np.ndarray, *, operator: DuhemParams = TABLE_I, z: float = 0.0,
              low_corner: float = 1e-3, heat: np.ndarray | float = 0.0, seed: int = 0,
              noise: float = NOISE) -> np.ndarray:
    """Return the output [C] of the amplifier; ``z`` [C] is the initial state of the film."""
    v = TABLE_I_GAIN * FILM.normalized_charge(deflection)
    source = respond(v, operator, start=(0.0, z)) - z + heat
    output, decay = np.zeros(source.size), math.exp(-2.0 * math.pi * low_corner / RATE)
    for k in range(1, source.size):
        output[k] = decay * output[k - 1] + source[k] - source[k - 1]
    return output + noise * np.random.default_rng(seed).standard_normal(source.size)


def samples_of(charge: np.ndarray) -> list[FilmCharge]:
    """Return the samples of an output at RATE."""
    return [FilmCharge(EPOCH_NS + round(k * NS_PER_S / RATE), float(value))
            for k, value in enumerate(charge)]


def measured(samples: list, params: FilmSensorParams = QUIET, film: FilmParams | None = None, *,
             zero_at: float = math.inf, before: Callable[[FilmEstimator], None] | None = None
             ) -> np.ndarray:
    """Return time [s], deflection [m] and sigma [m] (n, 3); the film is flat at ``zero_at``."""
    estimator, found = FilmEstimator(params, film or calibration()), []
    if before is not None:
        before(estimator)
    for sample in samples:
        if sample.stamp_ns - EPOCH_NS >= zero_at * NS_PER_S:
            assert estimator.zero()
            zero_at = math.inf
        found += estimator.update(sample)
    found += estimator.finish()
    return np.array([((one.stamp_ns - EPOCH_NS) / NS_PER_S, *one.deflection) for one in found])


def flagged(sample: FilmCharge, **flags: bool) -> FilmCharge:
    """Return a sample with flags."""
    return replace(sample, **flags)


def write_calibration(path: Path) -> Path:
    """Write the parameters of a film as ``smart_tire identify film`` does; return the path."""
    film = calibration()
    fit: Any = SimpleNamespace(rms=0.0, share=0.0, correlation=1.0, **{
        name: Uncertain(getattr(film, name), 0.0)
        for name in ('alpha_gain', 'a_gain', 'b_gain', 'low_corner', 'drift')})
    write_params(path, film, fit, [])
    return path
