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

"""Figures of friction, stiffness and motion, pooled over seeds and wheels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
import math

from benchmarks.friction.forces import Errors, ForceResult, Motion, Variant, WheelPart
from benchmarks.friction.records import concatenated, FUSED, Mask, Rows, selected_rows
from benchmarks.friction.scoring import Figures
import numpy as np
from smart_tire.analysis.metrics import rms, score
from smart_tire.analysis.series import Floats
from smart_tire.parameters.simulation import GroundParams

ALL_GROUNDS = ''            # part of a run that contains all crossings
EXCITED_SUFFIX = '_excited'  # figures of crossings after 5 s with a turn, start or stop
QUANTITIES = {'mu': FUSED, 'stiffness': 'stiffness'}

PartKey = tuple[str, str]  # run, ground


@dataclass(frozen=True)
class Row:
    """Figures of one run or of one of its grounds, by variant."""

    run: str
    ground: str
    variants: dict[str, Figures]


def rows_of(results: Iterable[ForceResult],
            grounds: Mapping[str, GroundParams]) -> dict[PartKey, Row]:
    """
    Return the figures of each run, and of its grounds if it has several.

    ``grounds`` gives the ground of each run.
    """
    runs: dict[str, list[ForceResult]] = {}
    for result in results:
        runs.setdefault(result.run, []).append(result)
    found: dict[PartKey, Row] = {}
    for run, seeds in runs.items():
        names = _present(seeds, grounds[run])
        for name in (ALL_GROUNDS, *(names if len(names) > 1 else ())):
            found[run, name] = Row(run, name, {
                variant: _figures([seed.variants[variant] for seed in seeds],
                                  _on(grounds[run], name)) for variant in seeds[0].variants})
    return found


def _present(seeds: Sequence[ForceResult], ground: GroundParams) -> list[str]:
    """Return the surfaces of ``ground`` with counted crossings."""
    parts = [part for seed in seeds for variant in seed.variants.values()
             for part in variant.wheels.values()]
    return [name for name in ground.names
            if any((part.counted & _on(ground, name)(part.rows)).any() for part in parts)]


def _on(ground: GroundParams, name: str) -> Callable[[Rows], Mask]:
    """Return a function that selects the crossings on the surface ``name``, or all."""
    def select(rows: Rows) -> Mask:
        if name == ALL_GROUNDS:
            return np.ones(len(rows.found), bool)
        i = ground.names.index(name)
        return np.asarray(np.isclose(rows.true[FUSED], ground.friction[i], rtol=1e-3)
                          & np.isclose(rows.true['stiffness'], ground.stiffness[i], rtol=1e-3))
    return select


def _figures(variants: Sequence[Variant], select: Callable[[Rows], Mask]) -> Figures:
    parts = [part for variant in variants for part in variant.wheels.values()]
    figures = _friction_figures(parts, [part.counted & select(part.rows) for part in parts])
    excited = _friction_figures(
        parts, [part.counted & part.excited & select(part.rows) for part in parts])
    revolutions = [one.revolutions for part in parts for one in part.surfaces if not one.first]
    return figures | {f'{name}{EXCITED_SUFFIX}': value for name, value in excited.items()} | {
        'jump_revolutions': float(np.median(revolutions)) if revolutions else math.nan,
        'jump_worst': max(revolutions, default=math.nan),
        'speedup': float(np.mean([variant.speedup for variant in variants])),
    } | _motion_figures([variant.motion for variant in variants])


def _friction_figures(parts: Sequence[WheelPart], masks: Sequence[Mask]) -> Figures:
    rows = concatenated([selected_rows(part.rows, mask) for part, mask in zip(parts, masks)])
    figures: Figures = {'crossings': float(len(rows.found))}
    for name, quantity in QUANTITIES.items():
        true = rows.true[quantity]
        figures |= consistency(name, rows.value[quantity] / true - 1.0,
                               rows.sigma[quantity] / true)
    sliding = 1.0 - rows.true['adhesion_ratio']
    share = (rows.true['adhesion_ratio'] - rows.value['adhesion_ratio']) / sliding
    known = np.isfinite(share) & (sliding > 0.0)
    return figures | {'sliding_bias': _quantile(share[known], 0.5)}


def consistency(name: str, error: Floats, sigma: Floats) -> Figures:
    """Return the figures of relative errors; normalized ones over those with a sigma."""
    finite = np.isfinite(error) & np.isfinite(sigma)
    error, sigma = error[finite], sigma[finite]
    found = score(error, sigma)
    return {f'{name}_finite': float(np.mean(finite)) if len(finite) else math.nan,
            f'{name}_median': _quantile(np.abs(error), 0.5),
            f'{name}_90': _quantile(np.abs(error), 0.9), f'{name}_bias': _quantile(error, 0.5),
            f'{name}_sigma': _quantile(sigma, 0.5),
            f'{name}_within': found.within_two, f'{name}_nees': found.normalized_rms**2}


def _motion_figures(motions: Sequence[Motion]) -> Figures:
    def joined(of: Callable[[Motion], Errors], name: str) -> Figures:
        error, sigma = (np.concatenate(one) for one in zip(*map(of, motions)))
        found = score(error, sigma)
        return {name: found.rms, f'{name}_sigma': rms(sigma[np.isfinite(sigma)]),
                f'{name}_within': found.within_two, f'{name}_nees': found.normalized_rms**2}
    return (joined(lambda one: one.steady[0], 'slip_left')
            | joined(lambda one: one.steady[1], 'slip_right')
            | joined(lambda one: one.all_times[0], 'slip_left_all_times')
            | joined(lambda one: one.all_times[1], 'slip_right_all_times')
            | joined(lambda one: one.straight, 'common_slip')
            | joined(lambda one: one.lateral, 'speed_y'))


def pooled(results: Sequence[ForceResult], variant: str) -> Figures:
    """Return the consistency over all counted crossings of all runs."""
    parts = [part for result in results for part in result.variants[variant].wheels.values()]
    return _friction_figures(parts, [part.counted for part in parts])


def _quantile(values: Floats, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else math.nan
