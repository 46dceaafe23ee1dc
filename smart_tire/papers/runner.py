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

from smart_tire.analysis.drawing import save
from smart_tire.analysis.html_report import page
from smart_tire.analysis.tables import Table
from smart_tire.papers import film_experiments, paper_a, paper_b, tire_maps, tire_runs
from smart_tire.papers.report import PaperSection
from smart_tire.papers.tire_runs import (
    camera_view, Crossings, crossings, drive, RENDERED_DURATIONS, steady)

Progress = Callable[[int, int, str], None]  # steps done, total number of steps, next task

SWEEP_SPEEDS = (60.0, 80.0)  # rpm, of the side with the films
OTHER_SIDE_SPEEDS = tuple(float(rpm) for rpm in range(20, 141, 20))  # rpm
SWEEP_DURATION = 15.0                                                # s of each drive
SLIP_DURATION = SIGNAL_DURATION = 18.0                               # s, Fig. 10 and 11
STIFFNESS_DURATION = 20.0                                            # s
FILM_SECTIONS, TIRE_SECTIONS = 6, 7
TITLE = 'Reproduced figures and tables'
ABOUT = (
    'All figures and tables with data of the two papers, from the models of this package and '
    'simulated experiments with the parameters of the papers. Paper A: "A PVDF-Based Deformation '
    'and Motion Sensor: Modeling and Experiments". Paper B: "A Piezo-Sensor-Based Smart Tire '
    'System for Mobile Robots and Vehicles".')
LIMITS = (
    'A simulation can show that formulas are consistent, that an estimator recovers the inputs, '
    'and where a printed formula is wrong. It cannot show that the real film or tire obeys the '
    'model; the assumptions are stated with each figure. Numbers and statements are computed '
    'with the figures.')


def reproduce(directory: Path, progress: Progress) -> Path:
    """Run the experiments, write a PNG file per section and the report; return its path."""
    directory.mkdir(parents=True, exist_ok=True)
    steps = _Steps(progress)
    sections = [page_section(section, directory)
                for section in (*film_sections(steps), *tire_sections(steps))]
    report = directory / 'report.html'
    report.write_text(page.html_page(page.Report(
        TITLE, (), sections, [ABOUT], notes=[LIMITS])), encoding='utf-8')
    steps.start('done')
    return report


def page_section(section: PaperSection, directory: Path) -> page.Section:
    """Write the figure of a section into ``directory``; return the section of the page."""
    name, title = section.figure.name, section.figure.title
    blocks: list[page.Block] = [
        page.Picture(title, save(section.figure, directory / f'{name}.png')),
        Table('Numbers', ('quantity', 'paper', 'here'), section.numbers, 3)]
    if section.agrees:
        blocks += ['Agrees:', list(section.agrees)]
    if section.differs:
        blocks += ['Differs, or cannot be compared:', page.Note(section.differs)]
    return page.Section(name, title.split(':')[0], title, blocks)


class _Steps:
    """Counts the steps at their start."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._begun = progress, 0
        self._total = FILM_SECTIONS + TIRE_SECTIONS + len(SWEEP_SPEEDS) * len(OTHER_SIDE_SPEEDS)

    def start(self, task: str) -> None:
        self._progress(self._begun, self._total, task)
        self._begun += 1


def film_sections(steps: _Steps) -> Iterator[PaperSection]:
    """Yield the sections of paper A."""
    steps.start('paper A, Fig. 4')
    yield paper_a.trace_section(film_experiments.buckling_test())
    steps.start('paper A, Fig. 6')
    yield paper_a.rate_section(film_experiments.rate_independence())
    steps.start('paper A, Fig. 7')
    yield paper_a.amplitude_section(film_experiments.proportionality())
    steps.start('paper A, Fig. 8')
    fits = film_experiments.identification()
    yield paper_a.fit_section(fits)
    steps.start('paper A, Fig. 9')
    yield paper_a.comparison_section(fits)
    steps.start('paper A, Table I')
    yield paper_a.table_section(fits)


def tire_sections(steps: _Steps) -> Iterator[PaperSection]:
    """Yield the sections of paper B."""
    steps.start('paper B, Fig. 8')
    yield paper_b.outline_section(tire_maps.outline())
    steps.start('paper B, Fig. 9')
    runs = {ground: drive(ground, steady(120.0, 60.0), SLIP_DURATION)
            for ground in ('concrete', 'sand')}
    views = {ground: camera_view(run, RENDERED_DURATIONS[ground]) for ground, run in runs.items()}
    yield paper_b.view_section(views['concrete'], runs['concrete'])
    steps.start('paper B, Fig. 10')
    yield paper_b.slip_section(runs, views, *(
        {ground: tire_runs.side_slips(run, getattr(run, kind)) for ground, run in runs.items()}
        for kind in ('estimates', 'printed')))
    steps.start('paper B, Fig. 11')
    run = drive('concrete', steady(60.0, 80.0), SIGNAL_DURATION)
    yield paper_b.signal_section(tire_maps.signals(run), run)
    sweep = tire_maps.sweep(sweep_crossings(steps))
    steps.start('paper B, Fig. 12')
    yield paper_b.stretch_section(sweep)
    steps.start('paper B, Fig. 13')
    yield paper_b.adhesion_section(sweep)
    steps.start('paper B, Table I')
    run = drive('concrete', tire_runs.oscillating, STIFFNESS_DURATION)
    yield paper_b.table_section(sweep, tire_runs.stiffness(run, tire_maps.MU))


def sweep_crossings(steps: _Steps) -> Crossings:
    """Return the crossings of drives at all pairs of wheel speeds."""
    parts = []
    for right in SWEEP_SPEEDS:
        for left in OTHER_SIDE_SPEEDS:
            steps.start(f'paper B, Fig. 12: {left:.0f}/{right:.0f} rpm')
            run = drive('concrete', steady(left, right), SWEEP_DURATION, seed=round(left + right))
            parts.append(crossings(run, right))
    return tire_runs.concatenated(parts)
