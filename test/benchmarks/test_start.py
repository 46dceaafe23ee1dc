# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Figures of the benchmark of start and idle load, as ratios to those of the empty node."""

import os
import subprocess
import sys
import time

from benchmarks.start import cpu_seconds, FLOOR, NO_BYTECODE, Start, table, with_bytecode
import pytest

pytestmark = pytest.mark.processes


def test_the_table_has_each_node_relative_to_the_empty_one():
    found = table({FLOOR: Start(0.2, 1.5, 30e6, 70e6), 'a': Start(0.3, 1.8, 37e6, 78e6),
                   'b': Start(0.5, 3.0, 40e6, 80e6)}, {FLOOR: 0.001, 'a': 0.0025})
    rows = dict(zip(*[column.cells for column in found.columns[:1]],
                    zip(*(column.cells for column in found.columns[1:]))))
    assert rows['a'] == ('0.30', '1.50', '1.80', '1.20', '37.0', '7.0', '78.0', '0.0025', '2.50')
    assert rows['b'][-2:] == ('', '')


def test_nodes_keep_their_bytecode_as_without_the_variable(tmp_path):
    (tmp_path / 'one.py').write_text('')
    for environment in ({'PATH': '/bin'}, {'PATH': '/bin', NO_BYTECODE: '1'}):
        subprocess.run([sys.executable, '-c', 'import one'], cwd=tmp_path, check=True,
                       env=with_bytecode(environment))
        (compiled,) = tmp_path.glob('__pycache__/one.*.pyc')
        compiled.unlink()


def test_the_cpu_time_is_that_of_all_threads_of_a_process():
    used, counted = time.process_time(), cpu_seconds(os.getpid())
    while time.process_time() < used + 0.05:
        pass
    grown = cpu_seconds(os.getpid()) - counted
    assert grown > 0.03
    assert grown - 0.02 < time.process_time() - used
