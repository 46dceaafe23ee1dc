# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Summary of inputs, estimates and errors as JSON-compatible values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
import math
from typing import Any

import numpy as np

from smart_tire.analysis.figure import SOURCES, TRUTH
from smart_tire.analysis.friction_metrics import (
    column, friction_scores, is_informative, Matches)
from smart_tire.analysis.metrics import (
    distance, Intervals, mean, median, pose_score, rms, SIDES, slip_scores, within)
from smart_tire.analysis.result import Comparison
from smart_tire.arrays import Instants
from smart_tire.checks.limits import MIN_GAP_PERIODS
from smart_tire.estimates import GroundEstimate
from smart_tire.estimation.streams import INPUTS
from smart_tire.messages import TOPICS
from smart_tire.recording import SampleArrays, seconds
from smart_tire.samples import (
    Friction, GROUND_ESTIMATES, MAX_ANGULAR_RATE, MAX_SPEED, NS_PER_S, WHEELS)

Tree = dict[str, Any]
WHOLE = 'whole recording'
MAX_SPEED_RATIO = 3.0     # of the body over its fastest wheel in the recording
MIN_DIVERGED_SPEED = 2.0  # m/s, so that a robot that slides or is carried has not diverged
CHANGING = 'stiffness', 'friction_coefficient', 'rolling_resistance'  # with the ground
CHANGE_SIGMAS = 3.0       # of both states, between two grounds
STATES_BEFORE = 10        # 5 s, that a state is compared with
SIGNIFICANT_DIGITS = 6  # more than any estimate has


def plain(value: Any) -> Any:
    """Return ``value`` with JSON types: dataclasses as objects, non-finite numbers as null."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(inner) for inner in value]
    if isinstance(value, (float, np.floating)):
        return float(f'{value:.{SIGNIFICANT_DIGITS}g}') if math.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def estimates_tree(estimates: SampleArrays, origin_ns: int = 0) -> Tree:
    """Return the summary of the estimates; times are seconds after ``origin_ns``."""
    poses, slips = estimates.poses(), estimates.slips()
    tree: Tree = {}
    if len(poses.stamp_ns):
        x, y, yaw = poses.pose[-1] - poses.pose[0]
        tree['odom'] = {
            'messages': len(poses.stamp_ns), 'distance_m': distance(poses.pose[:, :2]),
            'end': {'x_m': x, 'y_m': y, 'yaw_rad': yaw},
            'end_sigma': dict(zip(('x_m', 'y_m', 'yaw_rad'),
                                  np.sqrt(np.diag(poses.covariance[-1]))))}
    if len(slips.stamp_ns):
        tree['wheel_slip'] = {'messages': len(slips.stamp_ns)}
        for side, wheels in SIDES.items():
            ratio, sigma = slips.ratio[:, wheels], slips.sigma[:, wheels]
            moving = np.isfinite(ratio)
            tree['wheel_slip'][side] = {'mean': mean(ratio[moving]),
                                        'mean_sigma': mean(sigma[moving])}
    if len((ground := estimates.grounds()).stamp_ns):
        tree['ground_state'] = {
            'messages': len(ground.stamp_ns), **_medians(ground, slice(None)), 'grounds': [
                {'begin_s': time[rows.start], 'end_s': time[rows.stop - 1],
                 **_medians(ground, rows)}
                for time in [seconds(ground.stamp_ns, origin_ns)] for rows in ground_runs(ground)]}
    tree['tire_friction'] = {wheel: _wheel_tree(own, origin_ns) for wheel in WHEELS
                             if (own := [p for p in estimates.crossings if p.wheel == wheel])}
    return plain(tree)


def _medians(ground: GroundEstimate, rows: slice) -> Tree:
    return {name: {'median': median(one.value[rows]), 'median_sigma': median(one.sigma[rows])}
            for name in GROUND_ESTIMATES for one in [getattr(ground, name)]}


def ground_runs(ground: GroundEstimate) -> list[slice]:
    """
    Return the runs of states of one ground each, in order of time.

    Another one begins where a quantity that describes it differs by more than ``CHANGE_SIGMAS``
    from the median of the states before, and in the next state, too.
    """
    value, sigma = (np.column_stack([getattr(getattr(ground, name), part)
                                     for name in CHANGING]) for part in ('value', 'sigma'))
    begins = [0]
    for row in range(1, len(value) - 1):
        before = slice(max(begins[-1], row - STATES_BEFORE), row)
        usual, spread = (np.array([median(one) for one in part[before].T])
                         for part in (value, sigma))
        with np.errstate(invalid='ignore'):
            far = np.abs(value[row:row + 2] - usual) > CHANGE_SIGMAS * np.hypot(
                sigma[row:row + 2], spread)
        if far.all(axis=0).any():
            begins.append(row)
    return [slice(*ends) for ends in zip(begins, [*begins[1:], len(value)])]


def _wheel_tree(crossings: Sequence[Friction], origin_ns: int) -> Tree:
    single = column(crossings, 'friction_coefficient_single')
    usable = is_informative(single, column(crossings, 'friction_coefficient_single', sigmas=True))
    known = [one for one in crossings if math.isfinite(one.friction_coefficient.value)]
    last = max(known or crossings, key=lambda crossing: crossing.stamp_ns)
    return {'crossings': len(crossings), 'informative': int(usable.sum()),
            'median_single': median(single[usable]),
            'last_fused': last.friction_coefficient.value,
            'last_fused_sigma': last.friction_coefficient.sigma,
            'last_fused_s': (last.stamp_ns - origin_ns) / NS_PER_S if known else None}


def divergence(estimates: SampleArrays, wheel_speed: float) -> str:
    """
    Return where odometry is impossible, '' if it is not: the filter does not follow the inputs.

    Possible are finite values, with speed, yaw rate and their standard deviations below those of
    any ground vehicle, and of one whose fastest wheel has a ``wheel_speed`` [m/s] at its surface.
    """
    poses = estimates.poses()
    if not len(poses.stamp_ns):
        return ''
    fastest = min(MAX_SPEED, max(MIN_DIVERGED_SPEED, MAX_SPEED_RATIO * wheel_speed))
    limits = np.array([fastest, fastest, MAX_ANGULAR_RATE])
    off = ~(np.isfinite(poses.pose).all(axis=1)
            & np.isfinite(poses.covariance).all(axis=(1, 2))
            & (np.abs(poses.twist) <= limits).all(axis=1)
            & (poses.twist_sigma <= limits).all(axis=1))
    if not off.any():
        return ''
    first = int(np.argmax(off))
    speed, rate = float(np.hypot(*poses.twist[first, :2])), float(poses.twist[first, 2])
    return (f'the estimate diverges from {seconds(poses.stamp_ns, poses.stamp_ns[0])[first]:.1f} '
            f's on: {speed:.3g} m/s and {rate:.3g} rad/s, expected at most {fastest:.3g} m/s '
            f'and {MAX_ANGULAR_RATE:g} rad/s')


def evaluation(found: Comparison, intervals: Intervals | None = None) -> Tree:
    """Return the summary of the estimates and their errors; None against other references."""
    return {'estimates': estimates_tree(found.estimates, found.origin_ns), **{
        f'against_{name}': error_tree(found, intervals) if name == found.name else None
        for name in SOURCES}}


def errors_in(summary: Tree) -> tuple[str, Tree]:
    """Return the name of the reference and the errors in a summary, empty without."""
    return next(((name, tree) for name in SOURCES if (tree := summary.get(f'against_{name}'))),
                (TRUTH, {}))


def error_tree(found: Comparison, intervals: Intervals | None = None) -> Tree | None:
    """
    Return the errors against the reference; None without one.

    The errors are also given for each of ``intervals``, by default for each surface.
    """
    intervals = intervals or surfaces(found.reference.crossings)
    tree: Tree = {}
    if (pose := pose_score(found.poses, found.twist)) is not None:
        tree['pose'] = pose
        if found.baselines:
            tree['baselines'] = {name: pose_score(one) for name, one in found.baselines.items()}
    if len(found.slips.stamp_ns):
        tree['slip'] = {WHOLE: slip_scores(found.slips),
                        **{name: slip_scores(found.slips, interval)
                           for name, interval in intervals.items()}}
    if found.reference.crossings:
        tree['friction'] = _friction_tree(found.matches, intervals)
    return plain(tree) or None


def _friction_tree(matches: Matches, intervals: Intervals) -> Tree:
    stamps = np.array([truth.stamp_ns for truth, _ in matches.pairs], np.int64)
    offsets = np.array([(estimate.stamp_ns - truth.stamp_ns) * 1e-9
                        for truth, estimate in matches.pairs if estimate is not None])
    parts = {name: [matches.pairs[i] for i in np.flatnonzero(within(stamps, interval))]
             for name, interval in intervals.items()}
    return {'false_crossings': len(matches.false),
            'stamp': {'mean_s': mean(offsets), 'sigma_s': rms(offsets - mean(offsets))},
            WHOLE: friction_scores(matches.pairs),
            **{name: friction_scores(pairs) for name, pairs in parts.items()}}


def surfaces(crossings: Sequence[Friction]) -> Intervals:
    """Return the time intervals on each surface, by the friction of the true ``crossings``."""
    intervals: dict[str, list[tuple[int, int]]] = {}
    previous = ''
    for crossing in sorted(crossings, key=lambda crossing: crossing.stamp_ns):
        mu = crossing.friction_coefficient.value
        name, stamp = f'mu {mu:.2f}', crossing.stamp_ns
        start = intervals[name].pop()[0] if name == previous else stamp
        intervals.setdefault(name, []).append((start, stamp))
        previous = name
    return intervals if len(intervals) > 1 else {}


@dataclass(frozen=True)
class StreamStats:
    """Regularity of a stream; its nominal period is the median one."""

    messages: int
    rate_hz: float        # inverse median period; per wheel if wheels share a topic
    gaps: int             # periods longer than ``MIN_GAP_PERIODS`` medians
    missing: int          # messages missing in the gaps
    longest_gap_s: float  # 0 without gaps


def input_stats(inputs: SampleArrays) -> dict[str, StreamStats]:
    """Return topic -> statistics of the inputs; gaps of wheels that share a topic are summed."""
    return {topic: _combine([stream_stats(stream.stamp_ns) for stream in streams])
            for topic in INPUTS if (streams := inputs.of(TOPICS[topic].sample))}


def stream_stats(stamp_ns: Instants) -> StreamStats:
    """Return the statistics of the timestamps of one stream, in any order."""
    periods = np.diff(np.sort(stamp_ns))  # ns
    periods = periods[periods > 0]
    if not len(periods):
        return StreamStats(len(stamp_ns), 0.0, 0, 0, 0.0)
    median = float(np.median(periods, overwrite_input=True))
    gaps = periods[periods > round(MIN_GAP_PERIODS * median)]
    missing = int(np.sum(np.rint(gaps / median) - 1.0))
    return StreamStats(len(stamp_ns), NS_PER_S / median, len(gaps), missing,
                       int(gaps.max(initial=0)) / NS_PER_S)


def _combine(parts: list[StreamStats]) -> StreamStats:
    return StreamStats(
        sum(part.messages for part in parts), float(np.median([part.rate_hz for part in parts])),
        sum(part.gaps for part in parts), sum(part.missing for part in parts),
        max(part.longest_gap_s for part in parts))
