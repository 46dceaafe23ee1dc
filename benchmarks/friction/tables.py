"""Tables of the friction benchmark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math

from rich.table import Table
from rich.text import Text
from benchmarks.friction.grid import Case
from benchmarks.friction.methods import AIDED, ESTIMATED, EXACT_MAP, PRINTED_MAP, TRUE, WAVEFORM
from benchmarks.friction.monte_carlo import CaseResult, Trial
from benchmarks.friction.reference_results import Published
from benchmarks.friction.results import Key, SteadySlip
from benchmarks.friction.scoring import Figures, JUDGED_BOUND
from benchmarks.tables import new_table, number

Runs = Mapping[str, Mapping[Key, Figures]]  # run -> wheel, source and method -> figures

# What is asked for; beyond, a figure is marked.
BIAS, OVER_BOUND = 0.02, 1.3  # where the bound is below JUDGED_BOUND, with the true slip
NEES = 0.7, 1.4
MILLISECONDS = 5.0
FAST_REVOLUTIONS = 3
LEAST_READ = 0.2  # share of passages that two peaks must tell for their errors to mean anything
SENSED = 'front_right'  # the wheel of the published runs
TELLING = f'{100.0 * JUDGED_BOUND:.0f} %'

NOTES = f"""\
Errors of mu are relative to the true one: median / 90 % of their sizes. bound: least standard
deviation of mu from one revolution (Cramer-Rao); sd: from the interquartile range; 90 %: what
90 % of the errors stay below. NEES: mean
normalised squared error, 1 is right; of mu: of mu F_z / C_x, which is what films tell, without
the sigmas of C_x and load; within: shares of mu within its whole sigma, one and two (0.68, 0.95).
revs: revolutions until the fused mu was within 10 %, median and worst, after the start / a jump
of mu; fast: those of them with a slip above 0.1. ms: CPU time per passage; of whole runs with all
that finding it takes. published: a reference fit on such runs. Passages over two grounds are not
judged. Two peaks are read as the paper does, with nothing held back: film 1, raw samples.
! with the true slip and a bound below {TELLING}: bias beyond {100.0 * BIAS:.0f} % or sd beyond
{OVER_BOUND} bounds; anywhere: NEES outside {NEES[0]} to {NEES[1]}, more than {MILLISECONDS:g} ms,
more than {FAST_REVOLUTIONS} fast revolutions after a jump.
"""


def cases_table(cases: Sequence[CaseResult]) -> Table:
    """Return what all methods tell of synthesised passages with the true slip."""
    table = new_table(
        f'{cases[0].passages} synthesised passages each, with the true slip', 'slip', 'mu', 'rpm',
        'noise\n[mV]', 'bound\n[%]', 'found\n[%]', 'told\n[%]', 'bias\n[%]', 'sd over\nbound',
        'NEES', 'ms', 'exact map:\nbias [%]', '90 %\n[%]', 'printed map:\nbias [%]', '90 %\n[%]')
    group = ''
    for one in cases:
        if one.group != group:
            group = one.group
            _head(table, group)
        own, case = one.trials[WAVEFORM], one.case
        table.add_row(*_circumstances(case), _percent(one.bound), _percent(one.found, 0),
                      _percent(own.told, 0), *_judged(one, own),
                      *(cell for method in (EXACT_MAP, PRINTED_MAP)
                        for cell in _read(one.trials.get(method))))
    return table


def _circumstances(case: Case) -> tuple[str, ...]:
    return (f'  {case.slip:+.2f}', number(case.mu, 2), number(case.rpm, 0),
            number(1e3 * case.noise, 0))


def _judged(one: CaseResult, own: Trial) -> list[Text]:
    telling = one.bound < JUDGED_BOUND
    over = own.spread / one.bound
    return [_kept(_percent(own.bias), not telling or abs(own.bias) <= BIAS),
            _kept(number(over, 2), not telling or over <= OVER_BOUND),
            _kept(number(own.nees, 2), not telling or NEES[0] <= own.nees <= NEES[1]),
            _kept(number(own.ms, 1), own.ms <= MILLISECONDS)]


def _read(trial: Trial | None) -> tuple[str, str]:
    if trial is None:
        return '', ''
    return _percent(trial.bias, 0), _percent(trial.large, 0)


def errors_table(runs: Runs, titles: Mapping[str, str],
                 published: Mapping[str, Published]) -> Table:
    """Return the errors of mu of whole runs beside the published ones."""
    table = new_table(
        'Whole runs: relative error of mu [%], revolutions to within 10 %', 'true slip',
        'published:\none rev.', '\nfused', '\nrevs',
        *(f'{title}:\none rev.' if i == 0 else title_ for title in (
            'estimated slip', 'true slip')
          for i, title_ in enumerate(('', '\nfused', 'revs:\nstart', '\njump', '\nfast'))))
    for run, figures in runs.items():
        _head(table, titles[run])
        for wheel in _wheels(figures):
            own = {source: figures[wheel, source, WAVEFORM] for source in (ESTIMATED, TRUE)}
            known = published.get(run) if wheel == SENSED else None
            table.add_row(_wheel(wheel, own[TRUE]), *_published(known),
                          *(cell for source in (ESTIMATED, TRUE) for cell in _errors(own[source])))
    return table


def _head(table: Table, title: str) -> None:
    table.add_section()
    table.add_row(Text(title, style='bold'))


def _wheels(figures: Mapping[Key, Figures]) -> list[str]:
    return list(dict.fromkeys(wheel for wheel, _, _ in figures))


def _wheel(wheel: str, own: Figures) -> str:
    return f'  {wheel.replace("_", " ")} {own["slip_median"]:+.2f}'


def _published(known: Published | None) -> tuple[str, str, str]:
    if known is None:
        return '', '', ''
    return (_pair(known.single, known.single_90), _pair(known.fused, known.fused_90),
            number(known.revolutions, 0))


def _errors(own: Figures) -> list[str | Text]:
    fast = own['jump_fast_worst']
    return [_pair(own['single_median'], own['single_90']),
            _pair(own['fused_median'], own['fused_90']),
            _turns(own, 'start'), _turns(own, 'jump'),
            _kept(number(fast, 0), not fast > FAST_REVOLUTIONS)]


def _turns(own: Figures, name: str) -> str:
    """Return the median and the worst number of revolutions until a ground was known."""
    if not own[f'{name}s']:
        return ''
    return ' '.join('>' if math.isinf(value) else number(value, 0)
                    for value in (own[f'{name}_revolutions'], own[f'{name}_worst']))


def statistics_table(runs: Runs, titles: Mapping[str, str]) -> Table:
    """Return how honest the estimator is, and what it finds and costs."""
    table = new_table(
        'Whole runs: honesty', '', 'found\n[%]', '\nfalse', 'told\n[%]',
        f'bound < {TELLING}:\nbias [%]', '\nsd over', 'NEES:\none rev.', '\nfused',
        'adhe-\nsion', 'film\nslip', 'within:\none rev.', '\nfused', 'adhesion\nrms', '\nms')
    for run, figures in runs.items():
        _head(table, titles[run])
        for wheel in _wheels(figures):
            for source in (ESTIMATED, TRUE):
                table.add_row(f'  {wheel.replace("_", " ")}, {source} slip', *_statistics(
                    figures[wheel, source, WAVEFORM], source == TRUE))
    return table


def _statistics(own: Figures, strict: bool) -> list[str | Text]:
    over, bias = own['bounded_over_bound'], own['bounded_bias']
    return [_percent(own['found'], 2), number(own['false'], 0), _percent(own['single_told'], 0),
            _kept(_percent(bias), not strict or not abs(bias) > BIAS),
            _kept(number(over, 2), not strict or not over > OVER_BOUND),
            *(_kept(number(own[f'nees_{name}'], 2), not math.isfinite(own[f'nees_{name}'])
                    or NEES[0] <= own[f'nees_{name}'] <= NEES[1])
              for name in ('single', 'fused', 'adhesion_ratio', 'film_slip')),
            _shares(own, 'single'), _shares(own, 'fused'), number(own['adhesion_ratio_rms'], 4),
            _kept(number(own['ms'], 1), own['ms'] <= MILLISECONDS)]


def _shares(own: Figures, name: str) -> str:
    return f'{own[f"{name}_within_one"]:.2f} {own[f"{name}_within_two"]:.2f}'


def rivals_table(runs: Runs, titles: Mapping[str, str]) -> Table:
    """Return the waveform beside two peaks with both maps, by the slip of slip_estimator."""
    table = new_table(
        "Beside the paper's two peaks, with the estimated slip: mu over the true one (median), "
        'relative error [%]', 'true slip', *(
            column for title in ('waveform', 'exact map', 'printed map')
            for column in (f'{title}:\nover true', '\none rev.', '\nfused')))
    for run, figures in runs.items():
        _head(table, titles[run])
        for wheel in _wheels(figures):
            own, *peaks = (figures[wheel, ESTIMATED, method]
                           for method in (WAVEFORM, EXACT_MAP, PRINTED_MAP))
            table.add_row(_wheel(wheel, own), number(1.0 + own['single_bias'], 2),
                          _pair(own['single_median'], own['single_90']),
                          _pair(own['fused_median'], own['fused_90']),
                          *(cell for one in peaks for cell in _peaks(one)))
    return table


def aided_table(runs: Runs, slips: Mapping[str, Mapping[str, SteadySlip]],
                titles: Mapping[str, str]) -> Table:
    """Return the slip that films aid, and friction with it, beside those without."""
    table = new_table(
        'Slip of slip_estimator, steady, without the films and aided by them; relative error of '
        'mu with it [%]', '', 'without:\nrms', '\ntold', '\nNEES', '\none rev.', '\nfused',
        'aided:\nrms', '\ntold', '\nNEES', '\none rev.', '\nfused')
    for run, figures in runs.items():
        _head(table, titles[run])
        for wheel in _wheels(figures):
            cells: list[str | Text] = []
            for source in (ESTIMATED, AIDED):
                own, slip = figures[wheel, source, WAVEFORM], slips[run][source]
                cells += [number(slip.rms, 4), number(slip.told, 4), number(slip.nees, 2),
                          _pair(own['single_median'], own['single_90']),
                          _pair(own['fused_median'], own['fused_90'])]
            table.add_row(f'  {wheel.replace("_", " ")}', *cells)
    return table


def _peaks(one: Figures) -> tuple[str, str, str]:
    if not one['read_told'] > LEAST_READ:
        return '-', '-', '-'
    return (number(one['read_ratio'], 2), _pair(one['read_median'], one['read_90']),
            _pair(one['fused_median'], one['fused_90']))


def _pair(first: float, second: float) -> str:
    return f'{_percent(first)} / {_percent(second)}' if math.isfinite(first) else '-'


def _percent(share: float, digits: int = 1) -> str:
    return number(100.0 * share, digits)


def _kept(text: str, kept: bool) -> Text:
    return Text(text) if kept else Text(f'{text} !', style='red')
