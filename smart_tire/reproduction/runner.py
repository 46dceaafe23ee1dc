# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The reproduction of both papers: experiments, figures, report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from matplotlib.figure import Figure

from smart_tire.analysis import drawing
from smart_tire.analysis.html_report import page
from smart_tire.analysis.tables import Table
from smart_tire.reproduction import (
    film_experiments, paper_a, paper_b_report, tire_figures, tire_maps, tire_runs)
from smart_tire.reproduction.film_experiments import Laboratory
from smart_tire.reproduction.report import Section
from smart_tire.reproduction.tire_runs import Crossings, crossings, drive, steady

Progress = Callable[[int, int, str], None]  # steps done, total number of steps, next task
Page = tuple[Section, Figure]

SWEEP_SPEEDS = (60.0, 80.0)  # rpm, of the side with the films
OTHER_SIDE_SPEEDS = tuple(float(rpm) for rpm in range(20, 141, 20))  # rpm
SWEEP_DURATION = 15.0                                                # s of each drive
SLIP_DURATION = SIGNAL_DURATION = 18.0                               # s, Fig. 10 and 11
STIFFNESS_DURATION = 20.0                                            # s
FILM_SECTIONS, TIRE_SECTIONS = 6, 6
TITLE = 'Reproduced figures and tables'
INTRODUCTION = (
    'All figures and tables with data of the two papers, from the models of this package and '
    'simulated experiments with the parameters of the papers. Paper A: "A PVDF-Based Deformation '
    'and Motion Sensor: Modeling and Experiments". Paper B: "A Piezo-Sensor-Based Smart Tire '
    'System for Mobile Robots and Vehicles".',
    'A simulation can show that formulas are consistent, that an estimator recovers the inputs, '
    'and where a printed formula is wrong. It cannot show that the real film or tire obeys the '
    'model; the assumptions are stated with each figure. Numbers and statements are computed '
    'with the figures.')


def reproduce(laboratory: Laboratory, directory: Path, progress: Progress) -> Path:
    """Run the experiments, write a PNG file per section and the report; return its path."""
    directory.mkdir(parents=True, exist_ok=True)
    steps = _Steps(progress)
    sections = []
    for section, figure in [*film_sections(laboratory, steps), *tire_sections(laboratory, steps)]:
        path = directory / f'{section.name}.png'
        figure.savefig(path, dpi=drawing.DOTS_PER_INCH)
        sections.append(page_section(section, path))
    report = directory / 'report.html'
    report.write_text(page.html_page(page.Report(TITLE, (), sections, INTRODUCTION)),
                      encoding='utf-8')
    steps.start('done')
    return report


def page_section(section: Section, picture: Path) -> page.Section:
    """Return a section of the page, with the file of its figure."""
    blocks: list[page.Block] = [page.Picture(section.title, picture)]
    if section.rows:
        blocks.append(Table('Numbers', ('quantity', 'paper', 'here'), section.rows, 3))
    if section.agrees:
        blocks += ['Agrees:', section.agrees]
    if section.differs:
        blocks += ['Differs, or cannot be compared:', page.Note(section.differs)]
    return page.Section(section.name, section.title.split(':')[0], section.title, blocks)


class _Steps:
    """Counts the steps at their start."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._begun = progress, 0
        self._total = FILM_SECTIONS + TIRE_SECTIONS + len(SWEEP_SPEEDS) * len(OTHER_SIDE_SPEEDS)

    def start(self, task: str) -> None:
        self._progress(self._begun, self._total, task)
        self._begun += 1


def film_sections(laboratory: Laboratory, steps: _Steps) -> Iterator[Page]:
    """Yield the sections of paper A."""
    steps.start('paper A, Fig. 4')
    trace = film_experiments.buckling_test(laboratory)
    yield paper_a.trace_section(trace), paper_a.trace_figure(trace)
    steps.start('paper A, Fig. 6')
    rate = film_experiments.rate_independence(laboratory)
    yield paper_a.rate_section(rate), paper_a.rate_figure(rate)
    steps.start('paper A, Fig. 7')
    amplitude = film_experiments.proportionality(laboratory)
    yield paper_a.amplitude_section(amplitude), paper_a.amplitude_figure(amplitude)
    steps.start('paper A, Fig. 8')
    fits = film_experiments.identification(laboratory)
    yield paper_a.fit_section(fits), paper_a.fit_figure(fits)
    steps.start('paper A, Fig. 9')
    yield paper_a.comparison_section(fits), paper_a.comparison_figure(fits)
    steps.start('paper A, Table I')
    yield paper_a.table_section(fits), paper_a.table_figure(fits)


def tire_sections(laboratory: Laboratory, steps: _Steps) -> Iterator[Page]:
    """Yield the sections of paper B."""
    steps.start('paper B, Fig. 8')
    outline = tire_maps.outline()
    yield paper_b_report.outline_section(outline), tire_figures.outline_figure(outline)
    steps.start('paper B, Fig. 10')
    runs = {ground: drive(laboratory, ground, steady(120.0, 60.0), SLIP_DURATION)
            for ground in ('concrete', 'sand')}
    slips, printed = ({ground: tire_runs.side_slips(run, getattr(run, kind))
                       for ground, run in runs.items()} for kind in ('estimates', 'printed'))
    yield paper_b_report.slip_section(slips, printed), tire_figures.slip_figure(runs)
    steps.start('paper B, Fig. 11')
    run = drive(laboratory, 'concrete', steady(60.0, 80.0), SIGNAL_DURATION)
    signals = tire_maps.signals(run)
    yield paper_b_report.signal_section(signals), tire_figures.signal_figure(signals, run)
    sweep = tire_maps.sweep(sweep_crossings(laboratory, steps))
    steps.start('paper B, Fig. 12')
    yield paper_b_report.stretch_section(sweep), tire_figures.stretch_figure(sweep)
    steps.start('paper B, Fig. 13')
    yield paper_b_report.adhesion_section(sweep), tire_figures.adhesion_figure(sweep)
    steps.start('paper B, Table I')
    run = drive(laboratory, 'concrete', tire_runs.oscillating, STIFFNESS_DURATION)
    fit = tire_runs.stiffness(run, tire_maps.MU)
    yield paper_b_report.table_section(sweep, fit), tire_figures.table_figure(sweep, fit)


def sweep_crossings(laboratory: Laboratory, steps: _Steps) -> Crossings:
    """Return the crossings of drives at all pairs of wheel speeds."""
    parts = []
    for right in SWEEP_SPEEDS:
        for left in OTHER_SIDE_SPEEDS:
            steps.start(f'paper B, Fig. 12: {left:.0f}/{right:.0f} rpm')
            run = drive(laboratory, 'concrete', steady(left, right), SWEEP_DURATION,
                        seed=round(left + right))
            parts.append(crossings(run, right))
    return tire_runs.concatenated(parts)
