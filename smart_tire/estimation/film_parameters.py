"""What is known of a film after its identification, and the YAML file that holds it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError, ParameterError
from smart_tire.estimation.film_identification import FilmFit, identify
from smart_tire.estimation.film_recording import FilmRecording
from smart_tire.estimation.film_signal import smoothed, without_spikes
from smart_tire.models.film.buckling_film import BucklingFilm
from smart_tire.models.film.elastica import TOUCHING_STROKE
from smart_tire.models.film.hysteresis import DuhemParams
from smart_tire.numerics.robust import noise_level
from smart_tire.parameters.identified import write_text
from smart_tire.uncertain import Estimate, UNDETERMINED

PRODUCTS = ('alpha_gain', 'a_gain', 'b_gain')
AMPLIFIER = ('low_corner', 'drift')  # Hz, C/s
PULLED = 5.0  # of the laser's noise: a film longer than flat by more is pulled
MOST_PULLED = 0.5  # of the samples
REACH = 1.5   # of the range: chosen; linear errors of undetermined products end there
POOR = 3.0    # of the noise: larger residuals come from another law


@dataclass(frozen=True, kw_only=True)
class FilmParams:
    """A calibrated film: ``measure`` needs no more."""

    film: BucklingFilm | None  # None: the input is that of the operator itself
    alpha_gain: float          # 1 / unit of the input
    a_gain: float              # C / unit of the input
    b_gain: float
    low_corner: float          # Hz, 0 where the amplifier showed none
    drift: float               # C/s, beside what the amplifier drains
    covariance: Array          # (5, 5) of the five
    span: float                # range of the input that they come from
    noise: float               # C, of one sample
    misfit: float              # C, rms of what the operator leaves beside noise

    @property
    def reach(self) -> float:
        """Return the largest input that they hold for: little beyond a loop that is too small."""
        products = np.array([self.alpha_gain, self.a_gain, self.b_gain])
        determined = np.sqrt(np.diag(self.covariance)[:3]) <= UNDETERMINED * np.abs(products)
        return math.inf if determined.all() else REACH * self.span

    @property
    def operator(self) -> DuhemParams:
        """Return the operator from the normalised input to the charge; ParameterError if none."""
        return DuhemParams(alpha=self.alpha_gain, a=self.a_gain, b=self.b_gain)


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


def _entry(estimate: Estimate) -> dict[str, float | bool]:
    return {'value': estimate.value, 'sigma': estimate.sigma, 'determined': estimate.determined}


def read_params(path: Path) -> FilmParams:
    """Return the parameters in a file of ``write_params``; ParameterError names what is wrong."""
    try:
        tree = yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise ParameterError(f'{path}: cannot be read ({error.strerror})') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ParameterError(f'{path}: is no YAML: {error}') from error
    try:
        return _params(tree)
    except KeyError as error:
        raise ParameterError(f'{path}: {error.args[0]} is missing') from error
    except (TypeError, ValueError) as error:
        raise ParameterError(f'{path}: {error}') from error


def _params(tree: Mapping[str, Any]) -> FilmParams:
    film = tree['film']
    values = {name: float(tree[group][name]['value'])
              for group, names in (('products', PRODUCTS), ('amplifier', AMPLIFIER))
              for name in names}
    values.update({name: float(tree[name]) for name in ('span', 'noise', 'misfit')})
    covariance = np.array(tree['covariance'], dtype=float)
    if covariance.shape != (5, 5) or not np.isfinite([*values.values(), *covariance.flat]).all():
        raise ParameterError('products, amplifier, covariance (5 x 5), span, noise and misfit '
                             'must be finite numbers')
    return FilmParams(
        film=None if film is None else BucklingFilm(
            length=film['length_m'], width=film['width_m'], thickness=film['thickness_m'],
            convention=film['convention']),
        covariance=covariance, **values)
