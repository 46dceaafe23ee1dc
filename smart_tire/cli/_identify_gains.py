"""``smart_tire identify gains``: gains, contact length and places of films, out of bags."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from smart_tire.cli._arguments import add_recordings
from smart_tire.cli._output import check_out, put_out

if TYPE_CHECKING:
    from smart_tire.calibration.film.results import GainFit
    from smart_tire.uncertain import Uncertain

NAME = 'gains'
HELP = 'volts per unit slip of each film, contact length, spacing and angle of films, out of bags'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments of this kind."""
    add_recordings(parser, reference=False)


def run(args: argparse.Namespace) -> int:
    """Identify, print a table, and write what was told, and a figure."""
    check_out(args, NAME)
    from smart_tire.analysis.calibrate_robot import load_robot, Span
    from smart_tire.analysis.calibrate_tire import gain_parameters, identify_gains
    from smart_tire.analysis.gain_figures import write_gains
    robot = load_robot(args.params)
    found = identify_gains(args.bags, robot, Span(args.since, args.until))
    for line in _lines(found, [bag.name for bag in args.bags]):
        print(line)
    return put_out(args, NAME, gain_parameters(found, robot),
                   lambda figure: write_gains(figure, found))


def _lines(found: GainFit, bags: list[str]) -> list[str]:
    """Return the table."""
    lines = []
    for one in found.films:
        name = f'film {one.film + 1}, {one.wheel}'
        if one.gain is not None and one.per_slip is not None:
            lines.append(_line(f'gain of {name}', one.gain, 'V/m', f'{len(one.slip)} passages'))
            lines.append(_line('', one.per_slip, 'V', 'per unit of slip, while all of the patch '
                                                      'sticks'))
        lines.append(_line(f'bending of {name}', one.bending, 'V', 'peak'))
    if found.length is not None:
        lines.append(_line('contact length', found.length, 'm', 'with the wheel_radius given'))
    lines += [_line(f'spacing, film 1 to {film + 1}', place, 'm', 'from middle to middle')
              for film, place in sorted(found.places.items())]
    lines += [_line(f'angle of film 1, {wheel}', angle, 'rad', 'wheel_states.position over the '
                    'middle of the patch' + (f', {bags[run]}' if len(bags) > 1 else ''))
              for (run, wheel), angle in found.angles.items()]
    lines += [f'{name:32}not told: {why}' for name, why in found.refused.items()]
    lines.append(f'{found.informative} of {found.crossings} passages tell gains, in '
                 f'{found.segments} stretches of like slip; their slips stray '
                 f'{found.excess ** 0.5:.2g} times as far as expected')
    return lines


def _line(name: str, told: Uncertain, unit: str, note: str) -> str:
    return f'{name:32}{told.value:10.5g} ± {told.sigma:<8.2g} {unit:4}{note}'
