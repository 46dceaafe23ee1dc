# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Checks of launch arguments, signal handling and restarts, for the launch files and the command.

The launch system is not imported: functions take its context as an argument, so that they can be
installed and tested without it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import math
import os
from pathlib import Path
import re
import signal
from typing import Any

from smart_tire.errors import did_you_mean, ParameterError
from smart_tire.parameters import RobotParams
from smart_tire.parameters.files import has_block_for
from smart_tire.yaml_text import load_own
import yaml

# Arguments that launch itself reads, undeclared, for any launch file.
LAUNCH_ARGUMENTS = ('emulate_tty', 'launch-prefix', 'launch-prefix-filter', 'sigkill_timeout',
                    'sigterm_timeout')
# design.ros2.org/articles/topic_and_service_names.html
TOPIC = r'(?!.*__)/?[A-Za-z]\w*(?:/[A-Za-z]\w*)*'
BOOLEANS = {'true': True, 'false': False}
INDEX = 'share/ament_index/resource_index/packages'  # below each path of AMENT_PREFIX_PATH
# as in nav2: robots in namespaces have transforms of their own
TRANSFORMS = [('/tf', 'tf'), ('/tf_static', 'tf_static')]
PUBLISHER, VIEWER = 'robot_state_publisher', 'rviz2'  # packages

RESPAWN_DELAY = 2.0  # s, so that a port can reappear and the log remains readable
MAX_RESPAWN_DELAY = 60.0  # s, of a node that dies again and again
ENDED = (0, 2)  # exit status: interrupted, wrong arguments or parameters; not started again
STOP = {'start_stopped': True}  # parameter with which motor_driver starts again
SEPARATE = ('motor_driver', 'wheel_controller')  # processes of their own, for safety
CAMERA = ('overhead_camera_simulator', 'overhead_localizer')
MAPPER = 'friction_mapper'
FILM = ('film_driver', 'film_sensor')
OPTIONAL = (MAPPER, *FILM)  # not always wanted
FILM_SIMULATOR = 'film_simulator'
TEST_STAND = ('robot_simulator', *CAMERA, FILM_SIMULATOR)  # no nodes of a robot

Converter = Callable[[str], Any]  # of a launch argument; raises ValueError if it is invalid


def check_arguments(context: Any, converters: Mapping[str, Converter]) -> None:
    """
    Raise ParameterError for the first invalid launch argument, which ends the launch.

    ``converters`` has all arguments of the launch file. Others, which launch would ignore, are
    refused. Without this check launch_ros would skip a missing parameter file with a warning, and
    nodes would use their defaults, including the ports of the real devices.
    """
    for name in _given(context):
        if name not in converters and name not in LAUNCH_ARGUMENTS:
            raise ParameterError(_unknown(name, sorted(converters)))
    for name, convert in converters.items():
        value = context.launch_configurations[name]
        try:
            convert(value)
        except ValueError as error:
            raise ParameterError(f'{name}:={value}: {error}') from error


def text(value: str) -> str:
    """Return ``value``; any text is valid."""
    return value


def boolean(value: str) -> bool:
    """Return a Boolean; raise ValueError if ``value`` is neither true nor false."""
    if value.lower() not in BOOLEANS:
        raise ValueError('expected true or false')
    return BOOLEANS[value.lower()]


def viewer(value: str) -> bool:
    """Return a Boolean; raise ValueError if it is true and RViz is not installed."""
    shown = boolean(value)
    if shown and not is_installed(VIEWER):
        raise ValueError(f'{VIEWER} is not installed')
    return shown


def is_described(description: str) -> bool:
    """Return whether robot_state_publisher is to be started: wanted, and installed."""
    return boolean(description) and is_installed(PUBLISHER)


def is_installed(package: str) -> bool:
    """Return whether ROS knows ``package``."""
    prefixes = filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))
    return any(Path(prefix, INDEX, package).exists() for prefix in prefixes)


def positive(value: str) -> float:
    """Return a number; raise ValueError if ``value`` is not a positive, finite number."""
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise ValueError('expected a positive number')
    return number


def path(value: str) -> Path:
    """Return the path of a readable file or directory; raise ValueError otherwise."""
    found = Path(value)
    if not found.exists():
        raise ValueError('no such file or directory')
    if not os.access(found, os.R_OK):
        raise ValueError('no permission to read it')
    return found


def file(value: str) -> Path:
    """Return the path of a readable file; raise ValueError otherwise."""
    found = path(value)
    if found.is_dir():
        raise ValueError('is a directory, expected a file')
    return found


def topic(value: str) -> str:
    """Return ``value``; raise ValueError if it is no name of a topic."""
    if not re.fullmatch(TOPIC, value, re.ASCII):
        raise ValueError('expected the name of a topic, such as sensors/imu_0/data')
    return value


def parameters_of(*nodes: str) -> Converter:
    """
    Return a converter to the path of a parameter file with values for one of ``nodes``.

    It raises ValueError if there are none: defaults, ports among them, would be used silently.
    """
    def convert(value: str) -> Path:
        found = file(value)
        if not has_block_for(found, nodes):
            raise ValueError(f'no parameters of {" or ".join(nodes)} in this file')
        return found

    return convert


def enclave(context: Any, name: str) -> list[str]:
    """Return the ROS arguments with the enclave of ``name`` in the security policy."""
    space = context.launch_configurations['namespace'].strip('/')
    return ['--enclave', '/'.join(('', *filter(None, (space, name))))]


def view_of(text: str, robot: RobotParams) -> str:
    """
    Return the configuration ``text`` of RViz with the frames and the ground of ``robot``.

    Raises ParameterError if ``frame_prefix`` does not end with ``/``, which RViz puts between the
    prefix of a robot model and its links.
    """
    if robot.frame_prefix and not robot.frame_prefix.endswith('/'):
        raise ParameterError(f'frame_prefix: {robot.frame_prefix!r}, RViz needs one that ends '
                             'with /')
    view = load_own(text)
    manager = view['Visualization Manager']
    manager['Global Options']['Fixed Frame'] = robot.frames['odom']
    manager['Views']['Current']['Target Frame'] = robot.frames['base_link']
    for display in manager['Displays']:
        if display['Class'].endswith('/RobotModel'):
            display['TF Prefix'] = robot.frame_prefix.removesuffix('/')
        elif display['Class'].endswith('/Grid'):
            display['Offset']['Z'] = -robot.wheel_radius
    return yaml.safe_dump(view, sort_keys=False)


def hold_interrupts(context: Any) -> None:
    """
    Start the processes of this launch description with SIGINT blocked.

    Ctrl-C sends SIGINT to the whole process group. A Python interpreter that is still starting
    would end with a traceback; a blocked signal is delivered when the node has installed its
    handlers (see smart_tire.nodes).
    """
    if context.launch_configurations.get('launch-prefix'):
        return  # a debugger would pass the signal mask on to its children
    loop = context.asyncio_loop
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # Launch first visits the whole description, then the loop starts the processes, one task
    # each. A callback scheduled by a callback of this iteration runs after all of them.
    loop.call_soon(loop.call_soon, signal.pthread_sigmask, signal.SIG_UNBLOCK, {signal.SIGINT})


def respawn_delay(waited: float, lasted: float) -> float:
    """
    Return the wait [s] until a node that died starts again.

    It doubles, up to ``MAX_RESPAWN_DELAY``, until the node has run that long. ``waited`` [s] was
    the wait before the start of the node, which has run for ``lasted`` [s].
    """
    if not waited or lasted > MAX_RESPAWN_DELAY:
        return RESPAWN_DELAY
    return min(2.0 * waited, MAX_RESPAWN_DELAY)


def _given(context: Any) -> list[str]:
    """
    Return the names of the arguments on the command line of ``ros2 launch``.

    Empty if another launch file includes this one, since it has arguments of its own.
    """
    variables = context.get_locals_as_dict()
    root = getattr(variables.get('event'), 'launch_description', None)
    sources = (getattr(entity, 'launch_description_source', None)
               for entity in getattr(root, 'entities', ()))
    launched = {os.path.abspath(source.location) for source in sources if source is not None}
    if variables.get('current_launch_file_path') not in launched:
        return []
    return [word.partition(':=')[0] for word in context.argv]


def _unknown(name: str, names: list[str]) -> str:
    return f'unknown argument {name}:=' + did_you_mean(
        name, names, f', expected one of {", ".join(names)}').replace('?', ':=?')
