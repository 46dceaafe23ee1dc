# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Findings of the checks of recordings, ports, host and nodes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from enum import IntEnum


class Level(IntEnum):
    """How serious a finding is."""

    OK = 0
    INFO = 1
    WARNING = 2
    ERROR = 3


@dataclass(frozen=True)
class Finding:
    """One line of a report: what was found where, what was expected, what to do."""

    level: Level
    where: str          # topic, port, parameter or node
    found: str
    expected: str = ''  # '' if nothing else was expected
    action: str = ''    # '' if nothing has to be done

    @property
    def text(self) -> str:
        """Return the finding without its level, as one line."""
        expected = f' (expected {self.expected})' if self.expected else ''
        return f'{self.where}: {self.found}{expected}' + (
            f'; {self.action}' if self.action else '')

    @property
    def tree(self) -> dict[str, str]:
        """Return the finding for a JSON document."""
        return {**asdict(self), 'level': self.level.name.lower()}


def counted(count: int, noun: str) -> str:
    """
    Return ``count`` with its noun.

    >>> counted(1, 'gap'), counted(0, 'gap')
    ('1 gap', '0 gaps')
    """
    return f'{count} {noun}{"" if count == 1 else "s"}'


def worst(findings: Iterable[Finding]) -> Level:
    """Return the highest level of ``findings``, OK if there are none."""
    return max((finding.level for finding in findings), default=Level.OK)
