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

from dataclasses import replace
from functools import partial
import json
import sys

from benchmarks.harness import (
    Benchmark, check_ranges, figure_table, markdown, percent, Range, run_benchmark)
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


def test_a_figure_outside_its_range_fails_after_all_are_printed(capsys):
    low, high = Range('low [ms]', 1.0, 2.0), Range('high', 0.25, 3.0)
    assert run_benchmark('own', lambda: check_ranges([(low, 1.0), (high, 3.0)])) == 0
    text = capsys.readouterr().out
    assert 'low [ms]' in text and '0.25 to 3' in text and 'OUTSIDE' not in text
    for value in 0.9, 2.1, float('nan'):
        assert run_benchmark('own', partial(check_ranges, [(low, value), (high, 3.0)])) == 1
        out, error = capsys.readouterr()
        assert out.count('OUTSIDE') == 1 and 'high' in out
        assert error == 'benchmarks.own: outside the range of docs/benchmarks.md: low [ms]\n'


def test_a_benchmark_checks_its_ranges(tmp_path, capsys):
    one = replace(BENCHMARK, in_ranges=lambda rows: [
        (Range('mu', 0.0, 0.01), rows['first']['mu.max'])])
    assert one.main(['--quick', '--runs', 'first', '--out', str(tmp_path)]) == 1
    assert 'OUTSIDE' in capsys.readouterr().out


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
