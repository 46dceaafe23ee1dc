"""The robot's processes: started together, watched, and ended together by their ids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import ctypes
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
import time
from types import TracebackType

DRIVERS = ('tire_receiver', 'imu_driver', 'motor_driver')
ESTIMATORS = ('slip_estimator', 'friction_estimator')
NODES = ('robot_simulator', *ESTIMATORS, 'wheel_controller', *DRIVERS)
PATIENCE = 10.0          # s for a process to end by itself before it is killed
PR_SET_PDEATHSIG = 1     # prctl(2): a child ends when its parent is gone, even if it was killed


def isolated_environment() -> dict[str, str]:
    """Return an environment in which DDS stays on this machine, in a domain of its own."""
    domain = str(random.SystemRandom().randint(1, 101))  # above, ports meet ephemeral ones
    return {**os.environ, 'ROS_DOMAIN_ID': os.environ.get('SMART_TIRE_DOMAIN_ID', domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'PYTHONUNBUFFERED': '1'}


def _end_with_parent() -> None:
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


class Stack:
    """
    Processes of this package, each with its log in ``folder``; a context that ends them all.

    Children have a session of their own: Ctrl-C reaches this process alone, which then ends
    them in order.
    """

    def __init__(self, folder: Path, environment: Mapping[str, str]) -> None:
        self._folder = folder
        self._environment = dict(environment)
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self._cpu: dict[str, float] = {}
        folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> Stack:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.stop()

    def node(self, name: str, params: Sequence[Path] = (), *arguments: str) -> None:
        """Start a node with parameter files; ``arguments`` are further ROS arguments."""
        files = [part for path in params for part in ('--params-file', str(path))]
        self.start(name, f'smart_tire.nodes.{name}', '--ros-args', *files, *arguments)

    def start(self, name: str, module: str, *arguments: str) -> None:
        """Start ``python -m module`` under ``name``."""
        with (self._folder / f'{name}.log').open('wb') as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, '-m', module, *arguments], env=self._environment,
                stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                start_new_session=True, preexec_fn=_end_with_parent)

    def log(self, name: str) -> str:
        """Return what the process has said."""
        return (self._folder / f'{name}.log').read_text(encoding='utf-8', errors='replace')

    def tail(self, name: str, count: int = 12) -> str:
        """Return the last lines that the process has said."""
        return '\n'.join(self.log(name).splitlines()[-count:])

    def died(self) -> dict[str, int]:
        """Return name -> exit status of every process that has ended by itself."""
        return {name: process.returncode for name, process in self.processes.items()
                if process.poll() is not None}

    def cpu_seconds(self) -> dict[str, float]:
        """Return the CPU time that each living process has used so far, user and system."""
        for name, process in self.processes.items():
            try:
                fields = Path(f'/proc/{process.pid}/stat').read_text().rsplit(')', 1)[1].split()
            except (FileNotFoundError, IndexError):
                continue  # has ended: what was last seen stays
            self._cpu[name] = (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
        return dict(self._cpu)

    def stop(self, *names: str) -> dict[str, int]:
        """End the named processes, all by default; return name -> exit status."""
        chosen = {name: self.processes[name] for name in names or tuple(self.processes)}
        for process in chosen.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + PATIENCE
        for process in chosen.values():
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        return {name: process.returncode for name, process in chosen.items()}
