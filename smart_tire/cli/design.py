# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire design``: where to put films: the accuracy of layouts, and the best one."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
import json
from pathlib import Path
from typing import Any, TYPE_CHECKING

from smart_tire.cli._outputs import refuse_existing, remove, undone_if_interrupted
from smart_tire.cli._progress import ProgressLine
from smart_tire.errors import ParameterError
from smart_tire.paths import write_text

if TYPE_CHECKING:
    from smart_tire.design.drive import DriveSchedule, Ground
    from smart_tire.parameters.simulation import SurfaceParams

FILES = 'summary.json', 'layouts.csv', 'sensitivity.csv', 'design_maps.png'
DRIVE_COLUMNS = 'time_s', 'left_rpm', 'right_rpm'
DURATIONS = 5.0, 60.0  # s: more than one window, and what the contact of films remembers


def run(args: argparse.Namespace) -> int:
    """Search the best layout; print and write its accuracy and that of others."""
    refuse_existing([args.out / name for name in FILES], force=args.force, inputs=args.params)
    from smart_tire.analysis.drawing import save
    from smart_tire.analysis.summary import plain
    from smart_tire.design.drive import DriveInformation
    from smart_tire.design.layout import FilmLayout, Study
    from smart_tire.design.search import best_layouts, Limits, maps, sensitivity
    from smart_tire.parameters import load_node
    params = load_node(args.params, 'robot_simulator')
    own, batch, ground = FilmLayout.of(params.robot), params.radio.batch, params.ground
    if not own.wheels:
        raise ParameterError('film.wheels is empty: layouts are compared with that of the robot')
    limits = Limits(args.films or own.wheels * own.films, args.rate or own.rate, own.bits,
                    1e3 * args.budget if args.budget else own.radio_load(batch), batch)
    cases = [(ground_of(name, ground), drive_of(drive))
             for name in args.ground or ground.names for drive in args.drive or ['turn']]
    with ProgressLine('smart_tire design') as progress, undone_if_interrupted(
            lambda: remove(args.out, FILES)):
        progress.show('motion of the drives')
        study = Study([DriveInformation(params.robot, *case, args.torque) for case in cases])
        layouts = {'none': replace(own, wheels=0), 'robot': own}
        for layout in best_layouts(study, own, limits, args.quantity):
            progress.show(str(layout))
            layouts[f'{layout.wheels} x {layout.films}'] = layout
        best = min(layouts.values(), key=lambda one: float(
            getattr(study.accuracy(one), args.quantity)))
        rows = [{'name': name, **asdict(one), 'radio_load': one.radio_load(batch),
                 **study.accuracy(one)._asdict()} for name, one in layouts.items()]
        progress.show('properties of the best layout')
        changes = [{'property': name, 'value': value, **accuracy._asdict()}
                   for name, value, accuracy in sensitivity(study, best)]
        write_text(args.out / FILES[0], json.dumps(plain({
            'cases': [{'ground': one._asdict(), 'drive': drive._asdict()} for one, drive in cases],
            'limits': limits, 'quantity': args.quantity, 'layouts': rows, 'best': best,
            'sensitivity': changes}), indent=1, allow_nan=False) + '\n')
        write_text(args.out / FILES[1], _csv(rows))
        write_text(args.out / FILES[2], _csv(changes))
        if args.maps:
            save(maps(study, best, args.quantity, progress.show), args.out / FILES[3])
    print('bound of the standard deviation: mu after the drive, slip at its end, slip from the\n'
          f'films and contact length in one crossing; rms over {len(cases)} cases')
    for (name, layout), row in zip(layouts.items(), rows):
        mu, slip, films, length = (100.0 * one for one in study.accuracy(layout))
        print(f'{name:6} {mu:6.2f} %  {slip:5.2f} %  {films:5.2f} %  {length:5.2f} %  '
              f'{1e-3 * row["radio_load"]:5.1f} kbit/s  {layout}{"  best" * (layout == best)}')
    before, after = (getattr(study.accuracy(one), args.quantity) for one in (own, best))
    print(f"{args.quantity}: {after / before:.3f} times that of the robot's layout\n"
          f'written to {args.out}')
    return 0


def ground_of(text: str, known: SurfaceParams) -> Ground:
    """Return a surface of ``known``, or that of three numbers; raise ParameterError for others."""
    from smart_tire.design.drive import Ground
    surfaces = {name: Ground(name, *values) for name, *values in zip(
        known.names, known.stiffness, known.friction, known.drag)}
    try:
        if text not in surfaces:
            friction, stiffness, drag = map(float, text.split(','))
            if not (0.0 < friction <= 5.0 and 0.0 < drag <= 1.0 and 1e-3 <= stiffness <= 1e6):
                raise ValueError
            surfaces[text] = Ground(text, stiffness, friction, drag)
    except ValueError as error:
        raise ParameterError(f'--ground {text}: expected MU,C_X,DRAG, three positive numbers in '
                             f'range, or one of {", ".join(known.names)}') from error
    return surfaces[text]


def drive_of(text: str) -> DriveSchedule:
    """Return a drive of ``DRIVES``, or that of a CSV file; raise ParameterError for others."""
    from smart_tire.design.drive import DriveSchedule, DRIVES
    if text in DRIVES:
        return DRIVES[text]
    path = Path(text)
    if not path.exists():
        raise ParameterError(f'--drive {text}: no such file, and not one of {", ".join(DRIVES)}')
    import numpy as np
    from smart_tire.papers.film_files import read_columns
    rows = np.column_stack(read_columns(path, DRIVE_COLUMNS, only=True))
    if not (len(rows) > 1 and np.isfinite(rows).all() and (np.diff(rows[:, 0]) > 0.0).all()
            and rows[0, 0] >= 0.0 and DURATIONS[0] <= rows[-1, 0] <= DURATIONS[1]):
        raise ParameterError(f'{path}: expected finite numbers, and times that increase from 0 s '
                             'or later to an end at {:g} to {:g} s'.format(*DURATIONS))
    return DriveSchedule(path.name, tuple(map(tuple, rows.tolist())), float(rows[-1, 0]))


def _csv(rows: Iterable[Mapping[str, Any]]) -> str:
    names, *_ = rows
    return '\n'.join([','.join(names), *(','.join(map(str, row.values())) for row in rows), ''])
