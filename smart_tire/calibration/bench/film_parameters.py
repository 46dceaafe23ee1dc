"""Identification of a film from a bench recording, and the YAML file that holds the result."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

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
PULLED = 5.0  # of the laser's noise: a film longer than flat by more is pulled
MOST_PULLED = 0.5  # of the samples
POOR = 3.0    # of the noise: larger residuals come from another law


def identify_film(recording: FilmRecording, film: BucklingFilm | None
                  ) -> tuple[FilmParams, FilmFit, list[str]]:
    """
    Return the parameters of a film from a recording, the fit, and notes for its user.

    Without a ``film`` the recorded input drives the operator as it is.
    """
    notes = []
    moved, spikes = without_spikes(recording.input)
    noise = noise_level(moved)
    moved, _ = smoothed(moved)
    trusted = np.ones(moved.size, dtype=bool)
    if film is not None:
        trusted = moved >= -PULLED * noise
        if trusted.mean() < 1.0 - MOST_PULLED:
            raise EstimatorError(
                f'{(~trusted).sum()} of {moved.size} deflections are negative: they must count '
                'from the flat film, positive where its ends come together')
        moved = np.maximum(moved, 0.0)
        if (film.stroke(moved) >= TOUCHING_STROKE).any():
            notes.append(f'the film touches itself (a stroke above {TOUCHING_STROKE:.3f})')
    fit = identify(recording.time, moved if film is None else film.normalised_charge(moved),
                   recording.output, trusted=trusted, amplifier=film is not None)
    for count, what in ((spikes, 'spikes of the input were removed'),
                        (int((~trusted).sum()), 'samples with a pulled film were left out'),
                        (int((trusted & ~fit.counted).sum()), 'outputs were outliers')):
        if count:
            notes.append(f'{count} {what}')
    params = FilmParams(
        film=film, alpha_gain=fit.alpha_gain.value, a_gain=fit.a_gain.value,
        b_gain=fit.b_gain.value, low_corner=fit.low_corner.value, drift=fit.drift.value,
        covariance=fit.covariance, span=fit.span, noise=fit.noise,
        misfit=math.sqrt(max(fit.rms**2 - fit.noise**2, 0.0)))
    return params, fit, notes + _judged(fit)


def _judged(fit: FilmFit) -> list[str]:
    """Return what the user must know of the values."""
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
            f'not determined: low_corner ({corner.value:.2g} ± {corner.sigma:.2g} Hz): what the '
            'amplifier drains can not be told from a drift of the output; measured with it, the '
            'sigma of other motions grows with time')
    if not fit.valid:
        notes.append('not a > b >= a / 2: no branch-wise inverse, the film can not measure')
    if fit.rms > POOR * fit.noise:
        notes.append(f'a Duhem operator leaves {fit.share:.1%} of half the range, '
                     f'{fit.rms / fit.noise:.0f} times the noise' if fit.noise > 0.0 else
                     f'a Duhem operator leaves {fit.share:.1%} of half the range')
    return notes


def write_params(path: Path, params: FilmParams, fit: FilmFit, notes: list[str],
                 gain: float | None = None) -> None:
    """Write the YAML file that ``read_params`` reads; ``gain`` [C] is a K that the user fixes."""
    tree: dict[str, Any] = {
        'film': None if params.film is None else {
            'length_m': params.film.length, 'width_m': params.film.width,
            'thickness_m': params.film.thickness, 'convention': params.film.convention},
        'products': {name: _entry(getattr(fit, name)) for name in PRODUCTS},
        'covariance': [[float(value) for value in row] for row in params.covariance],
        'amplifier': {name: _entry(getattr(fit, name)) for name in AMPLIFIER},
        'span': params.span, 'noise': params.noise, 'misfit': params.misfit,
        'residual': {'rms': fit.rms, 'share_of_half_range': fit.share,
                     'correlated_samples': fit.correlation},
        'notes': notes}
    if gain is not None:
        tree['at_gain'] = {'K': gain, 'alpha': params.alpha_gain / gain,
                           'a': params.a_gain / gain, 'b': params.b_gain / gain}
    write_text(path, yaml.safe_dump(tree, sort_keys=False))


def _entry(estimate: Uncertain) -> dict[str, float | bool]:
    return {'value': estimate.value, 'sigma': estimate.sigma, 'determined': estimate.determined}
