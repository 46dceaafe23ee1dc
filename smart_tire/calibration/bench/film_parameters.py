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

"""Identification of a film from a bench recording, and the YAML file that holds the result."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from smart_tire.calibration.bench.identify import FilmFit, identify
from smart_tire.errors import EstimatorError
from smart_tire.estimation.film.denoise import smoothed, without_spikes
from smart_tire.estimation.film.film_file import AMPLIFIER, FilmParams, PRODUCTS
from smart_tire.estimation.film.recording import FilmRecording
from smart_tire.models.film.buckling_film import BucklingFilm
from smart_tire.models.film.elastica import TOUCHING_STROKE
from smart_tire.numerics.robust import noise_level
from smart_tire.parameters.calibration_file import write_text
from smart_tire.uncertain import Uncertain
import yaml

TENSION_NOISE_FACTOR = 5.0  # of the laser's noise, beyond which a film is under tension
MAX_TENSION_SHARE = 0.5     # of the samples
POOR_RESIDUAL_FACTOR = 3.0  # of the noise: larger residuals indicate another hysteresis model


def identify_film(recording: FilmRecording, film: BucklingFilm | None
                  ) -> tuple[FilmParams, FilmFit, list[str]]:
    """
    Return the parameters of a film from a recording, the fit, and notes for the user.

    Without a ``film`` the recorded input is that of the operator.
    """
    notes = []
    deflection, spikes = without_spikes(recording.input)
    noise = noise_level(deflection)
    deflection, _ = smoothed(deflection)
    trusted = np.ones(deflection.size, dtype=bool)
    if film is not None:
        trusted = deflection >= -TENSION_NOISE_FACTOR * noise
        if trusted.mean() < 1.0 - MAX_TENSION_SHARE:
            raise EstimatorError(
                f'{(~trusted).sum()} of {deflection.size} deflections are negative: they must be '
                'measured from the flat film, positive when its ends approach each other')
        deflection = np.maximum(deflection, 0.0)
        if (film.stroke(deflection) >= TOUCHING_STROKE).any():
            notes.append(f'the film touches itself (a stroke above {TOUCHING_STROKE:.3f})')
    v = deflection if film is None else film.normalized_charge(deflection)
    fit = identify(recording.time, v, recording.output, trusted=trusted,
                   amplifier=film is not None)
    for count, what in ((spikes, 'spikes of the input were removed'),
                        (int((~trusted).sum()), 'samples with a film under tension were excluded'),
                        (int((trusted & ~fit.counted).sum()), 'outputs were outliers')):
        if count:
            notes.append(f'{count} {what}')
    params = FilmParams(
        film=film, alpha_gain=fit.alpha_gain.value, a_gain=fit.a_gain.value,
        b_gain=fit.b_gain.value, low_corner=fit.low_corner.value, drift=fit.drift.value,
        covariance=fit.covariance, span=fit.span, noise=fit.noise,
        model_error=math.sqrt(max(fit.rms**2 - fit.noise**2, 0.0)))
    return params, fit, notes + _notes(fit)


def _notes(fit: FilmFit) -> list[str]:
    """Return notes on the reliability of the values."""
    notes = []
    unknown = [name for name in PRODUCTS if not getattr(fit, name).determined]
    if unknown:
        notes.append(
            f'not determined: {", ".join(unknown)}: the loop is too small (range {fit.span:.3g} '
            f'times alpha_gain is {fit.span * fit.alpha_gain.value:.2g}); small loops show b_gain '
            'only')
    corner = fit.low_corner
    if math.isfinite(corner.sigma) and not corner.determined:
        notes.append(
            f'not determined: low_corner ({corner.value:.2g} ± {corner.sigma:.2g} Hz): the '
            'discharge of the amplifier cannot be separated from a drift of the output; with '
            'these parameters the sigma of other motions grows with time')
    if not fit.valid:
        notes.append('not a > b >= a / 2: no branch-wise inverse, the film cannot measure')
    if fit.rms > POOR_RESIDUAL_FACTOR * fit.noise:
        notes.append(f'residuals of the Duhem operator are {fit.share:.1%} of half the range, '
                     f'{fit.rms / fit.noise:.0f} times the noise' if fit.noise > 0.0 else
                     f'residuals of the Duhem operator are {fit.share:.1%} of half the range')
    return notes


def write_params(path: Path, params: FilmParams, fit: FilmFit, notes: list[str],
                 gain: float | None = None) -> None:
    """Write the YAML file that ``read_params`` reads; ``gain`` [C] is a K set by the user."""
    tree: dict[str, Any] = {
        'film': None if params.film is None else {
            'length_m': params.film.length, 'width_m': params.film.width,
            'thickness_m': params.film.thickness, 'convention': params.film.convention},
        'products': {name: _entry(getattr(fit, name)) for name in PRODUCTS},
        'covariance': [[float(value) for value in row] for row in params.covariance],
        'amplifier': {name: _entry(getattr(fit, name)) for name in AMPLIFIER},
        'span': params.span, 'noise': params.noise, 'model_error': params.model_error,
        'residual': {'rms': fit.rms, 'share_of_half_range': fit.share,
                     'correlated_samples': fit.correlation},
        'notes': notes}
    if gain is not None:
        tree['at_gain'] = {'K': gain, 'alpha': params.alpha_gain / gain,
                           'a': params.a_gain / gain, 'b': params.b_gain / gain}
    write_text(path, yaml.safe_dump(tree, sort_keys=False))


def _entry(estimate: Uncertain) -> dict[str, float | bool]:
    return {'value': estimate.value, 'sigma': estimate.sigma, 'determined': estimate.determined}
