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

"""``smart_tire identify geometry``: latency, track, radius and IMU mounting from bags."""

from __future__ import annotations

import argparse

from smart_tire.cli._options import add_recordings, bag_settings, check_output, write_parameters

NAME = 'geometry'
HELP = 'encoder latency, effective track, rolling radius, and mounting and noise of the IMU'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this kind."""
    add_recordings(parser)


def run(args: argparse.Namespace) -> int:
    """Identify, print a table, and write parameters and figure."""
    check_output(args, NAME)
    from smart_tire.analysis.calibrate_robot import identify_geometry
    from smart_tire.analysis.calibration_figures import write_geometry
    from smart_tire.calibration.geometry import combine
    settings = bag_settings(args.bags, args)
    robot = settings.params.robot
    found = combine([identify_geometry(
        bag, robot, since=args.since, until=args.until, reference=args.reference,
        names=settings.names) for bag in args.bags])
    for item in found.quantities:
        print(f'{item.name:24}{item.estimate.value:12.6g} ± {item.estimate.sigma:<8.2g} '
              f'{item.unit:6}{item.note}')
    for name, why in found.refused.items():
        print(f'{name:24}not observable: {why}')
    for name, why in found.kept.items():
        print(f'{name:24}not written: {why}')
    return write_parameters(args, NAME, found.parameters(robot),
                            lambda figure: write_geometry(figure, found))
