"""Which states of a port get a line in the log, and when."""

from __future__ import annotations

import pytest

from smart_tire.nodes.driver import PORT_GRACE_NS, PortLog

pytestmark = pytest.mark.processes


class Lines:
    """A logger and a clock: what was logged, and the time [ns]."""

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


def test_a_port_that_appears_soon_after_its_driver_is_no_error(log, lines):
    log.trouble('absent')
    lines.now_ns = PORT_GRACE_NS - 1
    log.look()
    log.opened('open')
    lines.now_ns = 2 * PORT_GRACE_NS
    log.look()
    assert lines.logged == ['info: open']


def test_a_problem_that_lasts_gets_one_line(log, lines):
    log.trouble('absent')
    for lines.now_ns in (PORT_GRACE_NS, PORT_GRACE_NS + 1):
        log.look()
    assert lines.logged == ['error: absent']
    log.trouble('busy')
    log.look()
    assert lines.logged == ['error: absent', 'error: busy']


def test_a_driver_that_ends_together_with_its_device_logs_nothing(log, lines):
    log.opened('open')
    log.trouble('lost')
    lines.now_ns = PORT_GRACE_NS - 1
    log.look()
    assert lines.logged == ['info: open']


def test_a_short_loss_is_logged_when_the_port_is_open_again(log, lines):
    log.opened('open')
    log.trouble('lost')
    log.trouble('absent')
    log.opened('open')
    assert lines.logged == ['info: open', 'error: lost', 'error: absent', 'info: open']
    lines.now_ns = 2 * PORT_GRACE_NS
    log.look()
    assert len(lines.logged) == 4


def test_the_grace_is_counted_from_the_beginning_of_each_trouble(log, lines):
    log.trouble('absent')
    log.opened('open')
    lines.now_ns = PORT_GRACE_NS
    log.trouble('lost')
    log.look()
    assert lines.logged == ['info: open']
    lines.now_ns = 2 * PORT_GRACE_NS
    log.trouble('absent')
    log.look()
    assert lines.logged == ['info: open', 'error: lost', 'error: absent']
