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
from dataclasses import asdict
import json
from pathlib import Path
from typing import Any, TYPE_CHECKING

from smart_tire.cli._outputs import refuse_existing, remove, undone_if_interrupted
from smart_tire.cli._progress import ProgressLine
from smart_tire.errors import did_you_mean, ParameterError
from smart_tire.paths import write_text

if TYPE_CHECKING:
    from smart_tire.design.drive import Drive, Ground
    from smart_tire.design.layout import Accuracy, Layout
    from smart_tire.parameters import SimulatorParams

FILES = 'design.json', 'layouts.csv', 'sensitivity.csv', 'design_maps.png'
DRIVES = {  # durations [s], and wheel speeds [rpm], left and right
    'turn': ((1.0, 0.0, 0.0), (9.0, 60.0, 80.0)),
    'fast_turn': ((1.0, 0.0, 0.0), (9.0, 120.0, 60.0)),
    'straight': ((1.0, 0.0, 0.0), *((2.0, 80.0, 80.0), (1.0, 0.0, 0.0)) * 3),
    's_curves': ((1.0, 0.0, 0.0), *((1.5, 100.0, 60.0), (1.5, 60.0, 100.0)) * 3)}
DRIVE_COLUMNS = 'time_s', 'left_rpm', 'right_rpm'
MIN_DURATION, MAX_DURATION = 5.0, 60.0  # s: two windows, and what the contact of films remembers
HEADER = ('wheels films length  apart across   rate bits  kbit/s    mu %  slip %  film slip %  '
          'contact length %')


def run(args: argparse.Namespace) -> int:
    """Search the best layout; print and write its accuracy and that of others."""
    refuse_existing([args.out / name for name in FILES], force=args.force, inputs=args.params)
    from smart_tire.analysis.drawing import save
    from smart_tire.analysis.summary import plain
    from smart_tire.design.drive import DriveInformation
    from smart_tire.design.layout import Layout, Study
    from smart_tire.design.search import best_layouts, Limits, maps, sensitivity
    from smart_tire.parameters import load_node
    params = load_node(args.params, 'robot_simulator')
    batch, robot = params.radio.batch, params.robot
    grounds = [ground_of(name, params) for name in args.ground or params.ground.names]
    drives = [drive_of(name) for name in args.drive or ['turn']]
    if not robot.film.wheels:
        raise ParameterError('film.wheels is empty: layouts are compared with that of the robot')
    own = Layout.of(robot, charge_noise=args.noise == 'charge')
    limits = Limits(args.films or own.wheels * own.films, args.rate or own.rate, own.bits,
                    1e3 * args.budget if args.budget else own.radio_load(batch), batch)
    with ProgressLine('smart_tire design') as progress, undone_if_interrupted(
            lambda: remove(args.out, FILES)):
        progress.show('motion of the drives')
        study = Study([DriveInformation(robot, ground, drive, args.torque)
                       for ground in grounds for drive in drives], args.tread == 'round')
        bare = study.drives_alone()
        found = [own]
        for layout in best_layouts(study, own, limits, args.quantity):
            found.append(layout)
            progress.show(f'{layout.films} films on each of {layout.wheels} wheels')
        best = min(found[1:], key=lambda one: getattr(study.accuracy(one), args.quantity),
                   default=own)
        rows = [{**asdict(one), 'radio_load': one.radio_load(batch),
                 **study.accuracy(one)._asdict()} for one in found]
        progress.show('properties of the best layout')
        changes = list(sensitivity(study, best))
        tree = {'limits': asdict(limits), 'grounds': [one._asdict() for one in grounds],
                'drives': [one._asdict() for one in drives], 'without_films': bare._asdict(),
                'robot': rows[0], 'best': rows[found.index(best)], 'layouts': rows[1:]}
        write_text(args.out / FILES[0], json.dumps(plain(tree), indent=1, allow_nan=False) + '\n')
        write_text(args.out / FILES[1], _csv(rows))
        write_text(args.out / FILES[2], _csv([
            {'property': name, 'value': value, **accuracy._asdict()}
            for name, value, accuracy in changes]))
        if args.maps:
            save(maps(study, best, args.quantity, progress.show), args.out / FILES[3])
    print(f'bound of the standard deviations, rms over {len(study.drives)} drives: '
          f'{", ".join(one.name for one in grounds)}; {", ".join(one.name for one in drives)}')
    print(f'without films: mu {100.0 * bare.friction:.1f} %, slip {100.0 * bare.slip:.2f} %')
    print(f'{"":8}{HEADER}')
    for layout in found:
        title = 'robot' if layout is own else 'best' if layout == best else ''
        print(f'{title:8}{_line(layout, study.accuracy(layout), batch)}')
    before, after = (getattr(study.accuracy(one), args.quantity) for one in (own, best))
    print(f'{args.quantity} of the best layout: {after / before:.3f} times that of the robot\'s')
    print(f'written to {args.out}')
    return 0


def ground_of(text: str, params: SimulatorParams) -> Ground:
    """Return a surface of ``params``, or that of three numbers; raise ParameterError for others."""
    from smart_tire.design.drive import Ground
    from smart_tire.parameters.simulation import SurfaceParams
    known = params.ground
    if text in known.names:
        i = known.names.index(text)
        return Ground(text, known.stiffness[i], known.friction[i], known.drag[i])
    try:
        friction, stiffness, drag = map(float, text.split(','))
        if not (friction > 0.0 and drag > 0.0):
            raise ValueError(text)
        SurfaceParams(names=(text,), friction=(friction,), stiffness=(stiffness,), drag=(drag,),
                      base=text, patches=())
    except ValueError as error:
        raise ParameterError(
            f'--ground {text}: expected MU,C_X,DRAG, all positive, or one of '
            f'{", ".join(known.names)}{did_you_mean(text, known.names)}') from error
    return Ground(text, stiffness, friction, drag)


def drive_of(text: str) -> Drive:
    """Return a drive of ``DRIVES``, or that of a CSV file; raise ParameterError for others."""
    from smart_tire.design.drive import Drive
    if text in DRIVES:
        ends = [sum(one[0] for one in DRIVES[text][:i]) for i in range(len(DRIVES[text]) + 1)]
        return Drive(text, tuple((begin, *one[1:]) for begin, one in zip(ends, DRIVES[text])),
                     ends[-1])
    path = Path(text)
    if not path.exists():
        raise ParameterError(f'--drive {text}: no such file, and not one of {", ".join(DRIVES)}')
    import numpy as np
    from smart_tire.papers.film_files import read_columns
    rows = np.column_stack(read_columns(path, DRIVE_COLUMNS, only=True))
    if len(rows) < 2 or not np.isfinite(rows).all() or (np.diff(rows[:, 0]) <= 0.0).any() or (
            rows[0, 0] < 0.0 or not MIN_DURATION <= rows[-1, 0] <= MAX_DURATION):
        raise ParameterError(f'{path}: expected finite numbers, times that increase from 0 or '
                             f'later, and an end at {MIN_DURATION:g} to {MAX_DURATION:g} s')
    return Drive(path.name, tuple(map(tuple, rows.tolist())), float(rows[-1, 0]))


def _line(layout: Layout, accuracy: Accuracy, batch: int) -> str:
    apart = f'{1e3 * layout.spacing:4.0f} mm' if layout.films > 1 else '-'
    friction, slip, film_slip, length = (100.0 * one for one in accuracy)
    return (f'{layout.wheels:6} {layout.films:5} {1e3 * layout.length:3.0f} mm {apart:>7} '
            f'{layout.across:6.1f} {layout.rate:6.0f} {layout.bits:4} '
            f'{1e-3 * layout.radio_load(batch):7.1f} {friction:7.2f} {slip:7.2f} {film_slip:12.2f} '
            f'{length:17.2f}')


def _csv(rows: list[dict[str, Any]]) -> str:
    return '\n'.join([','.join(rows[0]), *(','.join(map(str, row.values())) for row in rows), ''])
