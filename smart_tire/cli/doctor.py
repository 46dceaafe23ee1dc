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

"""``smart_tire doctor``: check a recording, or ports, host and nodes of a running robot."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
import sys
import time
from typing import TYPE_CHECKING

from smart_tire.cli._arguments import positive
from smart_tire.cli._bags import add_bag_options
from smart_tire.cli._findings import print_findings, print_summary, status_of, to_json
from smart_tire.errors import ParameterError
from smart_tire.findings import Finding, Level

if TYPE_CHECKING:
    from smart_tire.bags import Bag
    from smart_tire.parameters import RobotParams

NAME = 'doctor'
HELP = ('check a recording, or without BAG the ports, host and nodes of this robot; exit status '
        '0 without errors (warnings allowed), 1 with errors, 2 if the bag cannot be read')
PROGRESS_PERIOD = 2.0  # s between two lines while a bag is read


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument('bag', type=Path, nargs='?', metavar='BAG',
                        help='rosbag2 directory or a single bag file (default: check this robot)')
    add_bag_options(parser)
    parser.add_argument('--json', action='store_true', help='print JSON')
    parser.add_argument('--seconds', type=positive, default=3.0, metavar='S',
                        help='how long to listen to the topics (default: 3)')
    parser.add_argument('--out', type=Path, default=Path(), metavar='DIR',
                        help='folder of recordings, whose disk is checked (default: .)')
    parser.add_argument('--no-ports', action='store_true', help='do not open serial ports')


def run(args: argparse.Namespace) -> int:
    """Print the findings; return the exit status."""
    from rich.console import Console
    console = Console()
    if args.json:
        found = list(_findings(args))
        print(to_json(found))
    else:
        found = print_findings(_findings(args), console)
        print_summary(found, console)
    return status_of(found)


def _findings(args: argparse.Namespace) -> Iterator[Finding]:
    files, unreadable = _valid_files(args.params)
    yield from unreadable
    if args.bag is None:
        from smart_tire.cli._live_checks import live_findings
        yield from live_findings(args, files, progress)
    else:
        from smart_tire.bags import Bag, TopicNames
        with Bag(args.bag, TopicNames.parse(args.remap)) as bag:
            yield from _with_parameters(bag, files)


def _with_parameters(bag: Bag, files: Sequence[Path]) -> Iterator[Finding]:
    """Yield the findings on a bag with the parameters in ``files``, or with its own."""
    from smart_tire.analysis.bag_params import bag_params
    from smart_tire.parameters import RobotParams
    try:
        used = bag_params(bag, files)
    except ParameterError as error:
        yield Finding(Level.ERROR, 'parameters', str(error), action='defaults are used')
        robot = RobotParams()
    else:
        yield Finding(Level.INFO, 'parameters', used.origin)
        if used.unknown:
            yield Finding(Level.WARNING, 'parameters', f'unknown to this version: '
                          f'{", ".join(used.unknown)}', action='these are ignored')
        robot = used.params.robot
    bag.joints = robot.joints
    yield from bag_findings(bag, robot)
    for note in bag.notes:
        where, _, text = note.partition(': ')
        yield Finding(Level.INFO, where, text)


def bag_findings(bag: Bag, robot: RobotParams) -> Iterator[Finding]:
    """Yield the findings on a bag."""
    from smart_tire.analysis.checks.catalog import findings
    from smart_tire.analysis.checks.recording import read
    latest = [time.monotonic()]

    def show(share: float) -> None:
        if time.monotonic() - latest[0] >= PROGRESS_PERIOD:
            latest[0] = time.monotonic()
            progress(f'reading {bag.path}: {share:.0%}')

    yield from findings(read(bag, robot, show))


def progress(text: str) -> None:
    """Print what is being done, to standard error: the findings go to standard output."""
    print(f'... {text}', file=sys.stderr, flush=True)


def _valid_files(files: list[Path]) -> tuple[list[Path], list[Finding]]:
    """Return the valid parameter files, and a finding on each other one."""
    from smart_tire.parameters import load_robot
    valid: list[Path] = []
    findings = []
    for file in files:
        try:
            load_robot([*valid, file])
        except ParameterError as error:
            findings.append(Finding(
                Level.ERROR, 'parameters', str(error), action='this file is not used'))
        else:
            valid.append(file)
    return valid, findings
