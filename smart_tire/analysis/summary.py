"""What a run tells, as one tree of plain values for ``summary.json`` and as lines to read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
import math
from typing import Any

import numpy as np

from smart_tire.analysis.friction_metrics import column, friction_scores, match, Matches, telling
from smart_tire.analysis.metrics import distance, pose_score, SIDES, slip_scores, Spans, within
from smart_tire.analysis.series import Floats, Series
from smart_tire.samples import Friction, WHEELS

Tree = dict[str, Any]
WHOLE = 'whole run'
DIGITS = 6  # significant; more than any estimate has


def plain(value: Any) -> Any:
    """Return ``value`` as JSON knows it: records as objects, what is not finite as null."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(inner) for inner in value]
    if isinstance(value, (float, np.floating)):
        return float(f'{value:.{DIGITS}g}') if math.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def estimates_tree(estimates: Series) -> Tree:
    """Return what was estimated, without any truth."""
    poses, slips = estimates.poses(), estimates.slips()
    tree: Tree = {}
    if len(poses.stamp_ns):
        x, y, yaw = poses.pose[-1] - poses.pose[0]
        tree['odom'] = {
            'messages': len(poses.stamp_ns), 'distance_m': distance(poses.pose[:, :2]),
            'end': {'x_m': x, 'y_m': y, 'yaw_rad': yaw},
            'end_sigma': dict(zip(('x_m', 'y_m', 'yaw_rad'),
                                  np.sqrt(np.diag(poses.pose_covariance[-1]))))}
    if len(slips.stamp_ns):
        tree['wheel_slip'] = {'messages': len(slips.stamp_ns)}
        for side, wheels in SIDES.items():
            ratio, sigma = slips.ratio[:, wheels], slips.sigma[:, wheels]
            moving = np.isfinite(ratio)
            tree['wheel_slip'][side] = {'mean': _mean(ratio[moving]),
                                        'mean_sigma': _mean(sigma[moving])}
    tree['tire_friction'] = {wheel: _wheel_tree(own) for wheel in WHEELS
                             if (own := [p for p in estimates.passages if p.wheel == wheel])}
    return plain(tree)


def _mean(values: Floats) -> float:
    return float(np.mean(values)) if len(values) else math.nan


def _wheel_tree(passages: Sequence[Friction]) -> Tree:
    single = column(passages, 'friction_coefficient_single')
    told = telling(single, column(passages, 'friction_coefficient_single', sigmas=True))
    last = max(passages, key=lambda passage: passage.stamp_ns)
    return {'passages': len(passages), 'telling': int(told.sum()),
            'median_single': float(np.median(single[told])) if told.any() else math.nan,
            'last_fused': last.friction_coefficient.value,
            'last_fused_sigma': last.friction_coefficient.sigma}


def truth_tree(estimates: Series, truth: Series, spans: Spans | None = None) -> Tree | None:
    """
    Return how far the estimates are from the truth; None where there is none.

    ``spans`` are judged by themselves too; without them the surfaces are.
    """
    spans = surfaces(truth.passages) if spans is None else spans
    tree: Tree = {}
    if (pose := pose_score(estimates.poses(), truth.poses())) is not None:
        tree['pose'] = pose
    if len(truth.slips().stamp_ns):
        own, true = estimates.slips(), truth.slips()
        tree['slip'] = {WHOLE: slip_scores(own, true),
                        **{name: slip_scores(own, true, span) for name, span in spans.items()}}
    if truth.passages:
        tree['friction'] = _friction_tree(match(estimates.passages, truth.passages), spans)
    return plain(tree) or None


def _friction_tree(matches: Matches, spans: Spans) -> Tree:
    stamps = np.array([truth.stamp_ns for truth, _ in matches.pairs], np.int64)
    offsets = np.array([(guess.stamp_ns - truth.stamp_ns) * 1e-9
                        for truth, guess in matches.pairs if guess is not None])
    parts = {name: [matches.pairs[i] for i in np.flatnonzero(within(stamps, span))]
             for name, span in spans.items()}
    return {'false_passages': len(matches.false),
            'stamp': {'mean_s': _mean(offsets), 'sigma_s': float(np.std(offsets))
                      if len(offsets) else math.nan},
            WHOLE: friction_scores(matches.pairs),
            **{name: friction_scores(pairs) for name, pairs in parts.items()}}


def surfaces(passages: Sequence[Friction]) -> Spans:
    """Return the stretches of time on each surface that the true ``passages`` tell apart."""
    spans: dict[str, list[tuple[int, int]]] = {}
    previous = ''
    for passage in sorted(passages, key=lambda passage: passage.stamp_ns):
        mu = passage.friction_coefficient.value
        name, stamp = f'mu {mu:.2f}', passage.stamp_ns
        start = spans[name].pop()[0] if name == previous else stamp
        spans.setdefault(name, []).append((start, stamp))
        previous = name
    return spans if len(spans) > 1 else {}
