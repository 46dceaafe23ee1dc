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

"""``smart_tire identify icr``: x coordinate S of the ICR from bags."""

from __future__ import annotations

import argparse

from smart_tire.cli._options import add_recordings, bag_settings, check_output, write_parameters

NAME = 'icr'
HELP = 'x coordinate S of the instantaneous center of rotation, by the curve fit of paper B'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this kind."""
    add_recordings(parser)


def run(args: argparse.Namespace) -> int:
    """Fit S, print it, and write parameters and figure; EstimatorError if not observable."""
    check_output(args, NAME)
    from smart_tire.analysis.calibrate_robot import identify_icr
    from smart_tire.analysis.calibration_figures import write_icr
    from smart_tire.calibration.turning import combine
    settings = bag_settings(args.bags, args)
    robot = settings.params.robot
    fit = combine([identify_icr(
        bag, robot, since=args.since, until=args.until, reference=args.reference,
        names=settings.names) for bag in args.bags])
    for time, value, sigma in zip(fit.turn_time, fit.turn_icr, fit.turn_sigma):
        print(f'turn at {time:7.1f} s     {value:10.4f} ± {sigma:<7.2g} m')
    print(f'S                      {fit.icr.value:10.4f} ± {fit.icr.sigma:<7.2g} m  from '
          f'{fit.source}')
    print(f'spread over all turns  {fit.spread:10.4f}           m')
    return write_parameters(args, NAME, fit.parameters(robot),
                            lambda figure: write_icr(figure, fit))
