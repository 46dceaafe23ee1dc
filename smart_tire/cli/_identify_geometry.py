"""``smart_tire identify geometry``: latency, track, radius and mounting out of bags."""

from __future__ import annotations

import argparse

from smart_tire.cli._arguments import add_recordings
from smart_tire.cli._output import check_out, put_out

NAME = 'geometry'
HELP = 'wheel latency, effective track, rolling radius and IMU of a robot, out of bags'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments of this kind."""
    add_recordings(parser)


def run(args: argparse.Namespace) -> int:
    """Identify, print a table, and write what was told."""
    check_out(args, NAME)
    from smart_tire.analysis.calibrate_robot import identify_geometry, load_robot
    from smart_tire.analysis.geometry_figures import write_geometry
    from smart_tire.calibration.robot.geometry import combine, parameters
    robot = load_robot(args.params)
    found = combine([identify_geometry(bag, robot, since=args.since, until=args.until,
                                       reference=args.reference) for bag in args.bags])
    for item in found.quantities:
        print(f'{item.name:24}{item.estimate.value:12.6g} ± {item.estimate.sigma:<8.2g} '
              f'{item.unit:6}{item.note}')
    for name, why in found.refused.items():
        print(f'{name:24}not told: {why}')
    return put_out(args, NAME, parameters(found, robot),
                   lambda figure: write_geometry(figure, found))
