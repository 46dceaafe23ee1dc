# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Log of a port: which states are logged, and when."""

from __future__ import annotations

import pytest

from smart_tire.nodes.diagnostics import PortLog
from support.virtual_node import Log

pytestmark = pytest.mark.processes

GRACE = 2_000_000_000  # ns


@pytest.mark.parametrize(('steps', 'lines'), [
    (('absent', GRACE - 1, 'open', 2 * GRACE), ['open']),
    (('absent', GRACE - 1), []),
    (('absent', GRACE, 1, 'busy', 0, GRACE), ['error: absent', 'error: busy']),
    (('open', 'lost', GRACE - 1), ['open']),
    (('open', 'lost', 'absent', 'open', 2 * GRACE),
     ['open', 'error: lost', 'error: absent', 'open']),
    (('absent', 'open', GRACE, 'lost', GRACE - 1), ['open']),
    (('absent', 'open', GRACE, 'lost', GRACE, 'absent', 0),
     ['open', 'error: lost', 'error: absent'])],
    ids=['a port that appears soon after the driver starts', 'or does not appear in time',
         'a lasting problem once, and what follows it',
         'a driver that ends together with its device', 'a short interruption, when it is over',
         'the grace period starts with each problem', 'and ends'])
def test_a_problem_is_logged_if_it_lasts_or_interrupts(steps, lines):
    """Steps are the states of the port, and times that pass [ns] until a check."""
    now_ns = 0
    logger = Log(lambda: now_ns)
    log = PortLog(logger, lambda: now_ns)
    for step in steps:
        if isinstance(step, int):
            now_ns += step
            log.check()
        elif step == 'open':
            log.opened(step)
        else:
            log.add_problem(step)
    assert logger.lines == lines
