# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Skipped tests: their groups in the last lines of a run, and the recordings that some need."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys

import pytest
from support import real_recordings
from support.skipped import summary

pytestmark = pytest.mark.processes

ROOT = Path(__file__).resolve().parents[1]
SKIPPING = """
import pytest

@pytest.mark.parametrize('number', range(3))
def test_of_a_browser(number):
    pytest.skip(f'needs a browser: number {number}')

@pytest.mark.skipif(True, reason='needs a robot')
def test_of_a_robot():
    pass

def test_of_time():
    pytest.skip('inconclusive: 0.3 s')

def test_that_passes():
    pass
"""


def test_reasons_are_grouped_and_what_is_inconclusive_is_counted_apart():
    assert summary([]) == []
    assert summary(['Skipped: needs a needle', 'inconclusive: 3 s', 'Skipped: needs a needle',
                    'no luck: at all', 'inconclusive: 4 s']) == [
        '3 skipped: 2 need a needle, 1 no luck',
        '2 inconclusive: the machine was too busy to prove a bound']


def test_they_are_in_the_last_lines_of_a_run_below_those_of_pytest(tmp_path):
    (tmp_path / 'conftest.py').write_text('from support.skipped import pytest_sessionfinish')
    (tmp_path / 'test_skipping.py').write_text(SKIPPING)
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-c', ROOT / 'pyproject.toml', '-p', 'no:cacheprovider',
         '-n', '1', tmp_path], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    result, *last = done.stdout.splitlines()[-3:]
    assert '1 passed, 5 skipped' in result
    assert last == ['4 skipped: 3 need a browser, 1 needs a robot',
                    '1 inconclusive: the machine was too busy to prove a bound']


def test_recordings_are_found_in_the_folder_of_the_variable_or_named(tmp_path, monkeypatch):
    monkeypatch.setenv(real_recordings.VARIABLE, str(tmp_path))
    with pytest.raises(pytest.skip.Exception, match=rf'set {real_recordings.VARIABLE}.*: no .*/a'):
        real_recordings.real_recording('a')
    (tmp_path / 'a').mkdir()
    assert real_recordings.real_recording('a') == tmp_path / 'a'
