"""The whole reproduction: experiments, figures, report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from matplotlib.figure import Figure

from smart_tire.analysis import drawing
from smart_tire.reproduction import (
    film_figures, film_fit, film_loops, paper_a_report, paper_b_report, tire_figures, tire_maps,
    tire_runs)
from smart_tire.reproduction.experiments import Laboratory
from smart_tire.reproduction.html import write_report
from smart_tire.reproduction.report_section import Section
from smart_tire.reproduction.tire_runs import drive, Passages, passages, steady

Progress = Callable[[int, int, str], None]  # steps done, steps in all, what comes next
Drawn = tuple[Section, Figure]

SWEPT = (60.0, 80.0)                            # rpm, of the side with the films
OTHERS = tuple(float(rpm) for rpm in range(20, 141, 20))  # rpm, of the other side
SWEEP_DURATION = 15.0                           # s of each run
SLIP_DURATION = SIGNAL_DURATION = 18.0          # s, Fig. 10 and 11
STIFFNESS_DURATION = 20.0                       # s
FILM_PAGES, TIRE_PAGES = 6, 6
INTRODUCTION = (
    'Every figure and table with data of the two papers, from the models of this package and '
    'simulated experiments with the papers\' own parameters. Paper A: "A PVDF-Based Deformation '
    'and Motion Sensor: Modeling and Experiments". Paper B: "A Piezo-Sensor-Based Smart Tire '
    'System for Mobile Robots and Vehicles".',
    'A simulation can show that formulas follow from each other, that an estimate finds what was '
    'put in, and where a printed formula goes wrong. It can not show that the real film or tire '
    'obeys the model; what rests on assumptions is said with each figure. Numbers and sentences '
    'are computed with the figures.')


def reproduce(laboratory: Laboratory, directory: Path, progress: Progress) -> Path:
    """Make the experiments and write a PNG file for each page, and the report; return that."""
    directory.mkdir(parents=True, exist_ok=True)
    steps = _Steps(progress)
    written = []
    for page, figure in [*film_pages(laboratory, steps), *tire_pages(laboratory, steps)]:
        path = directory / f'{page.name}.png'
        figure.savefig(path, dpi=drawing.DOTS_PER_INCH)
        written.append((page, path))
    report = directory / 'report.html'
    write_report(report, INTRODUCTION, written)
    steps.begin('done')
    return report


class _Steps:
    """Counts the steps as they begin."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._begun = progress, 0
        self._total = FILM_PAGES + TIRE_PAGES + len(SWEPT) * len(OTHERS)

    def begin(self, what: str) -> None:
        self._progress(self._begun, self._total, what)
        self._begun += 1


def film_pages(laboratory: Laboratory, steps: _Steps) -> Iterator[Drawn]:
    """Yield the pages of paper A."""
    steps.begin('paper A, Fig. 4')
    trace = film_loops.buckling_test(laboratory)
    yield paper_a_report.trace_page(trace), film_figures.trace_figure(trace)
    steps.begin('paper A, Fig. 6')
    rate = film_loops.rate_independence(laboratory)
    yield paper_a_report.rate_page(rate), film_figures.rate_figure(rate)
    steps.begin('paper A, Fig. 7')
    amplitude = film_loops.proportionality(laboratory)
    yield paper_a_report.amplitude_page(amplitude), film_figures.amplitude_figure(amplitude)
    steps.begin('paper A, Fig. 8')
    fits = film_fit.identification(laboratory)
    yield paper_a_report.fit_page(fits), film_figures.fit_figure(fits)
    steps.begin('paper A, Fig. 9')
    yield paper_a_report.comparison_page(fits), film_figures.comparison_figure(fits)
    steps.begin('paper A, Table I')
    yield paper_a_report.table_page(fits), film_figures.table_figure(fits)


def tire_pages(laboratory: Laboratory, steps: _Steps) -> Iterator[Drawn]:
    """Yield the pages of paper B."""
    steps.begin('paper B, Fig. 8')
    outline = tire_maps.outline()
    yield paper_b_report.outline_page(outline), tire_figures.outline_figure(outline)
    steps.begin('paper B, Fig. 10')
    runs = {ground: drive(laboratory, ground, steady(120.0, 60.0), SLIP_DURATION)
            for ground in ('concrete', 'sand')}
    slips = {ground: tire_runs.side_slips(run) for ground, run in runs.items()}
    yield paper_b_report.slip_page(slips), tire_figures.slip_figure(runs)
    steps.begin('paper B, Fig. 11')
    run = drive(laboratory, 'concrete', steady(60.0, 80.0), SIGNAL_DURATION)
    signals = tire_maps.signals(run)
    yield paper_b_report.signal_page(signals), tire_figures.signal_figure(signals, run)
    sweep = tire_maps.sweep(swept(laboratory, steps))
    steps.begin('paper B, Fig. 12')
    yield paper_b_report.stretch_page(sweep), tire_figures.stretch_figure(sweep)
    steps.begin('paper B, Fig. 13')
    yield paper_b_report.adhesion_page(sweep), tire_figures.adhesion_figure(sweep)
    steps.begin('paper B, Table I')
    run = drive(laboratory, 'concrete', tire_runs.wavy, STIFFNESS_DURATION)
    fit = tire_runs.stiffness(run, tire_maps.MU)
    yield paper_b_report.table_page(sweep, fit), tire_figures.table_figure(sweep, fit)


def swept(laboratory: Laboratory, steps: _Steps) -> Passages:
    """Return the passages of drives at all pairs of wheel speeds."""
    parts = []
    for right in SWEPT:
        for left in OTHERS:
            steps.begin(f'paper B, Fig. 12: {left:.0f}/{right:.0f} rpm')
            run = drive(laboratory, 'concrete', steady(left, right), SWEEP_DURATION,
                        seed=round(left + right))
            parts.append(passages(run, right))
    return tire_runs.joined(parts)
