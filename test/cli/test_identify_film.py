# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire identify film`` on the command line."""

from __future__ import annotations

import pytest
from smart_tire.cli import identify
from smart_tire.cli.main import new_parser
from smart_tire.errors import ParameterError
from smart_tire.estimation.film.calibration import read_params
from smart_tire.papers.film_files import write_columns
from support.film_bench import one_loop, several_loops, write_recording


def command(*words):
    return identify.run(new_parser().parse_args(['identify', *map(str, words)]))


@pytest.fixture
def data(tmp_path):
    write_recording(tmp_path / 'data.csv', several_loops())
    return tmp_path / 'data.csv'


def test_the_fit_is_printed_and_parameters_and_figure_are_written(data, capsys):
    assert command('film', data, '--gain', '34.47') == 0
    output = capsys.readouterr().out
    for name in ('alpha_gain', 'a_gain', 'b_gain', 'low_corner'):
        assert f'{name} ' in output
    assert 'not observable' not in output
    assert read_params(data.with_name('data_film.yaml')).film.length == 0.025
    assert data.with_name('data_film.png').read_bytes().startswith(b'\x89PNG')


def test_other_columns_and_an_output_file_can_be_given(tmp_path):
    recording = one_loop()
    write_columns(tmp_path / 'data.csv', ('t', 'volts', 'q_nC'),
                  (recording.time, 300.0 * recording.input, 1e9 * recording.output))
    out = tmp_path / 'stage.yaml'
    assert command('film', tmp_path / 'data.csv', '--columns', 't,volts,q_nC', '--raw',
                   '--out', out) == 0
    assert read_params(out).film is None
    assert out.with_suffix('.png').exists()


def test_an_impossible_deflection_is_rejected(data):
    with pytest.raises(ParameterError, match='deflection_m is up to 0.012, .* 0.01 m; correct'):
        command('film', data, '--length', '10')


def test_a_negative_length_is_a_usage_error(data, capsys):
    with pytest.raises(SystemExit) as left:
        command('film', data, '--length', '-3')
    assert left.value.code == 2
    assert '--length' in capsys.readouterr().err


@pytest.mark.parametrize('columns, factors, text', [
    ('t_s,d_mm,q_C', (1, 1, 1), 'd_mm is in mm, expected m; correct file'),
    ('t_ms,Deflection [mm],Charge (pC)', (1, 1, 1), 't_ms is in ms, expected s; '
     r'Deflection \[mm\] is in mm, expected m; Charge \(pC\) is in pC, expected C; correct file'),
    ('t,d,q', (1, 1e3, 1), 'd is up to 12, expected at most 0.025 m: in mm\\?; correct file'),
    ('t,d,q', (1, 1, 1e9), 'q is up to 4.6, expected at most 1e-06 C: in nC\\?; correct file'),
    ('t,d,q', (1e3, 1e6, 1e12), 't advances by 2, expected at most 0.5 s: in ms\\?; d is up to '
     '1.2e.04, expected at most 0.025 m: in um\\?; q is up to .*: in pC\\?; correct file')])
def test_columns_in_other_units_are_refused(columns, factors, text, tmp_path):
    recording = several_loops()
    write_columns(tmp_path / 'data.csv', columns.split(','), [
        factor * one for factor, one in zip(factors, (
            recording.time, recording.input, recording.output))])
    with pytest.raises(ParameterError, match=f'data.csv: {text} or --length, or give --raw'):
        command('film', tmp_path / 'data.csv', '--columns', columns)
    assert [path.name for path in tmp_path.iterdir()] == ['data.csv']
