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
from itertools import chain
import json
from pathlib import Path
from typing import Any, TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from smart_tire.cli._bags import each_bag
from smart_tire.cli._progress import ProgressLine
from smart_tire.errors import ParameterError
from smart_tire.findings import counted, Finding, Level, worst

if TYPE_CHECKING:
    from smart_tire.bags import Bag

STYLES = {Level.OK: 'green', Level.INFO: 'cyan', Level.WARNING: 'yellow', Level.ERROR: 'bold red'}


def run(args: argparse.Namespace) -> int:
    """Print the findings; return the exit status."""
    if args.bags:
        status, found = each_bag(args, args.bags, list(map(str, args.bags)), check_one)
        if args.json and found:
            trees = {bag: tree(one) for bag, one in found.items()}
            print(json.dumps(trees if len(args.bags) > 1 else trees.popitem()[1], indent=2))
        return status
    files, unreadable = _valid_files(args.params)
    with ProgressLine(timer=False) as progress:
        from smart_tire.cli._live_checks import live_findings
        live = print_or_collect(args, chain(unreadable, live_findings(args, files, progress.show)))
    if args.json:
        print(json.dumps(tree(live), indent=2))
    return status_of(live)


def check_one(path: Path, name: str, args: argparse.Namespace, _: str | None
              ) -> tuple[int, list[Finding]]:
    """Print the findings in one bag, unless all are printed as JSON; return the exit status."""
    from smart_tire.bags import Bag, TopicNames
    if len(args.bags) > 1 and not args.json:
        print(f'{name}:')
    files, unreadable = _valid_files(args.params)
    with ProgressLine(timer=False) as progress, Bag(path, TopicNames.parse(args.remap)) as bag:
        found = print_or_collect(args, chain(unreadable, _with_parameters(bag, files, progress)))
    return status_of(found), found


def print_or_collect(args: argparse.Namespace, findings: Iterable[Finding]) -> list[Finding]:
    """Return all findings, printed as soon as they are found if not as JSON."""
    if args.json:
        return list(findings)
    console = Console()
    found = print_findings(findings, console)
    print_summary(found, console)
    return found


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


def tree(findings: Sequence[Finding]) -> dict[str, Any]:
    """Return the findings in a bag for a JSON document."""
    return {'level': worst(findings).name.lower(), 'findings': [one.tree for one in findings]}


def status_of(findings: Iterable[Finding]) -> int:
    """Return the exit status: warnings are no errors."""
    return int(worst(findings) is Level.ERROR)
