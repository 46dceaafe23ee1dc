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

"""Tables of the slip benchmark."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import math

from benchmarks.slip.comparison import LIVE, LIVE_TORQUE, METHODS, OWN, SMOOTHED
from benchmarks.slip.previous_results import PREVIOUS_RESULTS
from benchmarks.slip.reference_results import Reference, ReferenceRun, TITLES
from benchmarks.slip.requirements import MAX_SLIP_ERRORS
from benchmarks.slip.results import Figures
from benchmarks.tables import new_table, number, print_all
from rich.console import Console
from rich.table import Table
from rich.text import Text

MAX_LIVE_RATIO = 1.5      # of errors to those of the reference filter, in steady intervals
MAX_SMOOTHED_RATIO = 1.0
WITH_SIGMAS = (*OWN, 'plain_ekf')
REQUIRED = (LIVE, LIVE_TORQUE)  # methods with required slip errors

Runs = Mapping[str, Mapping[str, Figures]]  # run -> method -> figures


NOTES = """\
steady: |r w| > 0.1 m/s, t > 3 s, more than 0.4 s from any |dw/dt| > 1.5 rad/s2; averaged: all
times, against truth averaged over 125 ms; NaN while the true slip is defined counts as 1.
position: error in percent of the distance. Best-fit tracks and radii are fitted to the ground
truth of each run, also the track of the EKF. reference: an internal reference filter on the same
scenarios, with IMU, wheels and constraints, and with a force balance for C_x 52.7 N and mu 0.47.
before: live, before forces were estimated. ! slip outside the requirements.
"""


def errors_table(title: str, run: str, methods: Mapping[str, Figures],
                 target: ReferenceRun | None, averaged: bool) -> Table:
    """Return the errors of all methods and of the reference filter on one run."""
    times = 'averaged' if averaged else 'steady'
    table = new_table(title, '', f'slip L / R\n{times}', 'slip L / R\nall times',
                      f'v [mm/s]\n{times}', '\nall', 'position [%]\nrms   end',
                      'heading [deg]\nrms    end')
    if run in PREVIOUS_RESULTS:
        table.add_row('before', *_errors(PREVIOUS_RESULTS[run]), style='italic')
    own = [name for name in OWN if name in methods]
    for name in own:
        limits = MAX_SLIP_ERRORS.get(run) if name in REQUIRED else None
        table.add_row(METHODS[name], *_errors(methods[name], limits),
                      style='bold' if name in REQUIRED else None)
    if target is not None:
        for kind in TITLES:
            table.add_row(TITLES[kind], *_reference(
                getattr(target, kind), methods[LIVE]['distance']), style='italic')
    for name in methods:
        if name not in own:
            table.add_row(METHODS[name], *_errors(methods[name]))
    return table


def _errors(figures: Figures, limits: tuple[float, float] | None = None) -> list[str | Text]:
    sides = figures['slip_left'], figures['slip_right']
    # requirements have three decimals
    ok = limits is None or all(round(one, 3) <= most for one, most in zip(sides, limits))
    slips = _pair(*sides)
    return [Text(slips) if ok else Text(f'{slips} !', style='red'),
            _pair(figures['slip_left_all_times'], figures['slip_right_all_times']),
            number(1e3 * figures['speed'], 1), number(1e3 * figures['speed_all_times'], 1),
            _two(figures['position_rms_percent'], figures['position_end_percent'], 2),
            _two(math.degrees(figures['heading_rms']), math.degrees(figures['heading_end']), 2)]


def _reference(one: Reference, distance: float) -> list[str]:
    return [_pair(one.left, one.right), '', number(1e3 * one.speed, 1), '',
            _two(math.nan, 100.0 * one.end / distance, 2), _two(math.nan, one.heading_end, 2)]


def reference_table(runs: Runs, titles: Mapping[str, str],
                    targets: Mapping[str, ReferenceRun]) -> Table:
    """Return the ratio of errors to those of the reference filter, run by run."""
    table = new_table(
        f'Ratio to the errors of the reference filter, worse side (! above {MAX_LIVE_RATIO:g} '
        f'live, {MAX_SMOOTHED_RATIO:g} smoothed)', '', 'reference\nslip L / R', '\nlive',
        '\nratio', '\nsmoothed', '\nratio', 'v [mm/s]\nreference', '\nlive', '\nsmoothed')
    for run, target in targets.items():
        if run in runs:
            live, smoothed = runs[run][LIVE], runs[run][SMOOTHED]
            plain = target.plain
            table.add_row(
                titles[run], _pair(plain.left, plain.right), *_ratio(live, plain, MAX_LIVE_RATIO),
                *_ratio(smoothed, plain, MAX_SMOOTHED_RATIO), number(1e3 * plain.speed, 1),
                *(_marked(number(1e3 * one['speed'], 1), one['speed'] / plain.speed, limit)
                  for one, limit in ((live, MAX_LIVE_RATIO), (smoothed, MAX_SMOOTHED_RATIO))))
            for name, unit, of_end, ends in (
                    ('position', 'm', plain.end, 'position_end'),
                    ('heading', 'rad', math.radians(plain.heading_end), 'heading_end')):
                if math.isfinite(of_end):
                    table.add_row(f'  {name} at the end [{unit}]', number(of_end, 3), *(
                        cell for figures, limit in ((live, MAX_LIVE_RATIO),
                                                    (smoothed, MAX_SMOOTHED_RATIO))
                        for cell in (number(figures[ends], 3), _marked(
                            number(figures[ends] / of_end, 2), figures[ends] / of_end, limit))))
    return table


def _ratio(figures: Figures, plain: Reference, limit: float) -> tuple[str, Text]:
    """Return the slip errors of both sides, and the larger of their ratios."""
    ratio = max(figures['slip_left'] / plain.left, figures['slip_right'] / plain.right)
    errors = _pair(figures['slip_left'], figures['slip_right'])
    return errors, _marked(number(ratio, 2), ratio, limit)


def _marked(text: str, ratio: float, limit: float) -> Text:
    return Text(text) if ratio <= limit else Text(f'{text} !', style='red')


def statistics_table(runs: Runs, titles: Mapping[str, str]) -> Table:
    """Return NEES, shares within two sigma, NIS, error of S and time per step."""
    table = new_table(
        'Normalized estimation error squared (NEES, 1 if consistent), share within two sigma '
        '(0.95), normalized innovation squared (NIS, 1), error of S',
        '', 'NEES:\nslip L  R', '\nv', 'posi-\ntion', 'head-\ning', 'within:\nslip L  R',
        '\nv', 'posi-\ntion', 'head-\ning', '\nNIS', 'S\n[mm]', 'step\n[us]')
    for run, methods in runs.items():
        table.add_section()
        for name in (name for name in WITH_SIGMAS if name in methods):
            one = methods[name]
            cells = [f'{titles[run]}' if name == LIVE else f'  {METHODS[name]}']
            for kind in ('nees', 'within_two'):
                sides = one[f'{kind}_slip_left'], one[f'{kind}_slip_right']
                cells += [_two(*sides, 2), *(number(one[f'{kind}_{what}'], 2)
                                             for what in ('speed', 'position', 'heading'))]
            table.add_row(*cells, number(one['nis'], 2), number(1e3 * one['icr_x'], 1),
                          number(one['step_us'], 0))
    return table


def recordings_table(title: str, methods: Mapping[str, Figures],
                     sources: Sequence[str] = ()) -> Table:
    """Return the errors of the path of one real recording; ``sources`` of its parameters below."""
    distance = methods[LIVE]['distance']
    table = new_table(f'{title}: {distance:.0f} m scored', '', 'position rms\n[m]', '[%]',
                      'position end\n[%]', 'heading rms\n[deg]', 'heading end\n[deg]')
    table.caption, table.caption_justify = Text('\n'.join(sources)), 'left'
    for name, one in methods.items():
        table.add_row(METHODS[name], number(one['position_rms'], 3), *(
            number(one[key], 2) for key in ('position_rms_percent', 'position_end_percent')),
            *(number(math.degrees(one[key]), 2) for key in ('heading_rms', 'heading_end')),
            style='bold' if name == LIVE else None)
    return table


def print_tables(console: Console, tables: Iterable[Table]) -> None:
    """Print the notes and the tables."""
    print_all(console, NOTES, tables)


def _pair(left: float, right: float) -> str:
    return f'{_slip(left)} / {_slip(right)}'


def _slip(value: float) -> str:
    """Return a slip error without leading zero: .0123."""
    text = number(value, 4)
    return text[1:] if text.startswith('0.') else text


def _two(first: float, second: float, digits: int) -> str:
    texts: Sequence[str] = [number(value, digits) for value in (first, second)]
    return '  '.join(f'{text:>{3 + digits}}' for text in texts)
