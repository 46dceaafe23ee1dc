# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The package as installed: version, executables, files, and declared dependencies."""

from __future__ import annotations

import ast
import configparser
from functools import cache
from importlib.metadata import files, PackageNotFoundError, requires
import itertools
from pathlib import Path
import re
import runpy
import sys
from xml.etree import ElementTree

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
import pytest
import setuptools

import smart_tire
from smart_tire.messages import TOPICS
from smart_tire.nodes.command_line import COMPOSED
from smart_tire.parameters import NODE_PARAMS

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / 'smart_tire'
MAKEFILE = (ROOT / 'Makefile').read_text(encoding='utf-8')
MANIFEST = ElementTree.parse(ROOT / 'package.xml').getroot()
ROSDEP_KEYS = {  # top-level module -> its key in rosdep's python.yaml
    'argcomplete': 'python3-argcomplete', 'matplotlib': 'python3-matplotlib',
    'numpy': 'python3-numpy', 'rich': 'python3-rich',
    'scipy': 'python3-scipy', 'serial': 'python3-serial', 'yaml': 'python3-yaml',
}
PIP_NAMES = {'serial': 'pyserial', 'yaml': 'pyyaml'}  # where module and distribution differ
WITHOUT_KEY = {'lz4', 'mcap', 'plotly', 'rosbags', 'zstandard'}
# module -> extra and distribution with it
EXTRAS = {'rerun': ('view', 'rerun-sdk'), 'pandas': ('pandas', 'pandas'),
          'cv2': ('camera', 'opencv-python-headless'), 'filterpy': ('camera', 'filterpy'),
          'aiohttp': ('fleet', 'aiohttp'), 'botocore': ('fleet', 's3fs'),
          'distributed': ('fleet', 'distributed'), 'fsspec': ('fleet', 'fsspec'),
          'pyarrow': ('fleet', 'pyarrow')}
BUILD = {'cython': 'cython3'}  # module -> its key; used to build, and not needed to run
OPTIONAL = {'tf2_msgs'}  # not among the wheels; used where it is installed
ROS_SUFFIXES = ('_msgs', '_srvs', '_interfaces')


@pytest.fixture(scope='module')
def setup_arguments() -> dict:
    """Return the arguments with which setup.py calls setuptools."""
    captured: dict = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.setattr(setuptools, 'setup', lambda **arguments: captured.update(arguments))
        runpy.run_path(str(ROOT / 'setup.py'))
    return captured


def pins(name: str) -> dict[str, set[str]]:
    """Return distribution -> versions of a requirements file."""
    found: dict[str, set[str]] = {}
    for line in (ROOT / name).read_text(encoding='utf-8').splitlines():
        if line and not line.startswith('#'):
            match = re.fullmatch(
                r'([a-z0-9.-]+)==([0-9.]+(?:b[0-9]+)?)(; python_version .*)?', line)
            assert match, line
            found.setdefault(match[1], set()).add(match[2])
    return found


def distribution(requirement: str) -> str:
    """Return the bare name in a requirement."""
    return re.split(r'[\[<>=~!;\s]', requirement)[0]


@cache
def imported_roots() -> set[str]:
    """Return the top-level modules that the package imports."""
    roots: set[str] = set()
    for path in PACKAGE.rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                roots.update(alias.name.split('.')[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                roots.add((node.module or '').split('.')[0])
    return roots


def ros_packages() -> set[str]:
    """Return the message packages that are imported, or looked up for a topic."""
    topics = {topic.type.split('/')[0] for topic in TOPICS.values()}
    return topics | {root for root in imported_roots() if root.endswith(ROS_SUFFIXES)}


def depends() -> set[str]:
    """Return the run-time dependencies of package.xml."""
    return {item.text or '' for tag in ('exec_depend', 'depend') for item in MANIFEST.iter(tag)}


def test_there_is_one_version(setup_arguments):
    changes = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    version = MANIFEST.findtext('version')
    assert setup_arguments['version'] == version == smart_tire.__version__
    messages = ElementTree.parse(ROOT / 'smart_tire_msgs' / 'package.xml')
    assert messages.findtext('version') == version
    assert 'Forthcoming\n-----------\n' in changes or f'\n{version} (' in changes


def test_it_is_an_ament_python_package_of_format_3_with_the_same_licence_everywhere(
        setup_arguments):
    assert MANIFEST.get('format') == '3'
    assert MANIFEST.findtext('export/build_type') == 'ament_python'
    assert setup_arguments['name'] == MANIFEST.findtext('name') == 'smart_tire'
    assert setup_arguments['license'] == MANIFEST.findtext('license') == 'Apache-2.0'
    assert 'Apache License' in (ROOT / 'LICENSE').read_text(encoding='utf-8')


def test_every_node_and_the_command_are_executables(setup_arguments):
    scripts = dict(re.split(r'\s*=\s*', script)
                   for script in setup_arguments['entry_points']['console_scripts'])
    assert scripts == {'smart_tire': 'smart_tire.cli.main:main',
                       **{node: f'smart_tire.nodes.{node}:main'
                          for node in (*NODE_PARAMS, COMPOSED)}}


def test_every_entry_point_refers_to_a_function_or_class(setup_arguments):
    for script in sum(setup_arguments['entry_points'].values(), []):
        module, _, function = script.partition('= ')[2].partition(':')
        path = ROOT.joinpath(*module.split('.')).with_suffix('.py')
        names = {node.name for node in ast.parse(path.read_text(encoding='utf-8')).body
                 if isinstance(node, ast.FunctionDef | ast.ClassDef)}
        assert function in names, script


def test_every_folder_of_the_package_is_installed(setup_arguments):
    folders = {path.parent.relative_to(ROOT) for path in PACKAGE.rglob('*.py')}
    assert {'.'.join(folder.parts) for folder in folders} == set(setup_arguments['packages'])


def test_all_files_of_the_package_that_are_no_modules_are_installed(setup_arguments):
    patterns = setup_arguments['package_data'][PACKAGE.name]
    assert {path for pattern in patterns for path in PACKAGE.glob(pattern)} == {
        path for path in PACKAGE.rglob('*.*')
        if path.suffix not in ('.py', '.pyc', '.c', '.so')}


def test_marker_manifest_launch_files_parameters_views_and_urdf_are_installed(setup_arguments):
    installed = {f'{target}/{Path(source).name}'
                 for target, sources in setup_arguments['data_files'] for source in sources}
    share = 'share/smart_tire'
    assert installed == {
        'share/ament_index/resource_index/packages/smart_tire', f'{share}/package.xml',
        *(f'{share}/{path.relative_to(ROOT)}' for pattern in (
            'launch/*.py', 'config/*.yaml', 'config/calibration/*', 'config/platforms/*',
            'config/view/*', 'config/security/*', 'urdf/*')
          for path in ROOT.glob(pattern))}
    assert (ROOT / 'resource' / 'smart_tire').is_file()


def test_scripts_are_installed_where_ros2_run_looks_and_use_the_active_python():
    config = configparser.ConfigParser()
    config.read(ROOT / 'setup.cfg')
    assert config['develop']['script_dir'] == config['install']['install_scripts'] \
        == '$base/lib/smart_tire'
    assert config['build_scripts']['executable'] == '/usr/bin/env python3'


def test_every_message_package_is_declared_twice(setup_arguments):
    assert ros_packages() <= depends()
    wheels = {distribution(item) for item in setup_arguments['extras_require']['ros']}
    assert {f'ros-{name.replace("_", "-")}' for name in ros_packages() - OPTIONAL} <= wheels


def test_what_compiles_modules_is_declared_for_pip_and_for_rosdep():
    project = (ROOT / 'pyproject.toml').read_text(encoding='utf-8')
    build = set(re.findall(r"'(\w+)>=", project.partition('requires = ')[2].partition('\n')[0]))
    assert BUILD.keys() <= build & pins('constraints.txt').keys() & imported_roots()
    assert set(BUILD.values()) <= {item.text for item in MANIFEST.iter('build_depend')}


def test_a_change_of_a_compiled_module_compiles_it_again(setup_arguments):
    sources = {path for ext in setup_arguments['ext_modules'] for path in ext.sources}
    pattern = MAKEFILE.partition("\nCOMPILED := $(shell grep -rl '")[2].partition("'")[0]
    found = {path.relative_to(ROOT).as_posix() for path in PACKAGE.rglob('*.py')
             if re.search(pattern, path.read_text(encoding='utf-8'), re.MULTILINE)}
    assert found == sources and len(sources) > 6
    assert not setup_arguments['zip_safe']


@pytest.mark.parametrize('missing', [
    'permission', 'Cython', pytest.param('compiler', marks=pytest.mark.long)])
def test_modules_are_installed_as_python_if_they_cannot_be_compiled(
        missing, setup_arguments, monkeypatch, tmp_path):
    if missing == 'permission':
        monkeypatch.setenv('SMART_TIRE_NO_COMPILER', '1')
    elif missing == 'Cython':
        monkeypatch.setitem(sys.modules, 'Cython.Build', None)
    else:
        pytest.importorskip('Cython')
        monkeypatch.setenv('CC', str(tmp_path / 'no_compiler'))
    monkeypatch.chdir(ROOT)
    package = setuptools.Distribution(setup_arguments)
    command = package.get_command_obj('build_ext')
    command.build_lib, command.build_temp = str(tmp_path / 'lib'), str(tmp_path / 'temp')
    package.run_command('build_ext')
    assert not list(tmp_path.rglob('*.so'))


def test_every_library_is_declared_with_its_rosdep_key_or_as_having_none(setup_arguments):
    for extra, name in (EXTRAS[root] for root in imported_roots() & EXTRAS.keys()):
        assert name in map(distribution, setup_arguments['extras_require'][extra])
    used = {root for root in imported_roots() - {'smart_tire', 'rclpy', *EXTRAS, *BUILD}
            if root not in sys.stdlib_module_names and not root.endswith(ROS_SUFFIXES)}
    assert used <= ROSDEP_KEYS.keys() | WITHOUT_KEY
    assert {ROSDEP_KEYS[name] for name in used - WITHOUT_KEY} <= depends()
    assert used & WITHOUT_KEY <= pins('requirements.txt').keys()
    required = {distribution(item) for item in setup_arguments['install_requires']}
    assert {PIP_NAMES.get(name, name) for name in used} <= required


def test_every_requirement_has_its_exact_version(setup_arguments):
    lines = (ROOT / 'requirements-jazzy.txt').read_text(encoding='utf-8').splitlines()
    jazzy = [line for line in lines if not line.startswith('#')]
    extras = setup_arguments['extras_require']
    assert {*map(distribution, extras['ros'])} <= {*map(distribution, jazzy)}
    wanted = [*setup_arguments['install_requires'], *itertools.chain(*extras.values()),
              *(line for line in jazzy if '==' not in line)]
    assert {distribution(item) for item in wanted} <= pins('constraints.txt').keys()


def test_versions_are_the_same_in_all_files(setup_arguments):
    constraints = pins('constraints.txt')
    for name, versions in pins('requirements.txt').items():
        assert constraints[name] == versions
    for item in setup_arguments['extras_require']['lint']:
        name, _, version = item.partition('==')
        assert constraints[name] == {version}


def closure(lines):
    """Return the names of all distributions that requirements need, these included."""
    waiting, known = [(line, '') for line in lines], set()
    while waiting:
        line, wanted = waiting.pop()
        item = Requirement(line)
        if item.marker is not None and not item.marker.evaluate({'extra': wanted}):
            continue
        name = canonicalize_name(item.name)
        new = {(name, extra) for extra in ('', *item.extras)} - known
        known |= new
        waiting += [(other, extra) for _, extra in new for other in requires(name) or []]
    return {name for name, _ in known}


def test_the_share_of_an_installation_is_of_all_packages(setup_arguments):
    extras = setup_arguments['extras_require']
    for extra, variable in (('CORE_EXTRAS', 'CORE_PACKAGES'), ('EXTRAS', 'PACKAGES')):
        names, = re.findall(rf'^{extra} := \[(ros.*)\]$', MAKEFILE, re.MULTILINE)
        number, = re.findall(rf'^{variable} := (\d+)$', MAKEFILE, re.MULTILINE)
        try:
            needed = closure([*setup_arguments['install_requires'], *itertools.chain(*(
                extras[name] for name in names.split(',')))])
        except PackageNotFoundError as error:
            pytest.skip(f'{error} is not installed')
        assert len(needed) == pytest.approx(int(number), rel=0.05)
        assert disk_space(needed) == pytest.approx(
            0.7e9 if variable == 'CORE_PACKAGES' else 1.9e9, abs=0.1e9)


def test_the_space_of_an_installation_is_that_of_the_documents():
    usage = ' '.join((ROOT / 'docs' / 'usage.md').read_text(encoding='utf-8').split())
    assert '(0.7 GB; log:' in usage and 'tools of the tests too (1.9 GB)' in usage
    assert '$(if $(filter $@,$(CORE)),0.7,1.9) GB' in MAKEFILE


def disk_space(names):
    """
    Return the space [B] of the files of distributions, in blocks of 4096.

    Bytecode, which pip may leave to the first import, counts 1.3 times its source (measured).
    """
    paths = [Path(str(file.locate())) for name in names for file in files(name) or []]
    return sum((2.3 if path.suffix == '.py' else 1.0) * (-path.stat().st_size // 4096 * -4096)
               for path in paths if path.suffix != '.pyc' and path.exists())


def test_the_readme_names_every_node_and_launch_file():
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    for name in [*NODE_PARAMS, *(path.name for path in (ROOT / 'launch').glob('*.launch.py'))]:
        assert f'`{name}`' in text
