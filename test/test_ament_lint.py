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
The linters of ROS, as ``colcon test`` runs them; skipped where they are not installed.

Without ROS, ruff and ``test_style.py`` check most of their rules.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
import subprocess
import sys

import pytest

pytestmark = [pytest.mark.linter, pytest.mark.processes]

ORIGIN = 'in a ROS distribution; flake8 and pep257 also with make test-jazzy'
ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize('name', [
    pytest.param('ament_copyright', marks=pytest.mark.copyright),
    pytest.param('ament_flake8', marks=pytest.mark.flake8),
    pytest.param('ament_pep257', marks=pytest.mark.pep257)])
def test_the_linter_of_ros_finds_nothing(name):
    if find_spec(name) is None:
        pytest.skip(f'needs {name}: {ORIGIN}')
    # flake8 forks: copies of a process with threads of DDS crash, and are replaced without end
    run = subprocess.run([sys.executable, '-m', f'{name}.main'], cwd=ROOT, text=True,
                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    assert run.returncode == 0, run.stdout
