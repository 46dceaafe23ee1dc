# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Live part of ``smart_tire doctor``: host, nodes and topics, ports."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
import os
from pathlib import Path
import shutil
import tempfile
import time
from typing import Any, TYPE_CHECKING

from smart_tire.drivers.clock import SYSTEM
from smart_tire.estimation.streams import INPUTS
from smart_tire.findings import Finding, Level
from smart_tire.host_load import host_load, HostLoad, other_problems, SHARE, worst_of
from smart_tire.messages import find_topic
from smart_tire.recording import Faults, SampleArrays

if TYPE_CHECKING:
    from smart_tire.bags import SampleDecoder
    from smart_tire.messages import NodeStatus

SIMULATOR = 'robot_simulator'
DISCOVERY_TIME = 2.0  # s before messages are counted, to subscribe to what is published
MAX_DISCOVERY_TIME = 20.0  # s more on a late host
SPIN_TIME = 0.2       # s between two looks at what was received
STATUS_LEVELS = (Level.OK, Level.WARNING, Level.ERROR, Level.ERROR)  # of DiagnosticStatus
PERIOD, DURATION = 0.005, 1.0     # s, of the sleeps that are measured
MAX_TYPICAL_LATENESS = 0.010      # s, 99 % of them; reorder_window of the estimators is 0.03
MAX_LATENESS = 0.050              # s; a poll of the motor boards at 16 Hz is then skipped
MAX_LOAD = 0.8                    # processes per core that want to run, over one minute
TEST_SIZE = 8 << 20               # bytes written to measure the disk
NOMINAL_RATE = 0.3e6              # bytes/s of a recording with two instrumented wheels
SPEED_RESERVE = 5.0               # speed of the disk over the rate of a recording
MIN_RECORDING_TIME = 3600.0       # s that must fit on the disk

Progress = Callable[[str], None]


@dataclass
class Listened:
    """Samples of a robot, and what is wrong with its messages."""

    samples: SampleArrays = field(default_factory=SampleArrays)
    faults: Faults = field(default_factory=Faults)
    readers: dict[str, SampleDecoder] = field(default_factory=dict)  # by topic

    def on_message(self, topic: str, receive_ns: int, data: bytes) -> None:
        """Add a message of a standard topic."""
        from smart_tire.bags import SampleDecoder
        if topic not in self.readers:
            self.readers[topic] = SampleDecoder(topic, self.faults)
        for sample in self.readers[topic](data):
            self.samples.add_sample(sample, receive_ns)


@dataclass
class Heard:
    """What a few seconds of listening gave."""

    nodes: list[str] = field(default_factory=list)
    statuses: dict[str, NodeStatus] = field(default_factory=dict)
    robots: dict[str, Listened] = field(default_factory=dict)  # by namespace
    size: int = 0                                              # bytes of all messages
    own: HostLoad = HostLoad(0.0, 0.0, 0.0, 1)                 # measured by this program

    @property
    def host(self) -> HostLoad:
        """Return the greatest lateness of this program and of the nodes."""
        return worst_of([self.own.values, *(
            status.values for status in self.statuses.values())]) or self.own

    def on_message(self, name: str, data: bytes) -> None:
        """Add a message of a topic."""
        from smart_tire.checks.recording import READ
        self.size += len(data)
        topic = find_topic(name)
        if topic is None or topic.name not in READ:
            return
        namespace = name[:-len(topic.name)].rstrip('/')
        self.robots.setdefault(namespace, Listened()).on_message(
            topic.name, SYSTEM.time_ns(), data)


def live_findings(args: argparse.Namespace, files: list[Path],
                  progress: Progress) -> Iterator[Finding]:
    """Yield the findings on this robot."""
    heard = Heard()
    progress('measuring timers (1 s)')
    heard.own = host_load(timer_lateness())
    if find_spec('rclpy') is None:
        yield from host_findings(heard)
        yield Finding(Level.INFO, 'ROS', 'rclpy is not installed: nodes and topics are not '
                      'checked', action='source a ROS 2 distribution, or pip install '
                      'smart_tire[ros]')
    else:
        yield from _ros_findings(args.seconds, files, heard, progress)
    progress('measuring the disk (1 s)')
    yield from disk_findings(args.out, max(heard.size / args.seconds, NOMINAL_RATE))
    if any(name.rpartition('/')[2] == SIMULATOR for name in heard.nodes):
        yield Finding(Level.INFO, 'ports', 'the robot is simulated: serial ports are not checked')
    elif not args.no_ports:
        progress('listening to the serial ports (3 s)')
        yield from _port_findings(files)


def _ros_findings(seconds: float, files: list[Path], heard: Heard,
                  progress: Progress) -> Iterator[Finding]:
    from smart_tire.nodes.observer import discovery_finding, discovery_time, middleware_findings
    progress('two participants look for each other (up to 5 s)')
    discovered = discovery_time()
    progress(f'listening to nodes and topics ({DISCOVERY_TIME + seconds:g} s)')
    graph = list(_listen(seconds, heard))
    yield from host_findings(heard)
    yield from middleware_findings()
    yield discovery_finding(discovered, late=heard.host.late)
    yield from graph
    yield from status_findings(heard)
    yield from robot_findings(heard, files)


def status_findings(heard: Heard) -> Iterator[Finding]:
    """Yield the diagnostics of each node, without what says only that the host is late."""
    for name, status in sorted(heard.statuses.items()):
        if text := other_problems(status.message, status.values, late=heard.host.late):
            yield Finding(STATUS_LEVELS[min(status.level, len(STATUS_LEVELS) - 1)],
                          f'node {name}', text)


def _listen(seconds: float, heard: Heard) -> Iterator[Finding]:
    """Listen; yield the findings on the graph."""
    from smart_tire.nodes.clock_offset import clock_findings
    from smart_tire.nodes.compat import node_names
    from smart_tire.nodes.observer import graph_findings, Observer, read_graph
    from smart_tire.nodes.runner import NodeRunner
    name, listening, received = f'doctor_{os.getpid()}', [False], set[str]()

    def on_message(topic: str, data: bytes) -> None:
        received.add(topic)
        if listening[0]:
            heard.on_message(topic, data)

    def on_status(status: NodeStatus) -> None:
        if status.name != name:
            heard.statuses[status.name] = status

    with NodeRunner(lambda: Observer(on_message, on_status, name=name), []) as runner:
        runner.spin(DISCOVERY_TIME)
        if heard.own.late:  # so is discovery
            await_inputs(runner, received)
        listening[0] = True
        runner.spin(seconds)
        graph, heard.nodes = read_graph(runner.node), node_names(runner.node)
        clocks = list(clock_findings(runner.node, heard.nodes))
    yield from graph_findings(graph, heard.nodes)
    yield from clocks
    if heard.nodes:
        yield Finding(Level.OK, 'ROS', f'{len(heard.nodes)} nodes: {", ".join(heard.nodes)}')
    else:
        yield Finding(Level.INFO, 'ROS', 'no other node is running in this domain',
                      action='start robot.launch.py, or check ROS_DOMAIN_ID')


def await_inputs(runner: Any, received: Collection[str]) -> None:
    """Listen until each input that nodes publish was received, for a limited time."""
    end = time.monotonic() + MAX_DISCOVERY_TIME
    while time.monotonic() < end and not all(
            name in received for name, _ in runner.node.get_topic_names_and_types()
            if (topic := find_topic(name)) is not None and topic.name in INPUTS
            and runner.node.count_publishers(name)):
        runner.spin(SPIN_TIME)


def robot_findings(heard: Heard, files: list[Path]) -> Iterator[Finding]:
    """Yield the findings on the samples of each robot."""
    from smart_tire.checks import findings
    from smart_tire.checks.recording import CheckedRecording
    from smart_tire.parameters import load_robot
    robot = load_robot(files)
    for namespace, one in sorted(heard.robots.items()):
        checked = CheckedRecording(robot, one.samples, one.faults, live=True, host=heard.host)
        for finding in findings(checked):
            yield replace(finding, where=f'{namespace}: {finding.where}') if namespace else finding


def _port_findings(files: list[Path]) -> Iterator[Finding]:
    from smart_tire.drivers.port_scan import expected_ports, port_findings, ports_to_scan
    from smart_tire.drivers.port_scan import scan, serial_devices
    from smart_tire.parameters import load_node
    from smart_tire.parameters.files import read_blocks
    names = ['tire_receiver', 'imu_driver', 'motor_driver']
    if any(block.endswith('film_driver') for file in files for block, _ in read_blocks(file)):
        names.append('film_driver')  # a robot may be without film
    expected = expected_ports(*(load_node(files, name) for name in names))
    devices = serial_devices()
    rates, boards = ports_to_scan(expected, devices)
    yield from port_findings(expected, devices, scan(rates, boards))


def host_findings(heard: Heard) -> Iterator[Finding]:
    """Yield one finding on a late host, else those on its timers and on its load."""
    if heard.host.late:
        yield Finding(Level.WARNING, 'host', str(heard.host))
        return
    yield lateness_finding(heard.own)
    yield load_finding(heard.own.load, heard.own.cores)


def timer_lateness(sleep: Callable[[float], None] = time.sleep,
                   clock: Callable[[], float] = time.monotonic) -> list[float]:
    """Return how late [s] each of the sleeps ended, sorted."""
    late = []
    for _ in range(round(DURATION / PERIOD)):
        due = clock() + PERIOD
        sleep(PERIOD)
        late.append(clock() - due)
    return sorted(late)


def bounded(where: str, found: str, inside: bool, expected: str, action: str) -> Finding:
    """Return the finding on a quantity: OK inside of its bound, else a warning."""
    return (Finding(Level.OK, where, found) if inside
            else Finding(Level.WARNING, where, found, expected, action))


def lateness_finding(host: HostLoad) -> Finding:
    """Return the finding on the lateness of timers."""
    return bounded(
        'host', f'timers are late by {1e3 * host.typical:.1f} ms ({SHARE:.0%}), '
        f'{1e3 * host.longest:.1f} ms at worst',
        host.typical <= MAX_TYPICAL_LATENESS and host.longest <= MAX_LATENESS,
        f'{1e3 * MAX_TYPICAL_LATENESS:g} and {1e3 * MAX_LATENESS:g} ms',
        'end other programs, or use a faster host')


def load_finding(load: float, cores: int) -> Finding:
    """Return the finding on the load average of one minute."""
    return bounded('host', f'load {load:.2f} on {cores} cores', load <= MAX_LOAD * cores,
                   f'at most {MAX_LOAD * cores:.2g}', 'end other programs')


def disk_findings(folder: Path, rate: float) -> Iterator[Finding]:
    """Yield free space and speed of the disk of ``folder``, against ``rate`` [bytes/s]."""
    try:
        free, speed = shutil.disk_usage(folder).free, write_speed(folder)
    except OSError as error:
        yield Finding(Level.ERROR, f'disk of {folder}', f'cannot be written ({error.strerror})',
                      'a writable folder', 'choose another --out')
        return
    yield disk_finding(f'disk of {folder}', free, speed, rate)


def disk_finding(where: str, free: float, speed: float, rate: float) -> Finding:
    """Return the finding on ``free`` bytes and ``speed`` [bytes/s]."""
    hours = free / rate / 3600.0
    found = (f'{free / 1e9:.1f} GB free, {hours:.1f} h of recording at {rate / 1e6:.2f} MB/s; '
             f'writes {speed / 1e6:.0f} MB/s')
    if free < MIN_RECORDING_TIME * rate:
        return Finding(Level.WARNING, where, found, 'at least 1 h', 'delete old recordings')
    return bounded(where, found, speed >= SPEED_RESERVE * rate,
                   f'at least {SPEED_RESERVE * rate / 1e6:.1f} MB/s', 'record to a faster disk')


def write_speed(folder: Path) -> float:
    """Return the speed [bytes/s] at which a file reaches the disk."""
    block = os.urandom(1 << 20)
    with tempfile.TemporaryFile(dir=folder) as file:
        start = time.monotonic()
        for _ in range(TEST_SIZE // len(block)):
            file.write(block)
        file.flush()
        os.fsync(file.fileno())
        return TEST_SIZE / max(time.monotonic() - start, 1e-6)
