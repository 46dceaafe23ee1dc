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

"""``smart_tire identify gains``: film gains, contact length and film positions from bags."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from smart_tire.cli._options import add_recordings, bag_settings, check_output, write_parameters

if TYPE_CHECKING:
    from smart_tire.calibration.film_gains import GainFit
    from smart_tire.uncertain import Uncertain

NAME = 'gains'
HELP = 'film gains (volts per unit slip), contact length, and spacing and angle of the films'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this kind."""
    add_recordings(parser, reference=False)


def run(args: argparse.Namespace) -> int:
    """Identify, print a table, and write parameters and figure."""
    check_output(args, NAME)
    from smart_tire.analysis.calibrate_robot import TimeRange
    from smart_tire.analysis.calibrate_tire import gain_parameters, identify_gains
    from smart_tire.analysis.calibration_figures import write_gains
    settings = bag_settings(args.bags, args)
    robot = settings.params.robot
    found = identify_gains(args.bags, robot, TimeRange(args.since, args.until),
                           settings.names)
    for line in _lines(found, [bag.name for bag in args.bags]):
        print(line)
    return write_parameters(args, NAME, gain_parameters(found, robot),
                            lambda figure: write_gains(figure, found))


def _lines(found: GainFit, bags: list[str]) -> list[str]:
    """Return the lines of the table."""
    lines = []
    for film in found.films:
        name = f'film {film.film + 1}, {film.wheel}'
        if film.gain is not None and film.per_slip is not None:
            lines.append(_line(f'gain of {name}', film.gain, 'V/m', f'{len(film.slip)} crossings'))
            lines.append(_line('', film.per_slip, 'V', 'per unit slip, patch fully adhering'))
        lines.append(_line(f'bending of {name}', film.bending, 'V', 'peak'))
    if found.length is not None:
        lines.append(_line('contact length', found.length, 'm', 'for the given wheel_radius'))
    lines += [_line(f'spacing, film 1 to {film + 1}', spacing, 'm', 'between film centers')
              for film, spacing in sorted(found.places.items())]
    lines += [_line(f'angle of film 1, {wheel}', angle, 'rad', 'wheel_states.position at the '
                    'patch center' + (f', {bags[run]}' if len(bags) > 1 else ''))
              for (run, wheel), angle in found.angles.items()]
    lines += [f'{name:32}not observable: {why}' for name, why in found.refused.items()]
    lines.append(f'gains from {found.informative} of {found.crossings} crossings in '
                 f'{found.segments} constant-slip segments; residual scatter '
                 f'{found.excess ** 0.5:.2g} times the expected one')
    return lines


def _line(name: str, value: Uncertain, unit: str, note: str) -> str:
    return f'{name:32}{value.value:10.5g} ± {value.sigma:<8.2g} {unit:4}{note}'
