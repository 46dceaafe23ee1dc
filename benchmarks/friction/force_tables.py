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

"""Tables of friction, stiffness and motion, without and with motor torque."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import math

from benchmarks.friction.force_results import (
    ALL_GROUNDS, EXCITED_SUFFIX, PartKey, pooled, Row)
from benchmarks.friction.forces import ForceResult, NO_TORQUE, TORQUE, VARIANTS
from benchmarks.friction.previous_results import PREVIOUS_RESULTS
from benchmarks.friction.reference_results import FORCE_REFERENCES
from benchmarks.friction.requirements import (
    limits_of, MIN_WITHIN_TWO, POOLED_NEES, POOLED_WITHIN_TWO)
from benchmarks.friction.scoring import Figures
from benchmarks.tables import new_table, number
from rich.table import Table
from rich.text import Text

Rows = Mapping[PartKey, Row]

FORCE_NOTES = f"""\
Forces: crossings count from the fifth revolution of the wheel after the start and after each
change of ground under it (mu jumps: from the fourth). before: results before forces were
estimated; 5 s: crossings after 5 s of motion with the same C_x and a turn, start or stop in it.
Errors are relative: median / 90 % quantile of absolute errors; in: share within two sigma; NEES:
normalized estimation error squared, 1 if consistent; sliding: median relative error of the sliding
share of the patch. v_y: rms while moving. straight: rms of the mean slip of both sides while
cruising straight, from the fifth revolution.
! outside the requirements (benchmarks/friction/requirements.py), in particular less than
{MIN_WITHIN_TWO:g} within two sigma.
"""


def force_tables(rows: Rows, results: Sequence[ForceResult],
                 titles: Mapping[str, str]) -> Iterator[Table]:
    """Yield all tables of forces."""
    yield friction_table(rows, results, titles)
    yield stiffness_table(rows, results, titles)
    yield motion_table(rows, titles)
    yield slip_table(rows, titles)


def friction_table(rows: Rows, results: Sequence[ForceResult],
                   titles: Mapping[str, str]) -> Table:
    """Return the errors of the fused mu and their consistency."""
    table = new_table(
        'Fused mu: relative error [%]', 'counted', 'before:\nerror', '\nin', '\nNEES',
        'no torque:\nerror', '5 s:\nerror', '\nin', '\nNEES', 'torque:\nerror', '\nin', '\nNEES',
        'sliding\n[%]', 'refe-\nrence')
    for (run, ground), row in rows.items():
        reference = FORCE_REFERENCES.get((run, ground))
        plain, torque = row.variants[NO_TORQUE], row.variants[TORQUE]
        limit, tight = (limits_of(run, ground, variant) for variant in (NO_TORQUE, TORQUE))
        table.add_row(
            _label(row, titles), *_friction(PREVIOUS_RESULTS.get((run, ground))),
            _pair(plain, 'mu'),
            _limited(plain, f'mu_median{EXCITED_SUFFIX}', f'mu_90{EXCITED_SUFFIX}',
                     limit.mu_median, limit.mu_90),
            *_consistency(plain, 'mu'),
            _limited(torque, 'mu_median', 'mu_90', tight.mu_median, tight.mu_90),
            *_consistency(torque, 'mu'), _marked(
                _percent(torque['sliding_bias']), not abs(torque['sliding_bias']) > tight.sliding),
            '' if reference is None else _percent(reference.mu))
    table.add_section()
    table.add_row('all', '', '', '', '', '', *_pooled(results, NO_TORQUE, 'mu'), '',
                  *_pooled(results, TORQUE, 'mu'), '', '')
    return table


def stiffness_table(rows: Rows, results: Sequence[ForceResult],
                    titles: Mapping[str, str]) -> Table:
    """Return the errors of C_x and their consistency."""
    table = new_table(
        'C_x of the ground: relative error [%]', 'counted', 'before:\nerror', '\nin', '\nNEES',
        'no torque:\nerror', '\nbias', '\nin', '\nNEES', 'torque:\nerror', '\nbias', '\nin',
        '\nNEES', 'refe-\nrence')
    for (run, ground), row in rows.items():
        before = PREVIOUS_RESULTS.get((run, ground))
        reference = FORCE_REFERENCES.get((run, ground))
        cells: list[str | Text] = []
        for variant in VARIANTS:
            own, limit = row.variants[variant], limits_of(run, ground, variant)
            cells += [_limited(own, 'stiffness_median', 'stiffness_90', limit.stiffness),
                      _percent(own['stiffness_bias']), *_consistency(own, 'stiffness')]
        table.add_row(_label(row, titles), *_stiffness(before), *cells,
                      '' if reference is None else _percent(reference.stiffness))
    table.add_section()
    table.add_row('all', '', '', '', '', '', *_pooled(results, NO_TORQUE, 'stiffness'), '', '',
                  *_pooled(results, TORQUE, 'stiffness'), '')
    return table


def motion_table(rows: Rows, titles: Mapping[str, str]) -> Table:
    """Return the errors of the lateral speed, of the common slip, and revolutions."""
    table = new_table(
        'Lateral speed, and mean slip of both sides while cruising straight', '',
        'v_y [mm/s]:\nbefore', '\nno torque', '\ntorque', '\nreference',
        'straight slip:\nbefore', '\nno torque', '\ntorque', 'revs until 10 %:\nno torque',
        '\ntorque')
    for (run, ground), row in rows.items():
        if ground == ALL_GROUNDS:
            reference = FORCE_REFERENCES.get((run, ground))
            table.add_row(
                titles[run], *_speeds(row),
                '' if reference is None else number(1e3 * reference.speed_y, 1),
                *_straight(row), *(_jumps(row, variant) for variant in VARIANTS))
    return table


def slip_table(rows: Rows, titles: Mapping[str, str]) -> Table:
    """Return the errors of the slips of both sides."""
    table = new_table('Slip: rms error of left / right side', '', *(
        f'{title}:\n{variant}' if i == 0 else f'\n{variant}'
        for title in ('steady', 'all times')
        for i, variant in enumerate(('before', *VARIANTS.values()))))
    for (run, ground), row in rows.items():
        if ground == ALL_GROUNDS:
            table.add_row(titles[run], *_slips(row, ''), *_slips(row, '_all_times'))
    return table


def _label(row: Row, titles: Mapping[str, str]) -> str:
    title = titles[row.run] if row.ground == ALL_GROUNDS else f'  {row.ground.replace("_", " ")}'
    finite = row.variants[TORQUE]['mu_finite']
    share = '' if finite > 0.995 else f' of {number(100.0 * finite, 0)} %'
    return f'{title} {row.variants[TORQUE]["crossings"]:.0f}{share}'


def _friction(before: Figures | None) -> list[str]:
    if before is None:
        return [''] * 3
    return [_pair(before, 'mu'), number(before['mu_within'], 2), number(before['mu_nees'], 1)]


def _stiffness(before: Figures | None) -> list[str]:
    if before is None:
        return [''] * 3
    return [_pair(before, 'stiffness'), number(before['stiffness_within'], 2),
            number(before['stiffness_nees'], 1)]


def _consistency(own: Figures, name: str) -> list[str | Text]:
    within = own[f'{name}_within']
    return [_marked(number(within, 2), not within < MIN_WITHIN_TWO),
            number(own[f'{name}_nees'], 1)]


def _pooled(results: Sequence[ForceResult], variant: str, name: str) -> list[Text]:
    own = pooled(results, variant)
    within, nees = own[f'{name}_within'], own[f'{name}_nees']
    return [_marked(number(within, 2), POOLED_WITHIN_TWO[0] <= within <= POOLED_WITHIN_TWO[1]),
            _marked(number(nees, 1), POOLED_NEES[0] <= nees <= POOLED_NEES[1])]


def _speeds(row: Row) -> list[str | Text]:
    return [number(1e3 * _before(row, 'speed_y'), 1), *(
        _marked(number(1e3 * own['speed_y'], 1),
                not own['speed_y'] > limits_of(row.run, row.ground, variant).speed_y)
        for variant, own in row.variants.items())]


def _slips(row: Row, suffix: str) -> list[str | Text]:
    names = f'slip_left{suffix}', f'slip_right{suffix}'
    cells: list[str | Text] = [_slip_pair(*(_before(row, name) for name in names))]
    for variant, own in row.variants.items():
        limit = limits_of(row.run, row.ground, variant)
        limits = (math.inf,) * 2 if suffix else (limit.slip_left, limit.slip_right)
        # requirements have three decimals
        ok = not any(round(own[name], 3) > most for name, most in zip(names, limits))
        cells.append(_marked(_slip_pair(*(own[name] for name in names)), ok))
    return cells


def _straight(row: Row) -> list[str | Text]:
    return [_slip(_before(row, 'common_slip')), *(
        _marked(_slip(own['common_slip']), not round(own['common_slip'], 3)
                > limits_of(row.run, row.ground, variant).common_slip)
        for variant, own in row.variants.items())]


def _jumps(row: Row, variant: str) -> str | Text:
    """Return the median and maximum number of revolutions until within 10 % after a change."""
    own = row.variants[variant]
    if math.isnan(own['jump_worst']):
        return ''
    text = ' '.join('>' if math.isinf(value) else number(value, 0)
                    for value in (own['jump_revolutions'], own['jump_worst']))
    limit = limits_of(row.run, row.ground, variant).jump_revolutions
    return _marked(text, not own['jump_worst'] > limit)


def _before(row: Row, name: str) -> float:
    return PREVIOUS_RESULTS.get((row.run, row.ground), {}).get(name, math.nan)


def _pair(own: Figures, name: str) -> str:
    return _percent_pair(own[f'{name}_median'], own[f'{name}_90'])


def _limited(own: Figures, first: str, second: str, limit: float,
             second_limit: float = math.inf) -> Text:
    ok = not (own[first] > limit or own[second] > second_limit)
    return _marked(_percent_pair(own[first], own[second]), ok)


def _percent_pair(first: float, second: float) -> str:
    return f'{_percent(first)} / {_percent(second)}' if math.isfinite(first) else '-'


def _slip_pair(left: float, right: float) -> str:
    return f'{_slip(left)} / {_slip(right)}' if math.isfinite(left) else ''


def _slip(value: float) -> str:
    text = number(value, 3) if math.isfinite(value) else ''
    return text.removeprefix('0')


def _percent(share: float) -> str:
    digits = 1 if abs(share) < 0.0995 else 0
    return number(100.0 * share, digits)


def _marked(text: str, ok: bool) -> Text:
    return Text(text) if ok else Text(f'{text} !', style='red')
