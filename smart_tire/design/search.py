# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The best layout under limits, and how its accuracy depends on each of its properties."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np

from smart_tire.analysis.figure import ColorField, Figure, Panel
from smart_tire.design.drive import DriveInformation
from smart_tire.design.layout import Accuracy, FilmLayout, Study

Axis = tuple[float, float, int, float, str]
AXES: Mapping[str, Axis] = {  # of each property: first value, step, count, factor to SI, label
    'spacing': (20.0, 15.0, 9, 1e-3, 'distance of films [mm]'),
    'length': (8.0, 4.0, 8, 1e-3, 'film length [mm]'),
    'across': (0.0, 0.2, 5, 1.0, 'place across, of the half width'),
    'bits': (6, 2, 4, 1, 'bits of a sample'),
    'rate': (200.0, 200.0, 5, 1.0, 'sampling rate [Hz]'),
    'noise': (2.0, 4.0, 6, 1e-3, 'noise of a sample [mV]'),
    'films': (1, 1, 4, 1, 'films per wheel'),
    'wheels': (1, 1, 4, 1, 'instrumented wheels')}
SEARCHED = 'spacing', 'length', 'across', 'bits'
MAPS = (('length', 'spacing'), ('length', 'across'), ('wheels', 'films'),
        ('rate', 'length'), ('rate', 'noise'), ('rate', 'bits'))
FACTORS = 0.5, 1.0, 2.0  # of wheel speed, contact length and stiffness
MIN_IMPROVEMENT = 2e-3   # relative, of a step of the search: less is no reason for another layout
MAP_CELL = 3.6, 3.2      # inch
QUANTITIES = {'friction': 'mu after the drive [%]', 'slip': 'slip at the end [0.01]',
              'contact_length': 'contact length, one crossing [%]'}


def values_of(name: str) -> list[Any]:
    """Return the values of a property in ``AXES``."""
    first, step, count, factor, _ = AXES[name]
    return [factor * (first + step * i) for i in range(count)]


@dataclass(frozen=True)
class Limits:
    """What a layout may need."""

    films: int      # on all wheels
    rate: float     # Hz
    bits: int       # of a sample
    budget: float   # bit/s, load of the radio link of all sensor nodes
    batch: int      # samples per packet

    def sampled(self, layout: FilmLayout) -> FilmLayout:
        """Return ``layout`` with the largest sampling rate that is allowed."""
        return replace(layout, rate=min(
            self.rate, self.budget / layout.radio_load(self.batch) * layout.rate))


def search(objective: Callable[[FilmLayout], float], start: FilmLayout,
           choices: Mapping[str, list[Any]]) -> FilmLayout:
    """
    Return the layout with the least ``objective``, by descent along one property after another.

    ``choices`` are the values of each property. A change must improve by ``MIN_IMPROVEMENT``.
    """
    best, least, before = start, objective(start), None
    while best != before:
        before = best
        for name, values in choices.items():
            for value in values:
                found = objective(other := replace(best, **{name: value}))
                if found < (1.0 - MIN_IMPROVEMENT) * least:
                    best, least = other, found
    return best


def best_layouts(study: Study, start: FilmLayout, limits: Limits, quantity: str
                 ) -> Iterator[FilmLayout]:
    """Yield the best layout for each number of wheels and of films per wheel that is allowed."""
    def objective(layout: FilmLayout) -> float:
        value: float = getattr(study.accuracy(limits.sampled(layout)), quantity)
        return value

    for wheels in values_of('wheels'):
        for films in values_of('films'):
            if wheels * films > limits.films:
                continue
            bits = [one for one in values_of('bits') if one < limits.bits] + [limits.bits]
            found = limits.sampled(search(
                objective, replace(start, wheels=wheels, films=films, bits=limits.bits), {
                    **{name: values_of(name) for name in SEARCHED}, 'bits': bits}))
            if math.isfinite(objective(found)):
                yield found


def sensitivity(study: Study, layout: FilmLayout) -> Iterator[tuple[str, float, Accuracy]]:
    """
    Yield property, value and accuracy with ``layout``, one property after another changed.

    Wheel speed, contact length and stiffness are relative to those of the drives.
    """
    for name in AXES:
        for value in values_of(name):
            yield name, value, study.accuracy(replace(layout, **{name: value}))
    for i, name in enumerate(('wheel_speed', 'tire_length', 'tire_stiffness')):
        for factor in FACTORS:
            other = study if factor == 1.0 else Study([_varied(drive, *(
                factor if i == k else 1.0 for k in range(3))) for drive in study.drives])
            yield name, factor, other.accuracy(layout)


def _varied(drive: DriveInformation, speed: float, length: float, stiffness: float
            ) -> DriveInformation:
    tire, legs = drive.robot.tire, np.array(drive.drive.legs) * [1.0, speed, speed]
    return DriveInformation(
        replace(drive.robot, tire=replace(
            tire, contact_length=length * tire.contact_length,
            longitudinal_stiffness=stiffness * tire.longitudinal_stiffness)),
        drive.ground._replace(stiffness=stiffness * drive.ground.stiffness),
        drive.drive._replace(legs=tuple(map(tuple, legs.tolist()))), drive.torque)


def maps(study: Study, layout: FilmLayout, quantity: str, report: Callable[[str], object]
         ) -> Figure:
    """Return maps of a quantity around ``layout``, over two properties each."""
    def panel(x: str, y: str) -> Panel:
        report(f'map over {x} and {y}')
        values = 100.0 * np.array([[getattr(study.accuracy(
            replace(layout, **{x: column, y: row})), quantity)
            for column in values_of(x)] for row in values_of(y)])
        values[~np.isfinite(values)] = math.nan
        (left, width, columns, *_), (bottom, height, rows, *_) = AXES[x], AXES[y]
        low, high = np.nanpercentile(values, [0.0, 95.0]).tolist()
        return Panel((), AXES[x][-1], AXES[y][-1], field=ColorField(values, (
            left - 0.5 * width, left + (columns - 0.5) * width, bottom - 0.5 * height,
            bottom + (rows - 0.5) * height), QUANTITIES[quantity], (low, max(high, 1.01 * low))))

    panels = [panel(*axes) for axes in MAPS]
    return Figure(
        'design_maps', f'Maps of the accuracy: {QUANTITIES[quantity]}',
        f'Bound of the standard deviation around the layout {layout} (wheels x films x length), '
        'two properties changed in each map. White: the films do not fit.',
        [panels[:3], panels[3:]], MAP_CELL)
