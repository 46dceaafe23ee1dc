# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Content of the report: the sections of an analysis with their figures, tables and texts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from smart_tire.analysis.driven_paths import PATH
from smart_tire.analysis.errors import error_figure, error_groups, histogram_figure
from smart_tire.analysis.figure import (
    bucket_count, MAX_POINTS, MAX_SLIP_SIGMA, SOURCES, TRUTH)
from smart_tire.analysis.figures import (
    adhesion_figure, crossing_figure, friction_figure, ground_figure)
from smart_tire.analysis.friction_metrics import (
    column, is_informative, MAX_RELATIVE_SIGMA)
from smart_tire.analysis.html_report.page import Block, Folded, Picture, Report, Section
from smart_tire.analysis.metrics import SIDES
from smart_tire.analysis.motion_figures import (
    path_figure, velocity_figure, wheel_slip_figure, wheel_speed_figure)
from smart_tire.analysis.offline import Analysis, BagContents
from smart_tire.analysis.pipeline import (
    BAG, BagParams, DEFAULT, ESTIMATES, FILES, INPUTS, OVERHEAD, TRUTHS)
from smart_tire.analysis.result import Result
from smart_tire.analysis.summary import errors_in, Tree, WHOLE
from smart_tire.analysis.tables import (
    consistency_table, friction_error_table, friction_table, ground_table, inputs_table,
    motion_table, pose_table, robot_table, slip_error_table, slip_table, Table, text,
    topics_table)
from smart_tire.bags import match_by_name
from smart_tire.estimates import SlipEstimate
from smart_tire.parameters import NODE_PARAMS, Spec, specs
from smart_tire.parameters.files import value_text
from smart_tire.samples import Friction, NS_PER_S

ABOUT = (
    'Estimates are those of "smart_tire analyze" with the same parameters. Times are seconds '
    'after the first estimate. σ is one standard deviation as reported by the estimator; bands, '
    'bars and ellipses show 2σ.',
    f'A curve has at most {MAX_POINTS} points. Where it has more values, the smallest and largest '
    'value and the largest σ of each interval are kept, here of up to {interval:.2g} s, so that '
    'extremes are shown, but less detail than in the bag. Every point is an original value. '
    'Tables are computed from all values.',
    'Drag to zoom, double-click to reset; plots over time have linked axes. This file makes no '
    'network requests. The plots are drawn by plotly.js (MIT license), which it contains.')
PARAMETER_HEAD = ('parameter', 'value', 'unit', 'from', 'node', 'meaning')
BOTH = 'both'
PARAMETER_TITLES = {FILES: 'Parameters set in files; of several files the last one counts',
                    BAG: 'Parameters in the bag that differ from the default values'}


def report_of(analysis: Analysis, used: BagParams, name: str,
              facts: Sequence[tuple[str, str]]) -> Report:
    """
    Return the report of ``analysis``, which used the parameters ``used``.

    ``facts`` are labels and texts about the recording that the analysis does not know.
    Raises ValueError if nothing was estimated.
    """
    summary, result = analysis.summary, analysis.result
    if summary is None:
        raise ValueError('nothing was estimated: there is nothing to report')
    sections = [_recording(analysis, summary), _motion(result, summary, analysis.picture),
                _slip(result, summary), _friction(analysis, summary), _errors(result, summary),
                _left_out(analysis, summary), _parameters(used)]
    start, end = 0.0, round(max((result.span_ns[1] - result.origin_ns) / NS_PER_S, 1.0), 3)
    about = [text.format(interval=(end - start) / bucket_count()) for text in ABOUT]
    return Report(name, facts, sections, about, _tiles(summary), _notes(analysis, summary),
                  (start, end), result.segments)


def _notes(analysis: Analysis, summary: Tree) -> list[str]:
    inputs = summary['inputs'].values()
    host = analysis.contents.host
    counts = {'warnings of the bag reader': len(analysis.contents.warnings),
              'rejected messages': sum(one['rejected'] for one in inputs),
              'late messages': 0 if host else sum(one['late'] for one in inputs)}
    found = [f'{what}: {count}' for what, count in counts.items() if count]
    return [*(f'Error in the recording: {one.text}.' for one in analysis.contents.errors),
            *(f'{text.capitalize()}.' for text in [host, summary['diverged']] if text), *(
        [f'Of note: {"; ".join(found)}. See "Left out and warnings".'] if found else [])]


def _tiles(summary: Tree) -> list[tuple[str, str, str]]:
    estimates, (reference, against) = summary['estimates'], errors_in(summary)
    tiles = [('duration', f'{text(summary["duration_s"], ".1f")} s', '')]
    if odom := estimates.get('odom'):
        tiles.append(('distance', f'{text(odom["distance_m"], ".1f")} m', 'estimated'))
    if pose := against.get('pose'):
        tiles.append(('position error at the end', f'{text(pose["position_end_m"], ".2f")} m',
                      f'{text(pose["end_percent_of_distance"], ".2f")} % of the distance, by '
                      f'{SOURCES[reference]}' + ''.join(
                          f'; {name}: {text(base["position_end_m"], ".2f")} m'
                          for name, base in against.get('baselines', {}).items())))
        tiles.append(('heading error at the end', f'{text(pose["yaw_end_rad"], ".3f")} rad', ''))
    if slip := against.get('slip'):
        tiles += [(f'slip error, {side} side', text(slip[WHOLE][side]['error']['rms'], '.3f'),
                   'rms') for side in SIDES]
    for wheel, one in estimates['tire_friction'].items():
        tiles.append((f'friction, {wheel.replace("_", " ")}', text(one['last_fused'], '.2f'),
                      'unknown in all crossings' if one['last_fused_s'] is None else
                      f'± {2.0 * (one["last_fused_sigma"] or 0.0):.2f} (2σ) at '
                      f'{one["last_fused_s"]:.1f} s'))
    return tiles


def _recording(analysis: Analysis, summary: Tree) -> Section:
    topics = analysis.contents.topics
    roles = {**dict.fromkeys(INPUTS, 'input'), **dict.fromkeys(TRUTHS, SOURCES[TRUTH]),
             **dict.fromkeys(OVERHEAD, 'overhead camera'),
             **dict.fromkeys(ESTIMATES, 'recorded estimate, not read'),
             PATH: 'drawn in the path'}
    types = {name: topic.channel.type for name, topic in topics.items()}
    used = {name: roles[standard] for standard, name in match_by_name(roles, types).items()}
    return Section('recording', 'Recording', 'Recording', _known(
        inputs_table(summary['inputs']), wheel_speed_figure(analysis.result),
        Folded(f'All {len(topics)} topics in the bag', topics_table(topics, used))))


def _motion(result: Result, summary: Tree, picture: Path | None) -> Section:
    frame = None if picture is None else Picture(
        'Image of the overhead camera, with the path of the robot', picture)
    return Section('motion', 'Motion', 'Path and velocity', _known(
        motion_table(summary['estimates']), path_figure(result, errors=False), frame,
        velocity_figure(result)) or ['No odometry was estimated.'])


def _slip(result: Result, summary: Tree) -> Section:
    return Section('slip', 'Slip', 'Slip of the wheels', _known(
        slip_table(summary['estimates']), wheel_slip_figure(result)) or ['No slip was estimated.'])


def _friction(analysis: Analysis, summary: Tree) -> Section:
    result, tree = analysis.result, summary['estimates']
    return Section('friction', 'Friction', 'Friction and ground', _known(
        friction_table(tree), friction_figure(result), adhesion_figure(result),
        crossing_figure(result, analysis.robot),
        ground_table(tree), ground_figure(result), robot_table(tree)) or [
            'Neither friction nor the state of the ground was estimated.'])


def _errors(result: Result, summary: Tree) -> Section:
    reference, against = errors_in(summary)
    if not against:
        return Section('errors', 'Errors', 'Errors', [
            'Neither ground truth nor an overhead camera overlaps the estimates.'])
    groups = error_groups(result.filtered)
    return Section('errors', 'Errors', f'Errors against {SOURCES[reference]}', _known(
        pose_table(against, reference) if 'pose' in against else None,
        consistency_table([one for errors in groups.values() for one in errors]),
        histogram_figure(groups, reference),
        slip_error_table(against['slip'], None, reference) if 'slip' in against else None,
        friction_error_table(against['friction']) if 'friction' in against else None,
        *(error_figure(f'error_{name}', f'Errors of {name}', groups[name], reference)
          for name in ('pose', 'velocity', 'slip'))))


def _left_out(analysis: Analysis, summary: Tree) -> Section:
    contents = analysis.contents
    table = left_out_table(analysis.result, summary['inputs'])
    blocks: list[Block] = [table if table.rows else 'No message and no estimate was left out.']
    lines = skipped_lines(contents)
    blocks += ['Skipped:', lines] if lines else ['Nothing was skipped.']
    blocks += ['Warnings of the bag reader:', contents.warnings] if contents.warnings else [
        'The bag reader gave no warnings.']
    return Section('left_out', 'Left out', 'Left out and warnings', blocks)


def skipped_lines(contents: BagContents) -> list[str]:
    """Return what was skipped, without the warnings of the reader."""
    return [line for line in contents.skipped if line not in contents.warnings]


def left_out_table(result: Result, inputs: Tree) -> Table:
    """Return the numbers of messages and estimates that were left out, with the reasons."""
    rows = [[topic, reason, str(one[kind])] for topic, one in sorted(inputs.items())
            for kind, reason in (
                ('late', 'late: arrived after the estimators had passed its timestamp'),
                ('rejected', 'rejected: invalid content')) if one[kind]]
    return Table('Messages and estimates left out', ['what', 'reason', 'number'], [
        *rows, *_slip_rows(result.estimates.slips()),
        *_friction_rows(result.estimates.crossings)], 2)


def _slip_rows(slips: SlipEstimate) -> list[list[str]]:
    standstill = np.isnan(slips.ratio)
    unknown = ~standstill & ~(slips.sigma <= MAX_SLIP_SIGMA)
    return [['slip ratios of wheels', reason, f'{part.sum()} ({part.mean():.0%})']
            for part, reason in (
                (standstill, 'standstill: the slip ratio is undefined'),
                (unknown, f'σ above {MAX_SLIP_SIGMA}: not observable; not drawn, but counted in '
                          'the errors by surface')) if part.any()]


def _friction_rows(crossings: Sequence[Friction]) -> list[list[str]]:
    rows = []
    for wheel, count in sorted(Counter(one.wheel for one in crossings).items()):
        own = [one for one in crossings if one.wheel == wheel]
        single = column(own, 'friction_coefficient_single')
        sigma = column(own, 'friction_coefficient_single', sigmas=True)
        unknown = ~np.isfinite(single)
        vague = ~unknown & ~is_informative(single, sigma)
        rows += [[f'single crossings of {wheel.replace("_", " ")}', reason,
                  f'{part.sum()} of {count}'] for part, reason in (
                      (unknown, 'friction not observable, such as at low slip'),
                      (vague, f'uninformative: σ above {MAX_RELATIVE_SIGMA:.0%} of the value'))
                 if part.any()]
    return rows


def _parameters(used: BagParams) -> Section:
    given, default = parameter_tables(used)
    first: Block = given if given.rows else (
        'No parameter file sets a parameter of the estimators: all values are defaults.')
    return Section('parameters', 'Parameters', 'Parameters', [
        first, Folded(f'{len(default.rows)} parameters with default values', default)])


def parameter_tables(used: BagParams) -> tuple[Table, Table]:
    """Return the table of the parameters that were set, and that of the default values."""
    rows: dict[tuple[str, str, str], tuple[Spec, list[str]]] = {}
    nodes = used.params.by_node()
    for node, values in nodes.items():
        described = specs(NODE_PARAMS[node], values)
        origins = used.origins_of(node)
        for name, spec in described.items():
            value, source = value_text(values[name]), origins[name]
            rows.setdefault((name, value, source), (spec, []))[1].append(node)
    cells = [[name, value, spec.unit, source, BOTH if len(users) == len(nodes) else users[0],
              spec.meaning] for (name, value, source), (spec, users) in sorted(
                  rows.items(), key=lambda item: item[0])]
    return tuple(Table(title, PARAMETER_HEAD, [  # type: ignore[return-value]
        row for row in cells if (row[3] == DEFAULT) == is_default], len(PARAMETER_HEAD))
        for title, is_default in (
            (PARAMETER_TITLES.get(used.source, 'No parameters were given'), False),
            ('Parameters with their default values', True)))


def _known(*blocks: Block | None) -> list[Block]:
    """Return the blocks that have something to show."""
    return [block for block in blocks
            if block is not None and not (isinstance(block, Table) and not block.rows)]
