# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The command line, tables and results of a benchmark."""

from functools import partial
import json
import sys

from benchmarks.harness import Benchmark, figure_table, markdown, percent
from benchmarks.scoring import Errors, Run
import pytest


def run(name, seeds):
    return [Run(name, seed, {'mu': Errors.without_sigma([0.1 * seed])},
                notes={'C_x': f'too short: {seed}'}) for seed in seeds]


BENCHMARK = Benchmark(
    'own', 'a benchmark', 'All notes.', {'first': 'First', 'second': 'Second'},
    lambda name, seeds, args: [partial(run, name, seeds)],
    lambda rows, args: [figure_table('Errors', rows.items(), [
        percent('mu\n[%]', 'mu.rms'), percent('bias', 'none')])])


def test_a_run_prints_a_table_and_writes_it_with_the_results_of_all_seeds(tmp_path, capsys):
    assert BENCHMARK.main(['--seeds', '2', '--runs', 'second', '--out', str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert 'All notes.' in text and 'second' in text and 'First' not in text
    assert 'second: C_x' in text and 'too short: 1' in text and 'too short: 2' not in text
    results = json.loads((tmp_path / 'results.json').read_text())['rows']
    assert results['second']['over_seeds']['mu.max'] == pytest.approx(0.2)
    assert results['second']['seeds']['1']['mu.max'] == pytest.approx(0.1)
    assert '| second | 15.8 | - |' in (tmp_path / 'own.md').read_text()


def test_one_seed_is_quick_and_the_first_can_be_chosen(tmp_path):
    assert BENCHMARK.main(['--quick', '--first-seed', '41', '--runs', 'first',
                           '--out', str(tmp_path)]) == 0
    rows = json.loads((tmp_path / 'results.json').read_text())['rows']
    assert list(rows['first']['seeds']) == ['41']


def test_a_table_becomes_markdown():
    table = figure_table('Errors', [('sand', {'mu.rms': 0.123})], [percent('mu\n[%]', 'mu.rms')])
    assert markdown(table).splitlines() == [
        'Errors', '', '|  | mu [%] |', '| --- | --- |', '| sand | 12.3 |']


def test_results_of_an_earlier_run_are_kept_unless_forced(tmp_path, capsys):
    (tmp_path / 'results.json').write_text('kept')
    assert BENCHMARK.main(['--out', str(tmp_path)]) == 2
    assert 'results.json exists' in capsys.readouterr().err
    assert (tmp_path / 'results.json').read_text() == 'kept'
    assert BENCHMARK.main(['--quick', '--runs', 'first', '--force', '--out', str(tmp_path)]) == 0


@pytest.mark.parametrize('words, message', [
    (('--runs', 'moon'), 'moon: no such run, expected some of first, second'),
    (('--out', '/dev/null'), 'cannot be written'), (('--seeds', '0'), '--seeds'),
    (('--seeds', '-1'), '--seeds'), (('--seeds', 'two'), '--seeds')])
def test_wrong_arguments_are_usage_errors(words, message, tmp_path, capsys):
    with pytest.raises(SystemExit, match='2'):
        sys.exit(BENCHMARK.main(['--out', str(tmp_path), *words]))
    assert message in capsys.readouterr().err
