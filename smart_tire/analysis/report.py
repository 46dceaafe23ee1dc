"""The summary of a run as lines to read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from smart_tire.analysis.passages import KINDS
from smart_tire.analysis.summary import Tree

UNKNOWN = '?'


def lines(summary: Tree) -> Iterator[str]:
    """Yield the lines for a whole summary as ``analyze`` writes it."""
    yield f'{summary["bag"]}: {number(summary["duration_s"], 1)} s'
    for topic, stream in summary['inputs'].items():
        yield (f'  {topic}: {stream["messages"]} messages at {number(stream["rate_hz"], 1)} Hz, '
               f'{stream["gaps"]} gaps, {stream["late"]} late')
    for text in summary['left_out']:
        yield f'  left out: {text}'
    yield from estimate_lines(summary['estimates'])
    yield from truth_lines(summary['against_truth'])


def estimate_lines(tree: Tree) -> Iterator[str]:
    """Yield what was estimated."""
    if 'odom' in tree:
        end, sigma = tree['odom']['end'], tree['odom']['end_sigma']
        yield (f'  odom: {number(tree["odom"]["distance_m"], 1)} m, ends at '
               + ', '.join(f'{name.split("_")[0]} {number(end[name], 2)} '
                           f'± {number(sigma[name], 2)} {name.split("_")[1]}' for name in end))
    for side in ('left', 'right'):
        if side in tree.get('wheel_slip', {}):
            slip = tree['wheel_slip'][side]
            yield (f'  slip {side}: mean {number(slip["mean"], 3)}, '
                   f'mean sigma {number(slip["mean_sigma"], 3)}')
    for wheel, told in tree['tire_friction'].items():
        yield (f'  friction {wheel}: {told["passages"]} passages, {told["telling"]} tell it: '
               f'median {number(told["median_single"], 2)}, last fused '
               f'{number(told["last_fused"], 2)} ± {number(told["last_fused_sigma"], 2)}')


def truth_lines(tree: Tree | None) -> Iterator[str]:
    """Yield how far the estimates are from the truth; nothing without one."""
    tree = tree or {}
    if 'pose' in tree:
        yield from _pose_lines(tree['pose'])
    for span, sides in tree.get('slip', {}).items():
        for side in ('left', 'right'):
            yield f'  slip {side}, {span}: {_slip_line(sides[side])}'
    for span, kinds in tree.get('friction', {}).items():
        for kind in KINDS:
            if isinstance(kinds, Mapping) and kind in kinds:
                yield f'  friction {kind}, {span}: {_friction_line(kinds[kind])}'
    if 'friction' in tree:
        yield f'  friction: {tree["friction"]["false_passages"]} passages that were none'


def _pose_lines(pose: Tree) -> Iterator[str]:
    yield (f'  position error: {number(pose["position_rms_m"], 2)} m rms, '
           f'{number(pose["position_end_m"], 2)} m at the end '
           f'({number(pose["end_percent_of_distance"], 1)} % of '
           f'{number(pose["distance_m"], 1)} m), '
           f'{number(pose["position_normalised_rms"], 2)} sigma')
    yield (f'  heading error: {number(pose["yaw"]["rms"], 3)} rad rms, '
           f'{number(pose["yaw_end_rad"], 3)} rad at the end, '
           f'{number(pose["yaw"]["normalised_rms"], 2)} sigma')
    for name, unit in (('v_x', 'm/s'), ('v_y', 'm/s'), ('yaw_rate', 'rad/s')):
        if pose['twist'] is not None:
            score = pose['twist'][name]
            yield (f'  {name} error: mean {number(score["mean"], 4)}, '
                   f'rms {number(score["rms"], 4)} {unit}, '
                   f'{number(score["normalised_rms"], 2)} sigma')


def _slip_line(slip: Tree) -> str:
    error = slip['error']
    return (f'mean {number(slip["estimated_mean"], 3)}, in truth {number(slip["true_mean"], 3)}; '
            f'error {number(error["rms"], 3)} rms, {number(error["normalised_rms"], 2)} sigma, '
            f'{percent(error["within_two"])} within two')


def _friction_line(score: Tree) -> str:
    return (f'{score["passages"]} passages, {score["found"]} found, {score["telling"]} tell it '
            f'({percent(score["telling_share"])}); median error '
            f'{percent(score["median_relative_error"])}, {percent(score["within_one"])} within '
            f'one sigma, {percent(score["within_two"])} within two')


def number(value: Any, digits: int) -> str:
    """Return a number with so many decimals; a question mark for what is not known."""
    return UNKNOWN if value is None else f'{value:.{digits}f}'


def percent(share: Any) -> str:
    """Return a share, 0 to 1, in percent."""
    return UNKNOWN if share is None else f'{100.0 * share:.0f} %'
