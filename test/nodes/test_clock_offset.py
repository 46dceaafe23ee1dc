# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Clock offsets: bounds by round trips, and a node on another host with a clock that is ahead."""

from __future__ import annotations

from contextlib import ExitStack
from itertools import starmap
import json
import os
from pathlib import Path
import shutil
import struct
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from smart_tire.findings import Level
from smart_tire.nodes.clock_offset import clock_finding, clock_findings, merged, offset_bounds
from support.graph import node_arguments
from support.waiting import wait_for

pytestmark = pytest.mark.processes

SKEW = Path(__file__).parents[1] / 'support' / 'clock_skew.c'  # LD_PRELOAD of a process
SKEW_NS = 50_000_000
MS = 1_000_000  # ns


def test_bounds_are_those_of_all_round_trips():
    """The other clock is 3 ms ahead: requests take 1 or 4 ms, responses 2 or 0.5 ms."""
    trips = [(0, 4 * MS, 3 * MS), (10 * MS, 17 * MS, round(14.5 * MS))]
    assert offset_bounds(trips) == pytest.approx((0.0025, 0.004))
    assert offset_bounds([]) is None


@pytest.mark.parametrize(('low', 'high', 'level'), [
    (-0.0003, 0.0004, Level.OK), (-0.0004, 0.0011, Level.INFO), (-0.0011, 0.0004, Level.INFO),
    (0.0009, 0.0011, Level.INFO), (0.0011, 0.002, Level.WARNING),
    (-0.002, -0.0011, Level.WARNING), (0.0005, 0.0004, Level.WARNING),
    (0.001, 0.002, Level.INFO), (-0.002, -0.001, Level.INFO),  # the limits
    (0.001, 0.001, Level.OK), (-0.001, -0.001, Level.OK)])
def test_only_a_clock_that_is_certainly_off_is_a_warning(low, high, level):
    assert clock_finding(['/a'], (low, high)).level is level


def test_the_text_has_both_bounds_and_what_to_do():
    assert clock_finding(['/r1/imu_driver'], (0.0498, 0.0503)).text == (
        'node /r1/imu_driver: its clock is +49.80 to +50.30 ms from that of this host (expected '
        'at most 1 ms); synchronize the clocks (chrony)')


def test_nodes_of_one_host_are_one_finding():
    found = starmap(clock_finding, merged({
        '/a': (-0.0002, 0.0003), '/b': (0.0498, 0.0503), '/c': (-0.0004, 0.0001),
        '/d': (0.0502, 0.0506), '/e': (-0.0200, -0.0198), '/f': (-0.001, 0.002),
        '/g': (0.0508, 0.0510)}))
    assert [(one.level, one.where, one.found.partition(' ms')[0]) for one in found] == [
        (Level.OK, 'nodes /c, /a', 'their clocks are -0.40 to +0.30'),
        (Level.INFO, 'node /f', 'its clock is -1.00 to +2.00'),
        (Level.WARNING, 'node /e', 'its clock is -20.00 to -19.80'),
        (Level.WARNING, 'nodes /b, /d', 'their clocks are +49.80 to +50.60'),
        (Level.WARNING, 'node /g', 'its clock is +50.80 to +51.00')]
    assert not list(merged({}))


def test_nodes_on_this_host_have_its_clock(graph):
    with graph.start('wheel_controller'):
        graph.until(lambda: 'wheel_controller' in graph.health)
        found = []
        wait_for(lambda: found, lambda: found.extend(clock_findings(
            graph.node, ['/wheel_controller', '/missing'])))
        assert [one.where for one in found] == ['node /wheel_controller']
        assert found[0].level in (Level.OK, Level.INFO)  # wide bounds on a busy host


@pytest.mark.parametrize(('delay', 'count'), [
    (0.49, 20), (0.51, 1)])
def test_a_response_is_awaited_for_a_limited_time(monkeypatch, delay, count):
    now, asked = [100.0], []

    def pause(seconds):
        now[0] += seconds

    def request(_):
        asked.append(now[0])
        return len(asked)

    def response(_):  # an old one comes first
        number = len(asked) if now[0] >= asked[-1] + delay else len(asked) - 1
        info = SimpleNamespace(request_id=SimpleNamespace(sequence_number=number),
                               source_timestamp=round(now[0] * 1e9))
        return info, None

    handle = SimpleNamespace(send_request=request, take_response=response)
    client = SimpleNamespace(wait_for_service=lambda _: True, handle=handle)
    node = SimpleNamespace(create_client=lambda *_: client, destroy_client=lambda _: None)
    monkeypatch.setattr(time, 'monotonic', lambda: now[0])
    monkeypatch.setattr(time, 'time_ns', lambda: round(now[0] * 1e9))
    monkeypatch.setattr(time, 'sleep', pause)
    assert len(list(clock_findings(node, ['/a']))) == (count == 20)
    assert len(asked) == count
    assert now[0] - asked[-1] == pytest.approx(min(delay, 0.5), abs=0.0002)


class Hosts:
    """Context manager of two network namespaces with a link between them."""

    def __init__(self):
        self.names = [f'st{os.getpid()}{side}' for side in 'ab']

    def __enter__(self):
        with ExitStack() as stack:
            for name in self.names:
                ip('netns', 'add', name)
                stack.callback(ip, 'netns', 'del', name)
            ip('link', 'add', self.names[0], 'type', 'veth', 'peer', 'name', self.names[1])
            for number, name in enumerate(self.names, start=1):
                ip('link', 'set', name, 'netns', name)
                ip('-n', name, 'addr', 'add', f'10.213.0.{number}/24', 'dev', name)
                for link in (name, 'lo'):
                    ip('-n', name, 'link', 'set', link, 'up')
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_):
        self._stack.close()

    def words(self, number):
        """Return the start of a command line on one of the hosts."""
        return ['ip', 'netns', 'exec', self.names[number]]


def ip(*words):
    subprocess.run(['ip', *words], check=True, capture_output=True, text=True)


@pytest.fixture
def hosts():
    """Return two hosts; skip where network namespaces are not permitted."""
    if shutil.which('ip') is None:
        pytest.skip('needs iproute2')
    try:
        with Hosts() as found:
            yield found
    except subprocess.CalledProcessError as error:
        pytest.skip(f'needs network namespaces: {error.stderr.strip()}')


@pytest.mark.long  # real hosts; the bounds of each case are above
def test_a_host_with_another_clock_is_found(hosts, tmp_path, isolated_ros):
    compiler, library = shutil.which('cc'), tmp_path / 'clock_skew.so'
    if compiler is None:
        pytest.skip('needs a C compiler')
    subprocess.run([compiler, '-shared', '-fPIC', '-o', library, SKEW], check=True)
    skew = tmp_path / 'skew'
    skew.write_bytes(struct.pack('q', SKEW_NS))
    environment = {**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
    with (tmp_path / 'log').open('wb') as log, subprocess.Popen(
            [*hosts.words(1), sys.executable, *node_arguments('wheel_controller')],
            env={**environment, 'LD_PRELOAD': str(library), 'CLOCK_SKEW_FILE': str(skew)},
            stdout=log, stderr=log) as node:
        try:
            found = []

            def look():
                result = subprocess.run(
                    [*hosts.words(0), sys.executable, '-m', 'smart_tire.cli.main', 'doctor',
                     '--json', '--no-ports', '--seconds', '1'], env=environment,
                    stdout=subprocess.PIPE, text=True)
                found[:] = [one for one in json.loads(result.stdout)['findings']
                            if 'its clock is' in one['found']]
                return found

            wait_for(look)
        finally:
            node.terminate()
    (finding,) = found
    assert (finding['where'], finding['level']) == ('node /wheel_controller', 'warning')
    low, high = (float(word) for word in finding['found'].split()[3:6:2])
    assert low < SKEW_NS / MS < high
