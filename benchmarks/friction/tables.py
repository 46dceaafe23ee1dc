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

"""Tables of the friction benchmark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math

from benchmarks.friction.grid import Case
from benchmarks.friction.methods import EXACT_MAP, PRINTED_MAP, WAVEFORM
from benchmarks.friction.monte_carlo import CaseResult, Trial
from benchmarks.friction.reference_results import Reference
from benchmarks.friction.results import Key
from benchmarks.friction.scoring import Figures, MAX_INFORMATIVE_BOUND
from benchmarks.tables import new_table, number
from rich.table import Table
from rich.text import Text

Runs = Mapping[str, Mapping[Key, Figures]]  # run -> wheel and method -> figures

# Requirements; figures outside are marked.
MAX_BIAS, MAX_BOUND_RATIO = 0.02, 1.3  # with the true slip, bound below MAX_INFORMATIVE_BOUND
NEES_RANGE = 0.7, 1.4
MAX_TIME = 5.0  # ms, CPU time per crossing
MAX_FAST_CROSSINGS = 3
MIN_FINITE_SHARE = 0.2  # of the crossings with two peaks, for meaningful errors
REFERENCE_WHEEL = 'front_right'  # of the reference results
BOUND_LIMIT = f'{100.0 * MAX_INFORMATIVE_BOUND:.0f} %'

NOTES = f"""\
Errors of mu are relative: median / 90 % quantile of absolute errors. bound: Cramer-Rao bound of
the standard deviation of mu from one crossing; sd: standard deviation from the interquartile
range; 90 %: 90 % quantile of absolute errors; finite: share of crossings with an estimate. NEES:
normalized estimation error squared, 1 if consistent, for mu of mu F_z / C_x without the sigmas of
C_x and load; within: shares of mu within one and two sigma (0.68, 0.95). revs: revolutions until
the fused mu is within 10 %, median and maximum, after the start / a change of mu; fast: those
with slip above 0.1. ms: CPU time per crossing, in simulated runs including detection and the
window of the ground. reference: an internal reference estimator on the same scenarios. Crossings
on two surfaces are not scored. Two peaks: method of paper B without rejection, film 1, raw
samples.
! synthesized crossings with a bound below {BOUND_LIMIT}: bias above {100.0 * MAX_BIAS:.0f} % or sd
above {MAX_BOUND_RATIO} bounds; in all tables: NEES outside {NEES_RANGE[0]} to {NEES_RANGE[1]},
more than {MAX_TIME:g} ms, more than {MAX_FAST_CROSSINGS} fast revolutions after a change of mu.
"""


def cases_table(cases: Sequence[CaseResult]) -> Table:
    """Return the scores of all methods on synthesized crossings with the true slip."""
    table = new_table(
        f'{cases[0].crossings} synthesized crossings each, with the true slip', 'slip', 'mu',
        'rpm', 'noise\n[mV]', 'bound\n[%]', 'found\n[%]', 'finite\n[%]', 'bias\n[%]',
        'sd over\nbound', 'NEES', 'ms', 'exact map:\nbias [%]', '90 %\n[%]',
        'printed map:\nbias [%]', '90 %\n[%]')
    group = ''
    for one in cases:
        if one.group != group:
            group = one.group
            _head(table, group)
        own, case = one.trials[WAVEFORM], one.case
        table.add_row(*_case_cells(case), _percent(one.bound), _percent(one.found, 0),
                      _percent(own.finite, 0), *_scores(one, own),
                      *(cell for method in (EXACT_MAP, PRINTED_MAP)
                        for cell in _peak_scores(one.trials.get(method))))
    return table


def _case_cells(case: Case) -> tuple[str, ...]:
    return (f'  {case.slip:+.2f}', number(case.mu, 2), number(case.rpm, 0),
            number(1e3 * case.noise, 0))


def _scores(one: CaseResult, own: Trial) -> list[Text]:
    informative = one.bound < MAX_INFORMATIVE_BOUND
    over = own.spread / one.bound
    return [_marked(_percent(own.bias), not informative or abs(own.bias) <= MAX_BIAS),
            _marked(number(over, 2), not informative or over <= MAX_BOUND_RATIO),
            _marked(number(own.nees, 2),
                    not informative or NEES_RANGE[0] <= own.nees <= NEES_RANGE[1]),
            _marked(number(own.ms, 1), own.ms <= MAX_TIME)]


def _peak_scores(trial: Trial | None) -> tuple[str, str]:
    if trial is None:
        return '', ''
    return _percent(trial.bias, 0), _percent(trial.large, 0)


def errors_table(runs: Runs, titles: Mapping[str, str],
                 references: Mapping[str, Reference]) -> Table:
    """Return the errors of mu in simulated runs, and those of the reference."""
    table = new_table(
        'Simulated runs: relative error of mu [%], revolutions until within 10 %', 'true slip',
        'reference:\nsingle', '\nfused', '\nrevs',
        'single', 'fused', 'revs:\nstart', '\njump', '\nfast')
    for run, figures in runs.items():
        _head(table, titles[run])
        for wheel in _wheels(figures):
            own = figures[wheel, WAVEFORM]
            reference = references.get(run) if wheel == REFERENCE_WHEEL else None
            table.add_row(_wheel(wheel, own), *_reference(reference), *_errors(own))
    return table


def _head(table: Table, title: str) -> None:
    table.add_section()
    table.add_row(Text(title, style='bold'))


def _wheels(figures: Mapping[Key, Figures]) -> list[str]:
    return list(dict.fromkeys(wheel for wheel, _ in figures))


def _wheel(wheel: str, own: Figures) -> str:
    return f'  {wheel.replace("_", " ")} {own["slip_median"]:+.2f}'


def _reference(reference: Reference | None) -> tuple[str, str, str]:
    if reference is None:
        return '', '', ''
    return (_pair(reference.single, reference.single_90),
            _pair(reference.fused, reference.fused_90), number(reference.revolutions, 0))


def _errors(own: Figures) -> list[str | Text]:
    fast = own['jump_fast_worst']
    return [_pair(own['single_median'], own['single_90']),
            _pair(own['fused_median'], own['fused_90']),
            _revolutions(own, 'start'), _revolutions(own, 'jump'),
            _marked(number(fast, 0), not fast > MAX_FAST_CROSSINGS)]


def _revolutions(own: Figures, name: str) -> str:
    """Return the median and maximum number of revolutions until convergence."""
    if not own[f'{name}s']:
        return ''
    return ' '.join('>' if math.isinf(value) else number(value, 0)
                    for value in (own[f'{name}_revolutions'], own[f'{name}_worst']))


def statistics_table(runs: Runs, titles: Mapping[str, str]) -> Table:
    """Return the consistency of the estimator, its detection rate and CPU time."""
    table = new_table(
        'Simulated runs: consistency', '', 'found\n[%]', '\nfalse', 'finite\n[%]',
        f'bound < {BOUND_LIMIT}:\nbias [%]', '\nsd over', 'NEES:\nsingle', '\nfused',
        'adhe-\nsion', 'film\nslip', 'within:\nsingle', '\nfused', 'adhesion\nrms', '\nms')
    for run, figures in runs.items():
        _head(table, titles[run])
        for wheel in _wheels(figures):
            table.add_row(f'  {wheel.replace("_", " ")}', *_statistics(figures[wheel, WAVEFORM]))
    return table


def _statistics(own: Figures) -> list[str | Text]:
    return [_percent(own['found'], 2), number(own['false'], 0), _percent(own['single_finite'], 0),
            _percent(own['bounded_bias']), number(own['bounded_over_bound'], 2),
            *(_marked(number(own[f'nees_{name}'], 2), not math.isfinite(own[f'nees_{name}'])
                      or NEES_RANGE[0] <= own[f'nees_{name}'] <= NEES_RANGE[1])
              for name in ('single', 'fused', 'adhesion_ratio', 'film_slip')),
            _shares(own, 'single'), _shares(own, 'fused'), number(own['adhesion_ratio_rms'], 4),
            _marked(number(own['ms'], 1), own['ms'] <= MAX_TIME)]


def _shares(own: Figures, name: str) -> str:
    return f'{own[f"{name}_within_one"]:.2f} {own[f"{name}_within_two"]:.2f}'


def methods_table(runs: Runs, titles: Mapping[str, str]) -> Table:
    """Return the errors of waveform and two peaks with both maps."""
    table = new_table(
        'Comparison with two peaks (paper B): median of mu / true mu, relative error [%]',
        'true slip', *(
            column for title in ('waveform', 'exact map', 'printed map')
            for column in (f'{title}:\nratio', '\nsingle', '\nfused')))
    for run, figures in runs.items():
        _head(table, titles[run])
        for wheel in _wheels(figures):
            own, *peaks = (figures[wheel, method]
                           for method in (WAVEFORM, EXACT_MAP, PRINTED_MAP))
            table.add_row(_wheel(wheel, own), number(1.0 + own['single_bias'], 2),
                          _pair(own['single_median'], own['single_90']),
                          _pair(own['fused_median'], own['fused_90']),
                          *(cell for one in peaks for cell in _peaks(one)))
    return table


def _peaks(one: Figures) -> tuple[str, str, str]:
    if not one['peaks_finite'] > MIN_FINITE_SHARE:
        return '-', '-', '-'
    return (number(one['peaks_ratio'], 2), _pair(one['peaks_median'], one['peaks_90']),
            _pair(one['fused_median'], one['fused_90']))


def _pair(first: float, second: float) -> str:
    return f'{_percent(first)} / {_percent(second)}' if math.isfinite(first) else '-'


def _percent(share: float, digits: int = 1) -> str:
    return number(100.0 * share, digits)


def _marked(text: str, ok: bool) -> Text:
    return Text(text) if ok else Text(f'{text} !', style='red')
