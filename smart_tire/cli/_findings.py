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

"""Findings as lines of a terminal or as JSON, and the exit status."""

from __future__ import annotations

from collections.abc import Iterable
import json

from rich.console import Console
from rich.text import Text

from smart_tire.findings import counted, Finding, Level, worst

STYLES = {Level.OK: 'green', Level.INFO: 'cyan', Level.WARNING: 'yellow', Level.ERROR: 'bold red'}
NO_ERRORS, ERRORS = 0, 1  # exit statuses


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
    rows = [{'level': one.level.name.lower(), 'where': one.where, 'found': one.found,
             'expected': one.expected, 'action': one.action} for one in found]
    return json.dumps({'level': worst(found).name.lower(), 'findings': rows}, indent=2)


def status_of(findings: Iterable[Finding]) -> int:
    """Return the exit status: warnings are no errors."""
    return ERRORS if worst(findings) is Level.ERROR else NO_ERRORS
