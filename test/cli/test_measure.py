# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire measure film`` on the command line."""

from __future__ import annotations

import numpy as np
import pytest
from smart_tire.cli import measure
from smart_tire.cli.main import new_parser
from smart_tire.errors import ParameterError
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.papers.film_bench import identify_film, write_params
from smart_tire.papers.film_files import read_columns, write_columns
from support.film_bench import several_loops, write_recording


def command(*words):
    return measure.run(new_parser().parse_args(['measure', *map(str, words)]))


@pytest.fixture(scope='module')
def params(tmp_path_factory):
    path = tmp_path_factory.mktemp('params') / 'film.yaml'
    write_params(path, *identify_film(several_loops(), FILMS['25x3']))
    return path


def test_deflections_are_computed_and_compared_with_the_reference(params, tmp_path, capsys):
    recording = several_loops(2)
    write_recording(tmp_path / 'data.csv', recording)
    assert command('film', tmp_path / 'data.csv', '--params', params) == 0
    output = capsys.readouterr().out
    assert f'of {recording.time.size} samples measured' in output
    assert 'error against deflection_m: ' in output
    time, value, sigma = read_columns(
        tmp_path / 'data_measured.csv', ['time_s', 'deflection_m', 'sigma_m'], only=True)
    np.testing.assert_allclose(time, recording.time)
    assert np.nanstd(value - recording.input) < 1e-4
    assert np.nanmedian(sigma) < 1e-4
    assert (tmp_path / 'data_measured.png').read_bytes().startswith(b'\x89PNG')


def test_a_charge_column_of_another_name_can_be_given(params, tmp_path, capsys):
    recording = several_loops(2)
    write_columns(tmp_path / 'data.csv', ('t', 'q'), (recording.time, recording.output))
    out = tmp_path / 'measured.csv'
    assert command('film', tmp_path / 'data.csv', '--params', params, '--columns', 't,q',
                   '--out', out, '--used') == 0
    assert 'against' not in capsys.readouterr().out
    assert out.exists() and out.with_suffix('.png').exists()


@pytest.mark.parametrize('columns, why', [
    ('t', 'expected two or three names'), ('t,q,r', 'expected r')])
def test_missing_columns_are_rejected(params, tmp_path, columns, why):
    recording = several_loops(2)
    write_columns(tmp_path / 'data.csv', ('t', 'q'), (recording.time, recording.output))
    with pytest.raises(ParameterError, match=why):
        command('film', tmp_path / 'data.csv', '--params', params, '--columns', columns)


def test_an_invalid_recording_is_rejected_with_its_name(params, tmp_path):
    write_columns(tmp_path / 'data.csv', ('time_s', 'charge_C'),
                  (np.arange(30.0), np.full(30, np.nan)))
    with pytest.raises(ParameterError, match=r'data.csv: charge\[0\] is nan'):
        command('film', tmp_path / 'data.csv', '--params', params)


@pytest.mark.parametrize('factors, why', [
    ((1e3, 1.0, 1.0), 'time_s advances by 2, .*in ms'),
    ((1.0, 1e12, 1.0), 'charge_C is up to .*in pC'),
    ((1.0, 1.0, 1e3), 'deflection_m is up to 12, .*in mm')])
def test_other_units_are_refused(params, tmp_path, factors, why):
    recording = several_loops(2)
    write_columns(tmp_path / 'data.csv', ('time_s', 'charge_C', 'deflection_m'), [
        factor * one for factor, one in zip(factors, (
            recording.time, recording.output, recording.input))])
    with pytest.raises(ParameterError, match=f'data.csv: {why}\\?$'):
        command('film', tmp_path / 'data.csv', '--params', params)
    assert [path.name for path in tmp_path.iterdir()] == ['data.csv']


def test_a_reason_is_printed_if_most_samples_are_not_measured(params, tmp_path, capsys):
    recording = several_loops(2)
    for name, factor in (('reversed', -1.0), ('beyond', 30.0)):
        write_columns(tmp_path / f'{name}.csv', ('time_s', 'charge_C'),
                      (recording.time, factor * recording.output))
        assert command('film', tmp_path / f'{name}.csv', '--params', params) == 0
    output = capsys.readouterr().out
    assert output.count('is its sign reversed') == output.count('beyond the calibration') == 1
