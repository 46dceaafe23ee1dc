# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The progress of an installation by the Makefile."""

from pathlib import Path
import shutil
import subprocess

import pytest

MAKEFILE = Path(__file__).resolve().parents[1] / 'Makefile'

pytestmark = [pytest.mark.processes, pytest.mark.skipif(
    shutil.which('make') is None, reason='needs make')]


@pytest.mark.parametrize(('log', 'packages', 'share'), [
    ('Collecting a\n  Collecting\nProcessing ./b\n', '10', '25 %'),
    ('Collecting a\n' * 9, '2', '99 %'), ('', '10', '15 %'), (None, '10', '15 %'),
    ('Collecting a\n', '', '')])
def test_the_share_of_an_installation(log, packages, share, tmp_path):
    if log is not None:
        (tmp_path / 'install.log').write_text(log)
    for name in 'a-1.dist-info', 'b-2.dist-info':
        (tmp_path / 'lib' / 'python3.11' / 'site-packages' / name).mkdir(parents=True)
    (tmp_path / 'share.mk').write_text(
        f'include {MAKEFILE}\nshare:\n\t@present=1; echo "$(SHARE)"\n')
    done = subprocess.run(
        ['make', '--no-print-directory', '-f', tmp_path / 'share.mk', 'share', f'VENV={tmp_path}',
         f'PACKAGES={packages}'], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == share


@pytest.fixture
def checkout(tmp_path):
    """Return what the Makefile needs to install, and a call of make with Pythons of versions."""
    tools = tmp_path / 'tools'
    tools.mkdir()
    for name in ('cat', 'cp', 'date', 'echo', 'find', 'grep', 'head', 'ls', 'mkdir', 'rm',
                 'sh', 'sleep', 'tail', 'touch', 'wc'):
        (tools / name).symlink_to(shutil.which(name))
    for name in 'constraints.txt', 'requirements.txt', 'setup.py', 'setup.cfg', 'pyproject.toml':
        (tmp_path / name).touch()
    (tmp_path / 'smart_tire').mkdir()

    def make(*words, **pythons):
        for name, version in pythons.items():
            script = tools / name.replace('_', '.')
            script.write_text(PYTHON.format(version=version, supported=int(
                not 10 <= int(version.split('.')[1]) < 14)))
            script.chmod(0o755)
        return subprocess.run(
            [shutil.which('make'), '--no-print-directory', '-f', MAKEFILE, 'COMPILED=',
             'REMOVE_EXTENSIONS=:', *words, 'setup'],
            env={'PATH': str(tools)}, cwd=tmp_path, check=False, capture_output=True, text=True)
    return make


# Its environments contain it; its pip only prints.
PYTHON = """#!/bin/sh
case "$*" in
--version) echo Python {version};;
-c*) exit {supported};;
*--clear*) rm -rf "$4"; mkdir -p "$4/bin"; cp "$0" "$4/bin/python";;
"-m venv"*) ;;
*) echo {version}: "$*";;
esac
"""


def test_an_old_python_is_named_once_and_the_next_make_works(checkout, tmp_path):
    done = checkout(python3='3.8.10')
    assert done.returncode == 2 and not (tmp_path / '.venv').exists()
    assert done.stderr.splitlines()[0] == (
        'python3 is Python 3.8.10, expected Python 3.10 to 3.13 with venv: install one (on '
        'Debian: python3-venv) or name it: make PYTHON=...')
    assert done.stderr.count('3.8.10') == 1 and not done.stdout
    done = checkout('PYTHON=python3.9', python3_9='3.9.2')
    assert done.stderr.startswith('python3.9 is Python 3.9.2, expected') and done.returncode == 2
    assert checkout(python3_12='3.12.4').returncode == 0
    assert '3.12.4: -m pip' in (tmp_path / '.venv' / 'install.log').read_text()


def test_the_environment_of_an_old_python_is_replaced(checkout, tmp_path):
    (tmp_path / '.venv' / 'bin').mkdir(parents=True)
    (tmp_path / '.venv' / 'bin' / 'python').write_text('#!/bin/sh\nexit 1\n')
    (tmp_path / '.venv' / 'bin' / 'python').chmod(0o755)
    assert checkout(python3='3.11.2').returncode == 0
    assert '3.11.2: -m pip' in (tmp_path / '.venv' / 'install.log').read_text()


def test_a_python_that_was_named_once_needs_no_name_again(checkout, tmp_path):
    assert checkout('PYTHON=python3.12', python3='3.8.10', python3_12='3.12.4').returncode == 0
    (tmp_path / 'tools' / 'python3.12').unlink()
    (tmp_path / '.venv' / 'ready').unlink()
    (tmp_path / '.venv' / 'kept').touch()
    assert checkout().returncode == 0
    assert (tmp_path / '.venv' / 'kept').exists()


def test_a_warning_is_not_the_package_in_progress(tmp_path):
    (tmp_path / 'install.log').write_text(
        'Collecting numpy\nWARNING: Location /wheels is ignored\n  DEPRECATION: old\n')
    (tmp_path / 'latest.mk').write_text(f'include {MAKEFILE}\nlatest:\n\t@$(LATEST)\n')
    done = subprocess.run(
        ['make', '--no-print-directory', '-f', tmp_path / 'latest.mk', 'latest',
         f'VENV={tmp_path}'], check=True, capture_output=True, text=True)
    assert done.stdout == 'Collecting numpy\n'
