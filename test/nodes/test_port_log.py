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

from smart_tire.nodes.diagnostics import PORT_GRACE_NS, PortLog


class Lines:
    """Logger and clock of a test: logged lines and the time [ns]."""

    def __init__(self):
        self.logged, self.now_ns = [], 0

    def error(self, text):
        self.logged.append(f'error: {text}')

    def info(self, text):
        self.logged.append(f'info: {text}')


@pytest.fixture
def lines():
    return Lines()


@pytest.fixture
def log(lines):
    return PortLog(lines, lambda: lines.now_ns)


def test_a_port_that_appears_soon_after_the_driver_starts_is_not_logged_as_an_error(log, lines):
    log.add_problem('absent')
    lines.now_ns = PORT_GRACE_NS - 1
    log.check()
    log.opened('open')
    lines.now_ns = 2 * PORT_GRACE_NS
    log.check()
    assert lines.logged == ['info: open']


def test_a_lasting_problem_is_logged_once(log, lines):
    log.add_problem('absent')
    for lines.now_ns in (PORT_GRACE_NS, PORT_GRACE_NS + 1):
        log.check()
    assert lines.logged == ['error: absent']
    log.add_problem('busy')
    log.check()
    assert lines.logged == ['error: absent', 'error: busy']


def test_a_driver_that_ends_together_with_its_device_logs_no_error(log, lines):
    log.opened('open')
    log.add_problem('lost')
    lines.now_ns = PORT_GRACE_NS - 1
    log.check()
    assert lines.logged == ['info: open']


def test_a_short_interruption_is_logged_when_the_port_is_open_again(log, lines):
    log.opened('open')
    log.add_problem('lost')
    log.add_problem('absent')
    log.opened('open')
    assert lines.logged == ['info: open', 'error: lost', 'error: absent', 'info: open']
    lines.now_ns = 2 * PORT_GRACE_NS
    log.check()
    assert len(lines.logged) == 4


def test_the_grace_period_starts_with_each_problem(log, lines):
    log.add_problem('absent')
    log.opened('open')
    lines.now_ns = PORT_GRACE_NS
    log.add_problem('lost')
    log.check()
    assert lines.logged == ['info: open']
    lines.now_ns = 2 * PORT_GRACE_NS
    log.add_problem('absent')
    log.check()
    assert lines.logged == ['info: open', 'error: lost', 'error: absent']
