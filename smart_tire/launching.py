"""
What the launch files do before they start a process.

The launch system is not imported: its context comes in as an argument. So the package installs
without it, and what is here is tested without it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import difflib
import math
import os
from pathlib import Path
import signal
from typing import Any

from smart_tire.errors import ParameterError

# Arguments that launch itself reads, of any launch file and without a declaration.
OF_LAUNCH = ('emulate_tty', 'launch-prefix', 'launch-prefix-filter', 'sigkill_timeout',
             'sigterm_timeout')
SWITCH = {'true': True, 'false': False}

Kind = Callable[[str], Any]  # what a launch argument may be: raises ValueError if it is not


def check_arguments(context: Any, kinds: Mapping[str, Kind]) -> None:
    """
    Raise ParameterError for the first launch argument that is wrong, which ends the launch.

    ``kinds`` are all arguments of the launch file; others, which launch would ignore, are
    refused. A missing parameter file would be left out by launch_ros with a warning: the nodes
    would use defaults, and with them the real ports.
    """
    for name in _given(context):
        if name not in kinds and name not in OF_LAUNCH:
            raise ParameterError(_unknown(name, sorted(kinds)))
    for name, kind in kinds.items():
        value = context.launch_configurations[name]
        try:
            kind(value)
        except ValueError as error:
            raise ParameterError(f'{name}:={value}: {error}') from error


def text(value: str) -> str:
    """Return what may be anything."""
    return value


def switch(value: str) -> bool:
    """Return whether a switch is on; raise ValueError if it is neither true nor false."""
    if value.lower() not in SWITCH:
        raise ValueError('expected true or false')
    return SWITCH[value.lower()]


def positive(value: str) -> float:
    """Return a number; raise ValueError if it is none, or not positive and finite."""
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise ValueError('expected a positive number')
    return number


def path(value: str) -> Path:
    """Return the path of what can be read; raise ValueError if it cannot."""
    found = Path(value)
    if not found.exists():
        raise ValueError('no such file or directory')
    if not os.access(found, os.R_OK):
        raise ValueError('no permission to read it')
    return found


def file(value: str) -> Path:
    """Return the path of a file that can be read; raise ValueError if it cannot."""
    found = path(value)
    if found.is_dir():
        raise ValueError('is a directory, expected a file')
    return found


def hold_interrupts(context: Any) -> None:
    """
    Start the processes of this description with SIGINT blocked.

    A terminal sends SIGINT to the whole group. A Python that is just starting dies of it with a
    traceback; this way the signal waits until the node has handlers (see smart_tire.nodes).
    """
    if context.launch_configurations.get('launch-prefix'):
        return  # a debugger would pass the mask on to all that it starts
    loop = context.asyncio_loop
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # Launch visits the whole description first, then the loop starts the processes, one task
    # each: what is called by the first callback of this round comes after all of them.
    loop.call_soon(loop.call_soon, signal.pthread_sigmask, signal.SIG_UNBLOCK, {signal.SIGINT})


def _given(context: Any) -> list[str]:
    """
    Return the names of the arguments on the command line of ``ros2 launch``.

    A launch file that includes this one has arguments of its own: then there are none to check.
    """
    own = context.get_locals_as_dict()
    root = getattr(own.get('event'), 'launch_description', None)
    sources = (getattr(entity, 'launch_description_source', None)
               for entity in getattr(root, 'entities', ()))
    launched = {os.path.abspath(source.location) for source in sources if source is not None}
    if own.get('current_launch_file_path') not in launched:
        return []
    return [word.partition(':=')[0] for word in context.argv]


def _unknown(name: str, names: list[str]) -> str:
    near = difflib.get_close_matches(name, names, n=1)
    hint = f'did you mean {near[0]}:=?' if near else f'expected one of {", ".join(names)}'
    return f'unknown argument {name}:=, {hint}'
