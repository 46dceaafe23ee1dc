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

"""``smart_tire identify motor``: torque constant, friction, inertia and feed-forward."""

from __future__ import annotations

import argparse
from pathlib import Path

from smart_tire.cli._options import add_recordings, bag_settings, check_output, write_parameters

NAME = 'motor'
HELP = ('torque constant from starts and stops; with --lifted also friction and inertia of the '
        'drives; feed-forward of the wheel controller')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this kind."""
    add_recordings(parser, reference=False)
    parser.add_argument('--lifted', type=Path, action='append', default=[], metavar='BAG',
                        help='recording with all wheels off the ground; may be repeated')


def run(args: argparse.Namespace) -> int:
    """Identify, print a table, and write parameters and figure."""
    check_output(args, NAME)
    from smart_tire.analysis.calibrate_motor import identify_motor
    from smart_tire.analysis.calibrate_robot import TimeRange
    from smart_tire.analysis.calibration_figures import write_motor
    settings = bag_settings([*args.bags, *args.lifted], args)
    robot = settings.params.robot
    found = identify_motor(args.bags, args.lifted, robot, TimeRange(args.since, args.until),
                           settings.names)
    for item in found.quantities:
        print(f'{item.name:18}{item.estimate.value:11.5g} ± {item.estimate.sigma:<8.2g} '
              f'{item.unit:10}{item.note}')
    for name, why in found.refused.items():
        print(f'{name:18}not observable: {why}')
    for note in found.notes:
        print(f'note: {note}')
    everything = argparse.Namespace(**{**vars(args), 'bags': [*args.bags, *args.lifted]})
    return write_parameters(everything, NAME, found.parameters(),
                            lambda figure: write_motor(figure, found))
