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

"""Tables of the report, filled from the summary of an analysis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from smart_tire.analysis.errors import ErrorCurve
from smart_tire.analysis.metrics import Score, SIDES
from smart_tire.analysis.report import number, percent
from smart_tire.analysis.summary import Tree
from smart_tire.bags import BagTopic

ERROR_HEAD = ('mean error', 'rms', 'rms / σ', 'in 1 σ', 'in 2 σ')
PERCENT_EXPECTED = '1 σ: 68 %, 2 σ: 95 % if the estimator is consistent'


@dataclass(frozen=True)
class Table:
    """A table; the first column names the row."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    text_columns: int = 1  # leading columns aligned to the left; the others are numbers


def inputs_table(inputs: Tree) -> Table:
    """Return the regularity of the inputs."""
    rows = [[topic, str(one['messages']), number(one['rate_hz'], 1), str(one['gaps']),
             str(one['missing']), number(one['longest_gap_s'], 3), str(one['late']),
             str(one['rejected'])] for topic, one in sorted(inputs.items())]
    return Table(
        'Inputs of the estimators. Rate: inverse median period, per wheel if wheels share a '
        'topic. Gap: a period above 1.5 medians. Late: arrived after the estimators had passed '
        'their timestamp. Rejected: invalid content.',
        ['topic', 'messages', 'rate [Hz]', 'gaps', 'missing', 'longest gap [s]', 'late',
         'rejected'], rows)


def topics_table(topics: Mapping[str, BagTopic], used: Mapping[str, str]) -> Table:
    """Return all topics of the bag; ``used`` is name in the bag -> role."""
    rows = [[name, one.channel.type, used.get(name, 'not used'), str(one.messages)]
            for name, one in sorted(topics.items())]
    return Table('All topics in the bag.', ['topic', 'type', 'role', 'messages'], rows, 3)


def motion_table(estimates: Tree) -> Table | None:
    """Return the estimated end of the path; None without poses."""
    if 'odom' not in estimates:
        return None
    odom = estimates['odom']
    end, sigma = odom['end'], odom['end_sigma']
    rows = [['distance traveled [m]', number(odom['distance_m'], 2), '-']]
    rows += [[f'{name.split("_")[0]} at the end [{name.split("_")[1]}]', number(end[name], 3),
              number(sigma[name], 3)] for name in end]
    return Table('Estimated path relative to its start.', ['quantity', 'estimate', 'σ'], rows)


def slip_table(estimates: Tree) -> Table | None:
    """Return the mean slip of both sides; None without slip."""
    slip = estimates.get('wheel_slip')
    if not slip:
        return None
    rows = [[side, number(slip[side]['mean'], 4), number(slip[side]['mean_sigma'], 4)]
            for side in SIDES]
    return Table('Slip ratio while the wheels move, mean of the recording.',
                 ['side', 'mean slip [-]', 'mean σ [-]'], rows)


def friction_table(estimates: Tree) -> Table | None:
    """Return the friction of each instrumented wheel; None without crossings."""
    rows = [[wheel.replace('_', ' '), str(one['crossings']), str(one['informative']),
             number(one['median_single'], 3), number(one['last_fused'], 3),
             number(one['last_fused_sigma'], 3)]
            for wheel, one in estimates['tire_friction'].items()]
    return Table(
        'Friction coefficient of each instrumented wheel. Informative: relative σ of the single '
        'crossing below 60 %.',
        ['wheel', 'patch crossings', 'informative', 'median of single [-]', 'last fused [-]',
         'σ of the last [-]'], rows) if rows else None


def ground_table(estimates: Tree) -> Table | None:
    """Return the state of the ground and the center of mass; None without."""
    ground = estimates.get('ground_state')
    if not ground:
        return None
    rows = [[label, number(ground[name]['median'], digits),
             number(ground[name]['median_sigma'], digits)]
            for label, name, digits in (
                ('longitudinal stiffness C_x [N]', 'stiffness', 1),
                ('friction coefficient µ [-]', 'friction_coefficient', 3),
                ('rolling resistance [-]', 'rolling_resistance', 4),
                ('lateral share of the rolling resistance [-]', 'lateral_share', 2),
                ('lateral stiffness C_y / C_x [-]', 'lateral_stiffness_ratio', 2),
                ('center of mass x [m]', 'center_of_mass_x', 4),
                ('center of mass y [m]', 'center_of_mass_y', 4))]
    return Table('Ground, median of the recording.', ['quantity', 'estimate', 'σ'], rows)


def pose_table(pose: Tree) -> Table:
    """Return the errors of the path."""
    rows = [['position, rms [m]', number(pose['position_rms_m'], 3)],
            ['position, largest [m]', number(pose['position_max_m'], 3)],
            ['position, at the end [m]', number(pose['position_end_m'], 3)],
            ['position, at the end [% of distance]', number(pose['end_percent_of_distance'], 2)],
            ['true distance [m]', number(pose['distance_m'], 2)],
            ['heading, rms [rad]', number(pose['yaw']['rms'], 4)],
            ['heading, at the end [rad]', number(pose['yaw_end_rad'], 4)],
            ['displacement in one second, rms [m]', number(pose['relative_position_rms_m'], 4)],
            ['heading change in one second, rms [rad]', number(pose['relative_yaw_rms_rad'], 5)]]
    return Table('Errors of the path; truth aligned at the start.', ['error', 'value'], rows)


def slip_error_table(slips: Tree) -> Table:
    """Return the slip errors of sides and wheels, by surface."""
    rows = [[surface, name.replace('_', ' '), number(one['estimated_mean'], 4),
             number(one['true_mean'], 4), *_error_cells(one['error'], 4)]
            for surface, members in slips.items() for name, one in members.items()
            if one['error']['count']]
    return Table('Errors of the slip ratio, by surface (true friction coefficient µ); '
                 f'shares within {PERCENT_EXPECTED}.',
                 ['surface', 'wheel or side', 'mean estimate', 'mean truth', *ERROR_HEAD], rows, 2)


def friction_error_table(friction: Tree) -> Table:
    """Return the friction errors by surface and kind of crossing."""
    rows = [[surface, kind, str(one['crossings']), str(one['found']), str(one['informative']),
             percent(one['median_relative_error']), percent(one['median_bias'], '+'),
             percent(one['within_one']), percent(one['within_two']),
             percent(one['fused_median_relative_error'])]
            for surface, kinds in friction.items() if surface not in ('false_crossings', 'stamp')
            for kind, one in kinds.items()]
    return Table(
        'Errors of the friction coefficient, by surface and kind of crossing (traction and '
        'braking: slip above 0.05). Errors are relative medians; error, bias and shares within '
        f'1 σ and 2 σ are those of informative single crossings. {friction["false_crossings"]} '
        'estimated crossings have no true crossing.',
        ['surface', 'kind', 'crossings', 'found', 'informative', '|error|', 'bias', 'in 1 σ',
         'in 2 σ', '|error| fused'], rows, 2)


def _error_cells(score: Tree, digits: int) -> list[str]:
    return [number(score['mean'], digits), number(score['rms'], digits),
            number(score['normalized_rms'], 2), percent(score['within_one']),
            percent(score['within_two'])]


def consistency_table(errors: Sequence[ErrorCurve]) -> Table:
    """Return errors and normalized errors of all quantities."""
    return Table(
        'Errors of all quantities and their consistency. rms / σ: root mean square of the '
        f'normalized errors, 1 if σ is right; shares within {PERCENT_EXPECTED}. Slip counts where '
        'σ is below 0.5, single crossings where they are informative.',
        ['quantity', 'values', *ERROR_HEAD],
        [[f'{one.name} [{one.unit or "-"}]', str(one.score.count), *_score_cells(one.score)]
         for one in errors])


def _score_cells(score: Score) -> list[str]:
    return [f'{score.mean:.4f}', f'{score.rms:.4f}', f'{score.normalized_rms:.2f}',
            percent(score.within_one), percent(score.within_two)]
