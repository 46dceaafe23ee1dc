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
Python classes of ROS interfaces that no wheel has, generated and compiled as a ROS build does.

They are kept for later runs, in the temporary folder of the machine.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import fcntl
from hashlib import sha256
from importlib.util import find_spec
import os
from pathlib import Path
import shutil
import subprocess
import sys
import sysconfig
import tempfile

import numpy as np
import pytest

FOLLOW_PATH = """nav_msgs/Path path
string controller_id
string goal_checker_id
string progress_checker_id
---
uint16 NONE=0
uint16 UNKNOWN=100
uint16 INVALID_CONTROLLER=101
uint16 TF_ERROR=102
uint16 INVALID_PATH=103
uint16 PATIENCE_EXCEEDED=104
uint16 FAILED_TO_MAKE_PROGRESS=105
uint16 NO_VALID_CONTROL=106
uint16 CONTROLLER_TIMED_OUT=107
std_msgs/Empty result
uint16 error_code
string error_msg
---
float32 distance_to_goal
float32 speed
"""
INTERFACES = {  # of Jazzy and Kilted: package/kind/file -> fields
    'nav2_msgs/action/FollowPath.action': FOLLOW_PATH,
    'nav2_msgs/msg/SpeedLimit.msg': 'std_msgs/Header header\nbool percentage\n'
                                    'float64 speed_limit\n',
    'tf2_msgs/msg/TFMessage.msg': 'geometry_msgs/TransformStamped[] transforms\n',
    **{f'smart_tire_msgs/msg/{path.name}': path.read_text(encoding='utf-8') for path in sorted(
        (Path(__file__).resolve().parents[2] / 'smart_tire_msgs' / 'msg').iterdir())}}
LIBRARIES = ('lib*__rosidl_*_c.so', 'lib*__rosidl_generator_py.so', 'librosidl_*_c.so',
             'libfastcdr.so', 'librmw.so', 'librcutils.so')
PREFIX = Path(sys.prefix)  # of the wheels of ROS
# each generator would parse each file again, which takes most of the time
GENERATE = """
import functools, pathlib, sys
from rosidl_parser import parser
parse = functools.cache(lambda path: parser.parse_idl_string(path.read_text(encoding='utf-8')))
parser.parse_idl_file = lambda locator: parser.IdlFile(locator, parse(locator.get_absolute_path()))
from rosidl_adapter.action import convert_action_to_idl
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport
source, package, share, output, other, *names = sys.argv[1:]
files = [pathlib.Path(name) for name in names]
for file in files:
    convert = convert_action_to_idl if file.suffix == '.action' else convert_msg_to_idl
    convert(pathlib.Path(source), package, file, pathlib.Path(source) / file.parent)
introspection = GenerateIntrospectionCTypesupport('')  # writes a file that C has, too
for generator in (
        GenerateC(''), GenerateFastRTPSCTypesupport(''), introspection,
        GenerateCTypesupport('', typesupport_implementations=[
            'rosidl_typesupport_fastrtps_c', 'rosidl_typesupport_introspection_c']),
        GeneratePython('', typesupport_implementations=['rosidl_typesupport_c'])):
    generator.generate(package, [f'{source}:{file.with_suffix(".idl")}' for file in files],
                       [share, f'{package}:{source}'],
                       pathlib.Path(other if generator is introspection else output))
"""


def missing() -> str:
    """Return why the classes cannot be made on this machine; '' if they can."""
    for name in ('rosidl_adapter', 'rosidl_generator_py', 'rosidl_typesupport_fastrtps_c'):
        if find_spec(name) is None:
            return f'{name} is not installed'
    if not (PREFIX / 'include' / 'fastcdr').is_dir():
        return f'no headers of ROS in {PREFIX}'
    return '' if shutil.which('gcc') and shutil.which('g++') else 'no compiler'


@contextmanager
def importable() -> Iterator[None]:
    """Make the classes importable in this process and those that it starts."""
    folder = str(folder_of_classes())
    with pytest.MonkeyPatch.context() as patch:
        _forget()  # packages that are folders of the repository
        patch.syspath_prepend(folder)
        patch.setenv('PYTHONPATH', os.pathsep.join([folder, os.environ.get('PYTHONPATH', '')]))
        yield
    _forget()


def _forget() -> None:
    packages = {interface.partition('/')[0] for interface in INTERFACES}
    for name in [name for name in sys.modules if name.partition('.')[0] in packages]:
        del sys.modules[name]


def folder_of_classes() -> Path:
    """Return a folder from which Python imports the packages of ``INTERFACES``."""
    key = sha256(repr((INTERFACES, GENERATE, sys.prefix, sys.version)).encode()).hexdigest()[:16]
    made = Path(tempfile.gettempdir()) / f'smart_tire_test_interfaces_{key}'
    with made.with_suffix('.lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # another worker may be making them
        if not made.is_dir():
            with tempfile.TemporaryDirectory(dir=made.parent) as name:
                for package in dict.fromkeys(key.partition('/')[0] for key in INTERFACES):
                    _build(Path(name), package)
                (Path(name) / 'classes').rename(made)
    return made


def _build(folder: Path, package: str) -> None:
    source, classes, other = (
        folder / 'source' / package, folder / 'classes', folder / 'introspection')
    files = {interface.partition('/')[2]: fields for interface, fields in INTERFACES.items()
             if interface.startswith(f'{package}/')}
    for file, fields in files.items():
        (source / file).parent.mkdir(parents=True, exist_ok=True)
        (source / file).write_text(fields, encoding='utf-8')
    _run([sys.executable, '-c', GENERATE, str(source), package, str(PREFIX / 'share'),
          str(classes / package), str(other / package), *files])
    (classes / package / '__init__.py').touch()
    headers = [PREFIX / 'include', *(PREFIX / 'include').iterdir(), classes, other,
               Path(sysconfig.get_path('include')), Path(np.get_include())]
    code = [path for end in ('*.c', '*.cpp') for made in (classes, other)
            for path in (made / package).rglob(end)]
    module = {path for path in code if path.parent == classes / package}
    libraries = [path for end in LIBRARIES for path in sorted((PREFIX / 'lib').glob(end))]
    # rosidl_typesupport_c opens a library for each kind: the module has loaded both by then
    first, second = (f'lib{package}__rosidl_typesupport_{kind}_c.so'
                     for kind in ('fastrtps', 'introspection'))
    for name, given in (
            (first, [*map(str, {*code} - module), *map(str, libraries), '-lstdc++',
                     '-Wl,--as-needed', f'-Wl,-rpath,{PREFIX / "lib"}']),
            (second, ['-Wl,--no-as-needed', f'-l:{first}']),
            (f'{package}_s__rosidl_typesupport_c.so', [
                *map(str, module), '-Wl,--no-as-needed', f'-l:{second}'])):
        _run(['gcc', '-O0', '-w', '-shared', '-fPIC', *(f'-I{path}' for path in headers),
              f'-L{classes / package}', *given, '-Wl,-rpath,$ORIGIN',
              '-o', str(classes / package / name)])


def _run(command: list[str]) -> None:
    subprocess.run(command, check=True, capture_output=True,
                   env={**os.environ, 'AMENT_PREFIX_PATH': str(PREFIX)})
