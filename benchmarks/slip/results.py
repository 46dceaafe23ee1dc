"""Scores as named figures: one set per run, method and seed, and what seeds have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

from benchmarks.slip.scoring import PathScore, RunScore
from smart_tire.analysis.metrics import Score

Figures = dict[str, float]

ERRORS = (  # combined by their root mean square
    'slip_left', 'slip_right', 'slip_left_always', 'slip_right_always', 'speed', 'speed_always',
    'position_rms', 'position_end', 'position_rms_percent', 'position_end_percent',
    'heading_rms', 'heading_end', 'icr_x')  # all others by their mean


@dataclass(frozen=True)
class RunResult:
    """The figures of every method on one run."""

    run: str
    seed: int
    figures: dict[str, Figures]  # method -> figures


def figures_of(score: RunScore) -> Figures:
    """
    Return the figures of one score, in SI units but for per cent and microseconds.

    Without a further word slip and speed are judged where the run is; ``always`` is at all
    times. ``nees`` is a mean of normalised squared errors, ``within_two`` a share within two
    sigma (position: within the 95 % ellipse).
    """
    sides = {'slip_left': score.left, 'slip_right': score.right}
    figures = {'speed': score.speed.judged.rms, 'speed_always': score.speed.always.rms}
    for name, parts in sides.items():
        figures |= {name: parts.judged.rms, f'{name}_always': parts.always.rms}
    for name, judged in {**{name: parts.judged for name, parts in sides.items()},
                         'speed': score.speed.judged}.items():
        figures |= _statistics(name, judged)
    return figures | path_figures(score.path) | {
        'icr_x': score.icr_x, 'nis': score.nis, 'step_us': score.step_us}


def path_figures(path: PathScore) -> Figures:
    """Return the figures of a path alone."""
    return _statistics('heading', path.heading) | {
        'position_rms': path.rms_m, 'position_end': path.end_m,
        'position_rms_percent': path.rms_percent, 'position_end_percent': path.end_percent,
        'heading_rms': path.heading.rms, 'heading_end': abs(path.heading_end),
        'nees_position': path.nees, 'within_two_position': path.inside,
        'distance': path.distance_m}


def _statistics(name: str, judged: Score) -> Figures:
    """Return mean square and share within two of normalised errors; NaN without sigmas."""
    known = math.isfinite(judged.normalised_rms)
    return {f'nees_{name}': judged.normalised_rms ** 2,
            f'within_two_{name}': judged.within_two if known else math.nan}


def combined(seeds: Sequence[Mapping[str, float]]) -> Figures:
    """Return the figures of several seeds as one: errors by rms, statistics by mean."""
    return {name: (math.sqrt(_mean([one[name] ** 2 for one in seeds])) if name in ERRORS
                   else _mean([one[name] for one in seeds])) for name in seeds[0]}


def by_run(results: Sequence[RunResult]) -> dict[str, dict[str, Figures]]:
    """Return run -> method -> combined figures, in the order in which they first come."""
    runs: dict[str, list[RunResult]] = {}
    for result in results:
        runs.setdefault(result.run, []).append(result)
    return {run: {method: combined([seed.figures[method] for seed in seeds])
                  for method in seeds[0].figures} for run, seeds in runs.items()}


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else math.nan
