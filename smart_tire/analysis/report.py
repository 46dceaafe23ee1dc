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

"""Text report of a summary."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from smart_tire.analysis.metrics import SIDES
from smart_tire.analysis.summary import Tree

UNKNOWN = '-'


def lines(summary: Tree) -> Iterator[str]:
    """Yield the report of a summary written by ``analyze``."""
    yield f'{summary["bag"]}: {number(summary["duration_s"], 1)} s'
    for topic, stream in summary['inputs'].items():
        yield (f'  {topic}: {stream["messages"]} messages at {number(stream["rate_hz"], 1)} Hz, '
               f'{stream["gaps"]} gaps, {stream["late"]} late')
    for text in summary['left_out']:
        yield f'  skipped: {text}'
    yield from estimate_lines(summary['estimates'])
    yield from truth_lines(summary['against_truth'])
    if 'smoothed' in summary:
        yield ''
        yield '  RTS smoother:'
        yield from estimate_lines(summary['smoothed']['estimates'])
        yield from truth_lines(summary['smoothed']['against_truth'])


def estimate_lines(tree: Tree) -> Iterator[str]:
    """Yield the lines about the estimates."""
    if 'odom' in tree:
        end, sigma = tree['odom']['end'], tree['odom']['end_sigma']
        yield (f'  odom: {number(tree["odom"]["distance_m"], 1)} m, ends at '
               + ', '.join(f'{name.split("_")[0]} {number(end[name], 2)} '
                           f'± {number(sigma[name], 2)} {name.split("_")[1]}' for name in end))
    for side in SIDES:
        if side in tree.get('wheel_slip', {}):
            slip = tree['wheel_slip'][side]
            yield (f'  slip {side}: mean {number(slip["mean"], 3)}, '
                   f'mean sigma {number(slip["mean_sigma"], 3)}')
    for wheel, friction in tree['tire_friction'].items():
        yield (f'  friction {wheel}: {friction["crossings"]} crossings, '
               f'{friction["informative"]} informative: '
               f'median {number(friction["median_single"], 2)}, last fused '
               f'{number(friction["last_fused"], 2)} ± {number(friction["last_fused_sigma"], 2)}')


def truth_lines(tree: Tree | None) -> Iterator[str]:
    """Yield the errors against ground truth; nothing without ground truth."""
    if tree and 'pose' in tree:
        yield from _pose_lines(tree['pose'])
    yield from table_lines(tree or {})


def table_lines(tree: Tree) -> Iterator[str]:
    """Yield the tables of slip and friction errors, one row per interval."""
    if 'slip' in tree:
        yield ''
        yield from _slip_table(tree['slip'])
    if 'friction' in tree:
        yield ''
        yield from _friction_table(tree['friction'])


def _pose_lines(pose: Tree) -> Iterator[str]:
    yield (f'  position error: {number(pose["position_rms_m"], 2)} m rms, '
           f'{number(pose["position_end_m"], 2)} m at the end '
           f'({number(pose["end_percent_of_distance"], 1)} % of '
           f'{number(pose["distance_m"], 1)} m), '
           f'{number(pose["position_normalized_rms"], 2)} sigma')
    yield (f'  heading error: {number(pose["yaw"]["rms"], 3)} rad rms, '
           f'{number(pose["yaw_end_rad"], 3)} rad at the end, '
           f'{number(pose["yaw"]["normalized_rms"], 2)} sigma')
    for name, unit in (('v_x', 'm/s'), ('v_y', 'm/s'), ('yaw_rate', 'rad/s')):
        if pose['twist'] is not None:
            score = pose['twist'][name]
            yield (f'  {name} error: mean {number(score["mean"], 4)}, '
                   f'rms {number(score["rms"], 4)} {unit}, '
                   f'{number(score["normalized_rms"], 2)} sigma')


def _slip_table(slips: Tree) -> Iterator[str]:
    yield (f'{"mean slip":18}{"side":>6}{"estimate":>10}{"truth":>8}{"error":>8}{"rms":>8}'
           f'{"in 2 sigma":>12}')
    for name, sides in slips.items():
        for side in SIDES:
            score, error = sides[side], sides[side]['error']
            if error['count']:
                yield (f'{name:18}{side:>6}{score["estimated_mean"]:10.3f}'
                       f'{score["true_mean"]:8.3f}{error["mean"]:+8.3f}{error["rms"]:8.3f}'
                       f'{percent(error["within_two"]):>12}')


def _friction_table(friction: Tree) -> Iterator[str]:
    yield (f'{"friction":18}{"kind":>9}{"crossings":>11}{"found":>7}{"informative":>13}'
           f'{"|error|":>9}{"bias":>8}{"1 sigma":>9}{"2 sigma":>9}{"fused":>8}')
    for name, kinds in friction.items():
        if name in ('false_crossings', 'stamp'):
            continue
        for kind, score in kinds.items():
            yield (f'{name:18}{kind:>9}{score["crossings"]:11}{score["found"]:7}'
                   f'{percent(score["informative_share"]):>13}'
                   f'{percent(score["median_relative_error"]):>9}'
                   f'{percent(score["median_bias"], "+"):>8}{percent(score["within_one"]):>9}'
                   f'{percent(score["within_two"]):>9}'
                   f'{percent(score["fused_median_relative_error"]):>8}')
    yield f'false crossings: {friction["false_crossings"]}'


def number(value: Any, digits: int) -> str:
    """Return a number with ``digits`` decimals; a dash for None."""
    return UNKNOWN if value is None else f'{value:.{digits}f}'


def percent(share: Any, sign: str = '') -> str:
    """Return a share (0 to 1) in percent; a dash for None."""
    return UNKNOWN if share is None else f'{share:{sign}.0%}'
