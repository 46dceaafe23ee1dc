"""``smart_tire identify stiffness``: C_x from straight acceleration and braking."""

from __future__ import annotations

import argparse

from smart_tire.cli._arguments import add_recordings
from smart_tire.cli._output import check_out, put_out

NAME = 'stiffness'
HELP = 'longitudinal stiffness C_x of the tires, from straight acceleration and braking'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments of this kind."""
    add_recordings(parser, reference=False)


def run(args: argparse.Namespace) -> int:
    """Identify, print, and write parameters and figure."""
    check_out(args, NAME)
    from smart_tire.analysis.calibrate_robot import load_robot, Span
    from smart_tire.analysis.calibrate_tire import identify_stiffness, stiffness_parameters
    from smart_tire.analysis.stiffness_figures import write_stiffness
    robot = load_robot(args.params)
    found = identify_stiffness(args.bags, robot, Span(args.since, args.until))
    for name, told, unit, note in (
            ('stiffness', found.stiffness, 'N', f'C_x, in proportion to the mass of {robot.mass:g}'
                                                ' kg that is given'),
            ('rolling drag', found.drag, 'N', 'of all wheels; information'),
            ('friction', found.friction, '-', 'as far as it bends the curve; information'),
            ('lateness', found.latency_error, 's', 'of wheel stamps, beyond encoder.latency; '
                                              'information')):
        print(f'{name:14}{told.value:10.5g} ± {told.sigma:<8.2g} {unit:3}{note}')
    print(f'{found.segments} straight runs of {found.duration:.1f} s in all; residuals are '
          f'{found.excess ** 0.5:.2g} times what noise explains')
    return put_out(args, NAME, stiffness_parameters(found),
                   lambda figure: write_stiffness(figure, found))
