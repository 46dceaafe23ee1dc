# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tables of a summary, as text for the terminal and as data for the HTML report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from smart_tire.analysis.errors import ErrorCurve
from smart_tire.analysis.figure import TRUTH
from smart_tire.analysis.metrics import SIDES
from smart_tire.analysis.summary import errors_in, plain, Tree
from smart_tire.bags import BagTopic
from smart_tire.samples import NS_PER_S

UNKNOWN = '-'
FIRST_DATE_NS = 946_684_800 * NS_PER_S  # 2000-01-01; earlier timestamps are not dates
LATEX = str.maketrans({'σ': r'$\sigma$', 'µ': r'$\mu$', '\\': r'\textbackslash{}', **{
    sign: f'\\{sign}' for sign in '%_&#{}$'}})
CONSISTENT = '1 σ: 68 %, 2 σ: 95 % if the estimator is consistent'

# Columns, or rows, of a table: heading, key in the summary ("a.b" is nested), format.
Columns = Sequence[tuple[str, str, str]]
INPUTS: Columns = (
    ('messages', 'messages', '.0f'), ('rate [Hz]', 'rate_hz', '.1f'), ('gaps', 'gaps', '.0f'),
    ('missing', 'missing', '.0f'), ('longest gap [s]', 'longest_gap_s', '.3f'),
    ('late', 'late', '.0f'), ('rejected', 'rejected', '.0f'))
SLIP: Columns = (('mean slip [-]', 'mean', '.4f'), ('mean σ [-]', 'mean_sigma', '.4f'))
FRICTION: Columns = (
    ('patch crossings', 'crossings', '.0f'), ('informative', 'informative', '.0f'),
    ('median of single [-]', 'median_single', '.3f'), ('last fused [-]', 'last_fused', '.3f'),
    ('σ of the last [-]', 'last_fused_sigma', '.3f'), ('at [s]', 'last_fused_s', '.1f'))
GROUND: Columns = (
    ('C_x [N]', 'stiffness', '.1f'), ('µ [-]', 'friction_coefficient', '.3f'),
    ('rolling resistance [-]', 'rolling_resistance', '.4f'),
    ('lateral share [-]', 'lateral_share', '.2f'),
    ('C_y / C_x [-]', 'lateral_stiffness_ratio', '.2f'))
ROBOT: Columns = (
    ('center of mass x [m]', 'center_of_mass_x', '.4f'),
    ('center of mass y [m]', 'center_of_mass_y', '.4f'),
    ('position of the IMU x [m]', 'imu_x', '.4f'),
    ('position of the IMU y [m]', 'imu_y', '.4f'),
    ('friction of gears and axles over the nominal one [-]', 'motor_friction', '.2f'),
    ('true over measured motor torque [-]', 'torque_scale', '.3f'))
POSE: Columns = (
    ('position error, rms [m]', 'position_rms_m', '.3f'),
    ('position error, rms / σ [-]', 'position_normalized_rms', '.2f'),
    ('position error, in 2 σ', 'position_within_two', '.0%'),
    ('position error, largest [m]', 'position_max_m', '.3f'),
    ('position error at the end [m]', 'position_end_m', '.3f'),
    ('position error at the end [% of distance]', 'end_percent_of_distance', '.2f'),
    ('distance of the reference [m]', 'distance_m', '.2f'),
    ('displacement in one meter, rms error [m]', 'drift_per_meter_m', '.4f'),
    ('heading error, rms [rad]', 'yaw.rms', '.4f'),
    ('heading error at the end [rad]', 'yaw_end_rad', '.4f'),
    ('displacement in one second, rms error [m]', 'relative_position_rms_m', '.4f'),
    ('heading change in one second, rms error [rad]', 'relative_yaw_rms_rad', '.5f'))
SCORE: Columns = (
    ('mean error', 'mean', '+.4f'), ('rms', 'rms', '.4f'), ('rms / σ', 'normalized_rms', '.2f'),
    ('in 1 σ', 'within_one', '.0%'), ('in 2 σ', 'within_two', '.0%'))
CROSSINGS: Columns = (
    ('crossings', 'crossings', '.0f'), ('found', 'found', '.0f'),
    ('informative', 'informative', '.0f'), ('|error|', 'median_relative_error', '.0%'),
    ('bias', 'median_bias', '+.0%'), ('in 1 σ', 'within_one', '.0%'),
    ('in 2 σ', 'within_two', '.0%'), ('|error| fused', 'fused_median_relative_error', '.0%'))
TWIST = {'v_x': 'v_x [m/s]', 'v_y': 'v_y [m/s]', 'yaw_rate': 'yaw rate [rad/s]'}


@dataclass(frozen=True)
class Table:
    """A table; the first column names the row."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    text_columns: int = 1  # leading columns aligned to the left; the others are numbers
    note: str = ''         # what the title does not say
    links: Sequence[str | None] = ()  # of each row, what its name leads to in HTML

    def lines(self) -> Iterator[str]:
        """Yield the title, and the rows as text in aligned columns; nothing without rows."""
        if not self.rows:
            return
        yield f'\n{self.title}'
        every = [self.head, *self.rows]
        widths = [max(map(len, column)) for column in zip(*every)]
        for row in every:
            fields = [f'{text:<{width}}' if i < self.text_columns else f'{text:>{width}}'
                      for i, (text, width) in enumerate(zip(row, widths))]
            yield '  ' + '  '.join(fields).rstrip()

    def latex(self) -> str:
        """Return the rows as a tabular of LaTeX."""
        columns = ''.join('l' if i < self.text_columns else 'r' for i in range(len(self.head)))
        head, *rows = [' & '.join(text.translate(LATEX) for text in row) + r' \\'
                       for row in [self.head, *self.rows]]
        return '\n'.join([f'\\begin{{tabular}}{{{columns}}}', r'\hline', head, r'\hline', *rows,
                          r'\hline', r'\end{tabular}', ''])


def text(value: Any, form: str) -> str:
    """Return a number as text; a dash for None."""
    return UNKNOWN if value is None else f'{value:{form}}'


def date_text(stamp_ns: int) -> str:
    """Return a receive time as date and time; simulated time is not a date."""
    if stamp_ns < FIRST_DATE_NS:
        return f'date unknown (receive times start at {stamp_ns / NS_PER_S:.1f} s)'
    return f'{np.datetime64(stamp_ns, "ns").astype("M8[s]")} UTC'.replace('T', ' ', 1)


def value_of(tree: Tree | None, key: str) -> Any:
    """Return the value at ``key``, nested by dots; None in what is not known."""
    value: Any = tree
    for part in key.split('.'):
        value = None if value is None else value[part]
    return value


def cells(tree: Tree | None, columns: Columns) -> list[str]:
    """Return the texts of the values of a row."""
    return [text(value_of(tree, key), form) for _, key, form in columns]


def _head(first: Sequence[str], columns: Columns) -> list[str]:
    return [*first, *(heading for heading, _, _ in columns)]


def _words(name: str) -> str:
    return name.replace('_', ' ')


def lines(summary: Tree) -> Iterator[str]:
    """Yield the report of a summary written by ``analyze``."""
    yield f'{summary["bag"]}: {text(summary["duration_s"], ".1f")} s'
    yield from filter(None, [summary['host']])
    yield from inputs_table(summary['inputs']).lines()
    yield from ('', *(f'skipped: {line}' for line in summary['left_out']))
    filtered = result_tables(summary)
    for table in filtered:
        yield from table.lines()
    if 'smoothed' in summary:
        yield '\nRTS smoother:'
        for table in result_tables(summary['smoothed']):
            if table not in filtered:  # friction and ground are not smoothed
                yield from table.lines()


def result_tables(tree: Tree) -> list[Table]:
    """Return the tables of estimates and of errors against the reference."""
    return [*estimate_tables(tree['estimates']), *error_tables(tree)]


def estimate_tables(estimates: Tree) -> list[Table]:
    """Return the tables of what was estimated of motion, slip, friction and ground."""
    return [table for table in (motion_table(estimates), slip_table(estimates),
                                friction_table(estimates), ground_table(estimates),
                                robot_table(estimates)) if table.rows]


def error_tables(summary: Tree) -> list[Table]:
    """Return the tables of the errors against the reference of a summary."""
    reference, tree = errors_in(summary)
    found = []
    if 'pose' in tree:
        found += [pose_table(tree, reference), twist_table(tree['pose']['twist'] or {})]
    if 'slip' in tree:
        found.append(slip_error_table(tree['slip'], tuple(SIDES), reference))
    if 'friction' in tree:
        found.append(friction_error_table(tree['friction']))
    return found


def inputs_table(inputs: Tree) -> Table:
    """Return the regularity of the inputs."""
    return Table('Inputs of the estimators', _head(['topic'], INPUTS),
                 [[topic, *cells(one, INPUTS)] for topic, one in sorted(inputs.items())],
                 note='Rate: inverse median period, per wheel if wheels share a topic. Gap: a '
                 'period above 1.5 medians. Late: arrived after the estimators had passed their '
                 'timestamp. Rejected: invalid content.')


def topics_table(topics: Mapping[str, BagTopic], used: Mapping[str, str]) -> Table:
    """Return all topics of the bag; ``used`` is name in the bag -> role."""
    return Table('All topics in the bag', ['topic', 'type', 'role', 'messages'],
                 [[name, one.channel.type, used.get(name, 'not used'), str(one.messages)]
                  for name, one in sorted(topics.items())], 3)


def motion_table(estimates: Tree) -> Table:
    """Return the estimated end of the path."""
    rows = []
    if odom := estimates.get('odom'):
        rows = [['distance traveled [m]', text(odom['distance_m'], '.2f'), UNKNOWN]]
        rows += [[f'{name.split("_")[0]} at the end [{name.split("_")[1]}]', text(value, '.3f'),
                  text(odom['end_sigma'][name], '.3f')] for name, value in odom['end'].items()]
    return Table('Estimated path relative to its start', ['quantity', 'estimate', 'σ'], rows)


def slip_table(estimates: Tree) -> Table:
    """Return the mean slip of both sides."""
    slip = estimates.get('wheel_slip', {})
    return Table('Slip ratio while the wheels move, mean of the recording', _head(['side'], SLIP),
                 [[side, *cells(slip[side], SLIP)] for side in SIDES if side in slip])


def friction_table(estimates: Tree) -> Table:
    """Return the friction of each instrumented wheel."""
    return Table('Friction coefficient of each instrumented wheel', _head(['wheel'], FRICTION),
                 [[_words(wheel), *cells(one, FRICTION)]
                  for wheel, one in estimates['tire_friction'].items()],
                 note='Informative: relative σ of the single crossing below 60 %.')


def ground_table(estimates: Tree) -> Table:
    """Return the state of each ground, in order of time."""
    ground = estimates.get('ground_state') or {'grounds': []}
    return Table(
        'Grounds, in order of time; medians',
        ['from [s]', 'to [s]', *(head for name, _, _ in GROUND for head in (name, 'σ'))],
        [[text(one['begin_s'], '.1f'), text(one['end_s'], '.1f'), *(
            text(one[name][part], form) for _, name, form in GROUND
            for part in ('median', 'median_sigma'))] for one in ground['grounds']],
        0, 'C_x: longitudinal stiffness of a tire; µ: friction coefficient; rolling resistance '
        'over the load; lateral share of it; C_y: lateral stiffness. A ground ends where C_x, µ '
        'or rolling resistance change by more than 3 σ.')


def robot_table(estimates: Tree) -> Table:
    """Return what shows of the robot together with the ground."""
    ground = estimates.get('ground_state')
    return Table('Properties of the robot, median of the recording', ['quantity', 'estimate', 'σ'],
                 [[label, text(ground[name]['median'], form),
                   text(ground[name]['median_sigma'], form)]
                  for label, name, form in ROBOT] if ground else [])


def pose_table(tree: Tree, reference: str = TRUTH) -> Table:
    """Return the errors of the path, next to those of dead reckoning."""
    methods = {'estimate': tree['pose'], **tree.get('baselines', {})}
    return Table(f'Errors of the path; {reference} aligned at the start', ['error', *methods],
                 [[heading, *(cells(one, [(heading, key, form)])[0] for one in methods.values())]
                  for heading, key, form in POSE])


def twist_table(twist: Tree) -> Table:
    """Return the errors of the velocities."""
    return Table('Errors of the velocity', _head(['quantity'], SCORE),
                 [[label, *cells(twist[name], SCORE)]
                  for name, label in TWIST.items() if name in twist])


def slip_error_table(slips: Tree, members: Sequence[str] | None = None,
                     reference: str = TRUTH) -> Table:
    """Return the slip errors of sides and wheels, or of ``members`` only, by surface."""
    columns: Columns = (('mean estimate', 'estimated_mean', '.4f'),
                        (f'mean {reference}', 'true_mean', '.4f'))
    return Table('Errors of the slip ratio, by surface',
                 _head(['surface', 'wheel or side'], (*columns, *SCORE)),
                 [[surface, _words(name), *cells(one, columns), *cells(one['error'], SCORE)]
                  for surface, found in slips.items() for name, one in found.items()
                  if one['error']['count'] and (members is None or name in members)], 2,
                 f'Surfaces by true friction coefficient µ; shares within {CONSISTENT}.')


def friction_error_table(friction: Tree) -> Table:
    """Return the friction errors by surface and kind of crossing."""
    return Table(
        'Errors of the friction coefficient, by surface and kind of crossing; '
        f'{friction["false_crossings"]} false crossings',
        _head(['surface', 'kind'], CROSSINGS),
        [[surface, kind, *cells(one, CROSSINGS)]
         for surface, kinds in friction.items() if surface not in ('false_crossings', 'stamp')
         for kind, one in kinds.items()], 2,
        'Traction and braking: slip above 0.05. Errors are relative medians; error, bias and '
        'shares within 1 σ and 2 σ are those of informative single crossings. A false crossing '
        'is an estimated one without a true one.')


def consistency_table(errors: Sequence[ErrorCurve]) -> Table:
    """Return errors and normalized errors of all quantities."""
    columns: Columns = (('values', 'count', '.0f'), *SCORE)
    return Table('Errors of all quantities and their consistency', _head(['quantity'], columns),
                 [[f'{one.name} [{one.unit or "-"}]', *cells(plain(one.score), columns)]
                  for one in errors],
                 note='rms / σ: root mean square of the normalized errors, 1 if σ is right; '
                 f'shares within {CONSISTENT}. Slip counts where σ is below 0.5, single crossings '
                 'where they are informative.')
