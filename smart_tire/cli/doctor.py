# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire doctor``: check a recording, or ports, host and nodes of a running robot."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
import json
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from smart_tire.cli._progress import ProgressLine
from smart_tire.errors import ParameterError
from smart_tire.findings import counted, Finding, Level, worst

if TYPE_CHECKING:
    from smart_tire.bags import Bag

STYLES = {Level.OK: 'green', Level.INFO: 'cyan', Level.WARNING: 'yellow', Level.ERROR: 'bold red'}


def run(args: argparse.Namespace) -> int:
    """Print the findings; return the exit status."""
    console = Console()
    with ProgressLine(timer=False) as progress:
        if args.json:
            found = list(_findings(args, progress))
            print(to_json(found))
        else:
            found = print_findings(_findings(args, progress), console)
            print_summary(found, console)
    return status_of(found)


def _findings(args: argparse.Namespace, progress: ProgressLine) -> Iterator[Finding]:
    files, unreadable = _valid_files(args.params)
    yield from unreadable
    if args.bag is None:
        from smart_tire.cli._live_checks import live_findings
        yield from live_findings(args, files, progress.show)
    else:
        from smart_tire.bags import Bag, TopicNames
        with Bag(args.bag, TopicNames.parse(args.remap)) as bag:
            yield from _with_parameters(bag, files, progress)


def _with_parameters(bag: Bag, files: Sequence[Path],
                     progress: ProgressLine) -> Iterator[Finding]:
    """Yield the findings on a bag with the parameters in ``files``, or with its own."""
    from smart_tire.analysis.pipeline import bag_params
    from smart_tire.checks import findings
    from smart_tire.checks.recording import read
    from smart_tire.parameters import RobotParams
    try:
        used = bag_params(bag, files)
    except ParameterError as error:
        yield Finding(Level.ERROR, 'parameters', str(error), action='defaults are used')
        robot, given = RobotParams(), False
    else:
        yield Finding(Level.INFO, 'parameters', used.origin)
        if used.unknown:
            yield Finding(Level.WARNING, 'parameters', f'unknown to this version: '
                          f'{", ".join(used.unknown)}', action='these are ignored')
        robot, given = used.params.robot, used.radius_given
    bag.joints = robot.joints
    recording = read(bag, robot, lambda share: progress.show(f'reading {bag.path}: {share:.0%}'),
                     radius_given=given)
    yield from findings(recording)
    for note in bag.notes:
        where, _, text = note.partition(': ')
        yield Finding(Level.INFO, where, text)


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


def print_findings(findings: Iterable[Finding], console: Console) -> list[Finding]:
    """Print each finding as soon as it is found; return all."""
    printed = []
    for finding in findings:
        line = Text(f'{finding.level.name.lower():8}', style=STYLES[finding.level])
        line.append(finding.text, style='default')
        console.print(line, soft_wrap=True)
        printed.append(finding)
    return printed


def print_summary(findings: list[Finding], console: Console) -> None:
    """Print the number of errors and warnings."""
    console.print(', '.join(
        counted(sum(one.level is level for one in findings), level.name.lower())
        for level in (Level.ERROR, Level.WARNING)), highlight=False)


def to_json(findings: Iterable[Finding]) -> str:
    """Return the findings as a JSON document."""
    found = list(findings)
    return json.dumps({'level': worst(found).name.lower(),
                       'findings': [one.tree for one in found]}, indent=2)


def status_of(findings: Iterable[Finding]) -> int:
    """Return the exit status: warnings are no errors."""
    return int(worst(findings) is Level.ERROR)
