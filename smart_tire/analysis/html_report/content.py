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

"""Content of the report: the sections of an analysis with their figures, tables and texts."""

from __future__ import annotations

import numpy as np
from smart_tire.analysis.bag_params import BagParams
from smart_tire.analysis.driven_paths import PATH
from smart_tire.analysis.errors import (
    ErrorCurve, friction_errors, pose_errors, slip_errors, twist_errors)
from smart_tire.analysis.figures import busiest_segments
from smart_tire.analysis.friction_metrics import match, stamps_of
from smart_tire.analysis.html_report import motion_figures, tables
from smart_tire.analysis.html_report.error_figures import error_figure, histogram_figure
from smart_tire.analysis.html_report.friction_figures import adhesion_figure, friction_figure
from smart_tire.analysis.html_report.left_out import left_out_table, skipped_lines
from smart_tire.analysis.html_report.model import Block, Facts, Folded, Report, Section
from smart_tire.analysis.html_report.parameters import parameter_tables
from smart_tire.analysis.metrics import SIDES
from smart_tire.analysis.offline import Analysis
from smart_tire.analysis.pipeline import ESTIMATES, INPUTS, TRUTHS
from smart_tire.analysis.report import number
from smart_tire.analysis.series import seconds, Series, time_origin
from smart_tire.analysis.summary import Tree, WHOLE
from smart_tire.messages import find_topic


def report_of(analysis: Analysis, used: BagParams, facts: Facts) -> Report:
    """
    Return the report of ``analysis``, which used the parameters ``used``.

    Raises ValueError if nothing was estimated.
    """
    origin = time_origin(analysis.estimates)
    summary = analysis.summary
    if summary is None:
        raise ValueError('nothing was estimated: there is nothing to report')
    sections = [_recording(analysis, summary, origin), _motion(analysis, summary, origin),
                _slip(analysis, summary, origin), _friction(analysis, summary, origin),
                _errors(analysis, summary, origin), _left_out(analysis, summary),
                _parameters(used)]
    return Report(facts, _tiles(analysis, summary), _notes(analysis, summary), sections,
                  _time_range(analysis.estimates, origin),
                  busiest_segments(analysis.contents.inputs, origin))


def _notes(analysis: Analysis, summary: Tree) -> list[str]:
    inputs = summary['inputs'].values()
    counts = {'warnings of the bag reader': len(analysis.contents.warnings),
              'rejected messages': sum(one['rejected'] for one in inputs),
              'late messages': sum(one['late'] for one in inputs)}
    found = [f'{what}: {count}' for what, count in counts.items() if count]
    return [f'Of note: {"; ".join(found)}. See "Left out and warnings".'] if found else []


def _time_range(estimates: Series, origin_ns: int) -> tuple[float, float]:
    stamps = np.concatenate([estimates.slips().stamp_ns, estimates.poses().stamp_ns,
                             stamps_of(estimates.crossings)])
    end = float(seconds(stamps, origin_ns).max())
    return 0.0, round(max(end, 1.0), 3)


def _tiles(analysis: Analysis, summary: Tree) -> list[tuple[str, str, str]]:
    estimates, against = summary['estimates'], summary['against_truth'] or {}
    tiles = [('duration', f'{number(summary["duration_s"], 1)} s', '')]
    if 'odom' in estimates:
        tiles.append(('distance', f'{number(estimates["odom"]["distance_m"], 1)} m', 'estimated'))
    if 'pose' in against:
        pose = against['pose']
        tiles.append(('position error at the end', f'{number(pose["position_end_m"], 2)} m',
                      f'{number(pose["end_percent_of_distance"], 2)} % of the distance'))
        tiles.append(('heading error at the end', f'{number(pose["yaw_end_rad"], 3)} rad', ''))
    if 'slip' in against:
        for side in SIDES:
            score = against['slip'][WHOLE][side]['error']
            tiles.append((f'slip error, {side} side', number(score['rms'], 3), 'rms'))
    for wheel, one in estimates['tire_friction'].items():
        tiles.append((f'friction, {wheel.replace("_", " ")}', number(one['last_fused'], 2),
                      f'± {number(2.0 * (one["last_fused_sigma"] or 0.0), 2)} (2σ) at the end'))
    return tiles


def _recording(analysis: Analysis, summary: Tree, origin: int) -> Section:
    topics, roles = analysis.contents.topics, {}
    for name in topics:
        topic = find_topic(name)
        if topic is not None:
            roles[name] = ('input' if topic.name in INPUTS else
                           'ground truth' if topic.name in TRUTHS else
                           'recorded estimate, not read' if topic.name in ESTIMATES else
                           'drawn in the path' if topic.name == PATH else
                           'not used')
    return Section('recording', 'Recording', 'Recording', _known(
        tables.inputs_table(summary['inputs']),
        motion_figures.wheel_speed_figure(analysis.contents.inputs, origin),
        Folded(f'All {len(topics)} topics in the bag', tables.topics_table(topics, roles))))


def _motion(analysis: Analysis, summary: Tree, origin: int) -> Section:
    estimates, truth = analysis.estimates, analysis.contents.truth
    return Section('motion', 'Motion', 'Path and velocity', _known(
        tables.motion_table(summary['estimates']), motion_figures.path_figure(
            estimates, truth, analysis.contents.paths.wanted()),
        motion_figures.velocity_figure(estimates, truth, origin)) or [
            'No odometry was estimated.'])


def _slip(analysis: Analysis, summary: Tree, origin: int) -> Section:
    estimates, truth = analysis.estimates, analysis.contents.truth
    return Section('slip', 'Slip', 'Slip of the wheels', _known(
        tables.slip_table(summary['estimates']),
        motion_figures.slip_figure(estimates, truth, origin)) or ['No slip was estimated.'])


def _friction(analysis: Analysis, summary: Tree, origin: int) -> Section:
    estimates, truth, tree = analysis.estimates, analysis.contents.truth, summary['estimates']
    return Section('friction', 'Friction', 'Friction and ground', _known(
        tables.friction_table(tree), friction_figure(estimates, truth, origin),
        adhesion_figure(estimates, truth, origin), tables.ground_table(tree),
        motion_figures.ground_figure(estimates, truth, origin)) or [
            'Neither friction nor the state of the ground was estimated.'])


def _errors(analysis: Analysis, summary: Tree, origin: int) -> Section:
    against = summary['against_truth']
    if not against:
        return Section('errors', 'Errors', 'Errors against ground truth',
                       ['The bag contains no ground truth that overlaps the estimates.'])
    groups = _error_groups(analysis.estimates, analysis.contents.truth, origin)
    figures = [error_figure(f'error_{name}', f'Errors of {title}', errors)
               for name, (title, errors) in groups.items() if name != 'friction']
    histogram = histogram_figure([
        (title, np.concatenate([one.normalized for one in errors]))
        for title, errors in groups.values() if errors])
    return Section('errors', 'Errors', 'Errors against ground truth', _known(
        tables.pose_table(against['pose']) if 'pose' in against else None,
        tables.consistency_table([one for _, errors in groups.values() for one in errors]),
        histogram, tables.slip_error_table(against['slip']) if 'slip' in against else None,
        tables.friction_error_table(against['friction']) if 'friction' in against else None,
        *figures))


def _error_groups(estimates: Series, truth: Series,
                  origin: int) -> dict[str, tuple[str, list[ErrorCurve]]]:
    matches = match(estimates.crossings, truth.crossings)
    return {'pose': ('pose', pose_errors(estimates, truth, origin)),
            'twist': ('velocity', twist_errors(estimates, truth, origin)),
            'slip': ('slip', slip_errors(estimates, truth, origin)),
            'friction': ('friction', friction_errors(matches, origin))}


def _left_out(analysis: Analysis, summary: Tree) -> Section:
    contents = analysis.contents
    table = left_out_table(analysis, summary['inputs'])
    blocks: list[Block] = [table if table.rows else 'No message and no estimate was left out.']
    lines = skipped_lines(contents)
    blocks += ['Skipped:', lines] if lines else ['Nothing was skipped.']
    blocks += ['Warnings of the bag reader:', contents.warnings] if contents.warnings else [
        'The bag reader gave no warnings.']
    return Section('left_out', 'Left out', 'Left out and warnings', blocks)


def _parameters(used: BagParams) -> Section:
    given, default = parameter_tables(used)
    first: Block = given if given.rows else (
        'No parameter file sets a parameter of the estimators: all values are defaults.')
    return Section('parameters', 'Parameters', 'Parameters', [
        first, Folded(f'{len(default.rows)} parameters with default values', default)])


def _known(*blocks: Block | None) -> list[Block]:
    return [block for block in blocks if block is not None]
