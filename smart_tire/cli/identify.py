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

"""
``smart_tire identify KIND``: parameters from recordings, with standard errors.

All kinds but the film on a test stand (``_identify_film``) read bags; ``smart_tire calibrate
--only KIND`` calls them as well.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from smart_tire.cli import _identify_film
from smart_tire.cli._options import (
    add_recordings, bag_settings, IDENTIFIED, NOT_IDENTIFIED, output_path, refuse_existing)

if TYPE_CHECKING:
    from smart_tire.analysis.identify import Source

NAME = 'identify'
HELP = 'identify parameters of film, tire or robot from recordings, with standard errors'
KINDS = {
    'geometry': 'encoder latency, effective track, rolling radius, and mounting and noise of the '
                'IMU',
    'icr': 'x coordinate S of the instantaneous center of rotation, by the curve fit of paper B',
    'motor': 'torque constant from starts and stops; with --lifted also friction and inertia of '
             'the drives; feed-forward of the wheel controller',
    'stiffness': 'longitudinal tire stiffness C_x, from acceleration and braking on straight '
                 'segments',
    'gains': 'film gains (volts per unit slip), contact length, and spacing and angle of the '
             'films'}
WITH_REFERENCE = ('geometry', 'icr')  # kinds that can use reference poses
NAME_WIDTH = 32


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of every kind."""
    choices = parser.add_subparsers(dest='kind', metavar='KIND', required=True)
    for name, text in KINDS.items():
        kind = choices.add_parser(name, help=text, description=text)
        add_recordings(kind, reference=name in WITH_REFERENCE)
        if name == 'motor':
            kind.add_argument('--lifted', type=Path, action='append', default=[], metavar='BAG',
                              help='recording with all wheels off the ground; may be repeated')
        kind.set_defaults(run_kind=run_bags)
    film = choices.add_parser('film', help=_identify_film.HELP, description=_identify_film.HELP)
    _identify_film.add_arguments(film)
    film.set_defaults(run_kind=_identify_film.run)


def run(args: argparse.Namespace) -> int:
    """Run the selected kind; return the exit status."""
    return int(args.run_kind(args))


def run_bags(args: argparse.Namespace) -> int:
    """Identify from bags, print the result, and write parameters and figure."""
    out, lifted = output_path(args, args.kind), getattr(args, 'lifted', [])
    figure, bags = out.with_suffix('.png'), [*args.bags, *lifted]
    refuse_existing([out, figure], force=args.force, inputs=[*bags, *args.params])
    from smart_tire.analysis.calibrate_robot import TimeRange
    from smart_tire.analysis.identify import Source
    settings = bag_settings(bags, args)
    return report(args.kind, Source(
        args.bags, settings.params.robot, TimeRange(args.since, args.until),
        getattr(args, 'reference', 'none'), settings.names, lifted), out, figure)


def report(kind: str, source: Source, out: Path, figure: Path) -> int:
    """Print what ``source`` shows, write parameter file and figure; return the exit status."""
    from smart_tire.analysis.identify import identify
    from smart_tire.parameters.calibration_file import identified_text, write_text
    made = identify(kind, source)
    for item in made.found.quantities:
        value, sigma = item.estimate
        print(f'{item.name:{NAME_WIDTH}}{value:12.6g} ± {sigma:<8.2g} {item.unit:9}{item.note}')
    for reasons, text in ((made.found.refused, 'not observable'),
                          (made.found.kept, 'not written')):
        for name, why in reasons.items():
            print(f'{name:{NAME_WIDTH}}{text}: {why}')
    for note in made.found.notes:
        print(f'note: {note}')
    if not made.parameters:
        print('nothing could be identified from these recordings')
        return NOT_IDENTIFIED
    bags = ', '.join(map(str, (*source.bags, *source.lifted)))
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, identified_text([f'Identified from {bags}.'], made.parameters))
    print(f'written to {out}' + (f' and {figure}' if made.draw(figure) else ''))
    return IDENTIFIED
