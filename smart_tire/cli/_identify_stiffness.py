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

"""``smart_tire identify stiffness``: C_x from straight acceleration and braking."""

from __future__ import annotations

import argparse

from smart_tire.cli._options import add_recordings, bag_settings, check_output, write_parameters

NAME = 'stiffness'
HELP = 'longitudinal tire stiffness C_x, from acceleration and braking on straight segments'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this kind."""
    add_recordings(parser, reference=False)


def run(args: argparse.Namespace) -> int:
    """Identify, print the result, and write parameters and figure."""
    check_output(args, NAME)
    from smart_tire.analysis.calibrate_robot import TimeRange
    from smart_tire.analysis.calibrate_tire import identify_stiffness, stiffness_parameters
    from smart_tire.analysis.calibration_figures import write_stiffness
    settings = bag_settings(args.bags, args)
    robot = settings.params.robot
    found = identify_stiffness(args.bags, robot, TimeRange(args.since, args.until),
                               settings.names)
    for name, value, unit, note in (
            ('stiffness', found.stiffness, 'N',
             f'C_x, proportional to the given mass of {robot.mass:g} kg'),
            ('rolling drag', found.drag, 'N', 'of all wheels, not written'),
            ('friction', found.friction, '-', 'from the curvature over slip, not written'),
            ('latency', found.latency_error, 's', 'in addition to encoder.latency, not written')):
        print(f'{name:14}{value.value:10.5g} ± {value.sigma:<8.2g} {unit:3}{note}')
    print(f'{found.segments} straight segments, {found.duration:.1f} s in total; residuals '
          f'{found.excess ** 0.5:.2g} times the expected noise')
    return write_parameters(args, NAME, stiffness_parameters(found),
                            lambda figure: write_stiffness(figure, found))
