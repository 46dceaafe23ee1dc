# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The nodes of the package as processes: parameters, start, supervision, shutdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
import ctypes
import os
from pathlib import Path
import random
import signal
import socket
import subprocess
import sys
import time
from typing import Any

from smart_tire.cli._outputs import remove
from smart_tire.errors import SmartTireError
from smart_tire.launching import CAMERA
import yaml

DRIVERS = ('tire_receiver', 'imu_driver', 'motor_driver')
ESTIMATORS = ('slip_estimator', 'friction_estimator')
CONTROLLERS = ('wheel_controller', 'trajectory_controller')
NODES = ('robot_simulator', *ESTIMATORS, *CONTROLLERS, *DRIVERS)
SHUTDOWN_TIMEOUT = 30.0  # s from SIGINT to SIGKILL, on a busy machine
PR_SET_PDEATHSIG = 1     # prctl(2): signal to a child when its parent ends, even if killed
UNITS = ('0013A20040A1B2C2=front_left', '0013A20040A1B2C3=front_right')
RADIO_LATENCY = 0.005     # s, radio.delay of the simulator
START_TIMEOUT = 60.0      # s until all nodes run, on a busy machine
ODOM_TIMEOUT = 1.0        # s, more than slip_estimator awaits a ground_state that is refused
SPIN_TIME = 0.25          # s between two looks at the processes
PORTS = ('tire_radio', 'imu', 'motors')
CLOCK = 'clock'           # file of the simulated time, in the folder of the ports
DOMAINS = range(1, 102)   # 0 is the default of others; higher ids overlap ephemeral ports
FIRST_PORT, PORTS_PER_DOMAIN = 7410, 250  # UDP, of discovery; RTPS specification 9.6.1.1
RECORDER, VIEWER = 'recorder', 'viewer'  # names of their processes
ANNOUNCED = 'viewer: '  # start of the line that "view" prints when the viewer runs


class RobotError(SmartTireError):
    """The robot, or a process that belongs to it, has failed; the text has the reason."""


def isolated_environment() -> dict[str, str]:
    """
    Return an environment that restricts DDS to this machine.

    Its domain is that of ``ROS_DOMAIN_ID`` if it is set, otherwise one that nobody here uses.
    """
    return {**os.environ, 'ROS_DOMAIN_ID': os.environ.get('ROS_DOMAIN_ID') or str(free_domain()),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'PYTHONUNBUFFERED': '1'}


def free_domain() -> int:
    """Return a random domain whose first participant on this machine does not exist."""
    domains = list(DOMAINS)
    random.SystemRandom().shuffle(domains)
    for domain in domains:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(('', FIRST_PORT + PORTS_PER_DOMAIN * domain))
            except OSError:
                continue
            return domain
    raise RobotError(f'all of the {len(domains)} ROS domains are in use: set ROS_DOMAIN_ID')


def end_with_parent() -> None:
    """Make the calling process end with its parent; for ``preexec_fn`` of a child."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def params_arguments(files: Iterable[Path]) -> list[str]:
    """Return the ROS arguments for parameter files."""
    return ['--ros-args', *(word for file in files for word in ('--params-file', str(file)))]


class Stack:
    """
    Processes of this package with log files in ``folder``; the context stops all of them.

    With None they share the output of this process.

    Child processes have their own session: Ctrl-C reaches this process only, which then stops
    the children in order.
    """

    def __init__(self, folder: Path | None, environment: Mapping[str, str]) -> None:
        self._folder = folder
        self._environment = dict(environment)
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> Stack:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def node(self, name: str, params: Sequence[Path] = (), *arguments: str) -> None:
        """Start a node with parameter files and additional ROS ``arguments``."""
        self.start(name, f'smart_tire.nodes.{name}', *params_arguments(params), *arguments)

    def start(self, name: str, module: str, *arguments: str) -> None:
        """Start ``python -m module`` under ``name``."""
        with self._log_file(name).open('wb') if self._folder else nullcontext() as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, '-m', module, *arguments], env=self._environment,
                stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                start_new_session=True, preexec_fn=end_with_parent)

    def log(self, name: str) -> str:
        """Return the output of a process."""
        return self._log_file(name).read_text(encoding='utf-8', errors='replace')

    def _log_file(self, name: str) -> Path:
        assert self._folder is not None
        return self._folder / f'{name}.log'

    def tail(self, name: str, count: int = 12) -> str:
        """Return the last lines of the output of a process."""
        return '\n'.join(self.log(name).splitlines()[-count:])

    def died(self) -> dict[str, int]:
        """Return name -> exit status of every process that has exited."""
        return {name: process.returncode for name, process in self.processes.items()
                if process.poll() is not None}

    def stop(self, *names: str) -> dict[str, int]:
        """Stop the named processes, all by default; return name -> exit status."""
        chosen = {name: self.processes[name] for name in names or tuple(self.processes)}
        for process in chosen.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + SHUTDOWN_TIMEOUT
        for process in chosen.values():
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        return {name: process.returncode for name, process in chosen.items()}

    def end(self, *names: str) -> None:
        """Stop the named processes; raise RobotError if one of them ends with an error."""
        for name, status in self.stop(*names).items():
            if status:
                raise RobotError(f'{name} ended with status {status}\n{self.tail(name)}')
            del self.processes[name]

    def start_viewer(self, *arguments: str) -> None:
        """Start the viewer in the environment of the nodes; print where it is."""
        self.start(VIEWER, 'smart_tire.cli.main', 'view', '--live', *arguments)
        deadline = time.monotonic() + START_TIMEOUT
        while not (lines := [line for line in self.log(VIEWER).splitlines()
                             if line.startswith(ANNOUNCED)]):
            if self.died() or time.monotonic() > deadline:
                raise RobotError(f'the viewer does not start\n{self.tail(VIEWER)}')
            time.sleep(SPIN_TIME)
        print(lines[0], flush=True)

    def check_alive(self) -> None:
        """Raise RobotError if a process has ended, except a viewer closed by the user."""
        for name, status in self.died().items():
            if status or name != VIEWER:
                raise RobotError(f'{name} died with status {status}\n{self.tail(name)}')

    def stop_in_order(self) -> None:
        """Stop all processes in order; raise RobotError if one of them ends with an error."""
        self.check_alive()
        # Subscribers first, then the owner of the ports; the recorder last, to record all.
        for names in ((*CAMERA, *NODES[1:]), NODES[:1], (RECORDER, VIEWER)):
            if present := [name for name in names if name in self.processes]:
                self.end(*present)


def write_parameters(out: Path, name: str, seed: int,
                     more: Mapping[str, Mapping[str, Any]]) -> Path:
    """
    Write the parameter file ``name`` with films in both front wheels; return its path.

    The ports are links in ``out``; ``more`` has additional parameters by node.
    """
    ports = (out / 'ports').resolve()
    links = {name: str(ports / name) for name in PORTS}
    nodes: dict[str, dict[str, Any]] = {
        '/**': {'film.wheels': [unit.partition('=')[2] for unit in UNITS]},
        'robot_simulator': {'seed': seed, 'units': list(UNITS),
                            **{f'ports.{name}': link for name, link in links.items()}},
        'tire_receiver': {'port': links['tire_radio'], 'units': list(UNITS),
                          'radio_latency': RADIO_LATENCY},
        'imu_driver': {'port': links['imu']},
        'motor_driver': {'port': links['motors']},
        'trajectory_controller': {'checks.odom_timeout': ODOM_TIMEOUT}}
    for node, values in more.items():
        nodes.setdefault(node, {}).update(values)
    out.mkdir(parents=True, exist_ok=True)
    file = out / name
    file.write_text(yaml.safe_dump({node: {'ros__parameters': values}
                                    for node, values in nodes.items()}), encoding='utf-8')
    return file


def remove_traces(out: Path) -> None:
    """Delete the logs and links to ports of an earlier run."""
    remove(out / 'logs', [f'{name}.log' for name in (*NODES, *CAMERA, RECORDER, VIEWER)])
    remove(out / 'ports', (*PORTS, CLOCK))
