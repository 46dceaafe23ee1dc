# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How many tests were skipped, and why, in groups: the last lines of a run, a plugin of pytest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

import pytest

INCONCLUSIVE = 'inconclusive'  # begins the reason of a test that a busy machine left undecided


def summary(reasons: Iterable[str]) -> list[str]:
    """Return a line each for skipped and inconclusive tests; what follows a colon is left out."""
    causes = Counter(reason.removeprefix('Skipped: ').partition(':')[0] for reason in reasons)
    undecided = causes.pop(INCONCLUSIVE, 0)
    lines = []
    if causes:
        groups = ', '.join(
            f'{count} {cause.replace("needs ", "need ", 1) if count > 1 else cause}'
            for cause, count in causes.most_common())
        lines.append(f'{causes.total()} skipped: {groups}')
    if undecided:
        lines.append(f'{undecided} {INCONCLUSIVE}: the machine was too busy to prove a bound')
    return lines


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> Iterator[None]:
    """Print the summary below that of pytest."""
    yield
    reporter = session.config.pluginmanager.get_plugin('terminalreporter')
    if reporter is not None:  # the workers of xdist have none
        for line in summary(report.longrepr[2] for report in reporter.stats.get('skipped', ())):
            reporter.write_line(line)
