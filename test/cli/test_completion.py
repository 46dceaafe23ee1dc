# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Completion in the shell: verbs, options, files and topics, as a shell asks for them."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys

import pytest

import smart_tire
from smart_tire.cli.main import VERBS

ROOT = Path(smart_tire.__file__).parents[1]
SEPARATOR = '\013'


def completions(line, folder):
    """Return what a shell is offered at the end of ``line``."""
    answer = folder / 'completions'
    subprocess.run(
        [sys.executable, '-m', 'smart_tire.cli.main'], check=False, cwd=folder,
        env={**os.environ, 'PYTHONPATH': str(ROOT), '_ARGCOMPLETE': '1', 'COMP_LINE': line,
             'COMP_POINT': str(len(line)), '_ARGCOMPLETE_IFS': SEPARATOR,
             '_ARGCOMPLETE_STDOUT_FILENAME': str(answer)})
    return {word.strip() for word in answer.read_text().split(SEPARATOR)}


def test_all_verbs_are_offered(tmp_path):
    assert set(VERBS) <= completions('smart_tire ', tmp_path)
    assert completions('smart_tire ana', tmp_path) == {'analyze'}


@pytest.mark.parametrize(('line', 'offered'), [
    ('smart_tire analyze --smo', {'--smooth'}),
    ('smart_tire replay --wait', {'--wait', '--wait-for'}),
    ('smart_tire identify g', {'gains', 'geometry'}),
    ('smart_tire identify motor --li', {'--lifted'}),
    ('smart_tire analyze my_b', {'my_bag/'}),
    ('smart_tire analyze my_bag --params rob', {'robot.yaml'}),
    ('smart_tire drive --path figure', {'figure_eight'}),
    ('smart_tire drive --path my_', {'my_bag/'}),
    ('smart_tire topics wheel_s', {'wheel_slip', 'wheel_states'})])
def test_options_kinds_files_and_topics_are_completed(line, offered, tmp_path):
    (tmp_path / 'my_bag').mkdir()
    (tmp_path / 'robot.yaml').touch()
    assert completions(line, tmp_path) == offered


def test_global_completion_recognizes_the_command():
    main = (ROOT / 'smart_tire' / 'cli' / 'main.py').read_text(encoding='utf-8')
    assert 'PYTHON_ARGCOMPLETE_OK' in main[:1024]  # argcomplete reads no more
