# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings in CSV files, valid and invalid."""

import numpy as np
import pytest

from smart_tire.errors import ParameterError
from smart_tire.papers.film_files import COLUMNS, FilmRecording, read_recording
from support.film_bench import write_recording

TIME = np.arange(30) * 0.01
HEADER = ','.join(COLUMNS)
ROWS = [f'{t:.2f},{0.001 * t},{-1e-9 * t}' for t in TIME]


def written(tmp_path, header=HEADER, rows=ROWS):
    path = tmp_path / 'data.csv'
    path.write_text('\n'.join([header, *rows]) + '\n')
    return path


def test_a_round_trip_preserves_the_recording(tmp_path):
    rng = np.random.default_rng(1)
    recording = FilmRecording(TIME, 0.001 * rng.random(30), 1e-9 * rng.standard_normal(30))
    write_recording(tmp_path / 'data.csv', recording)
    again = read_recording(tmp_path / 'data.csv')
    for name in ('time', 'input', 'output'):
        np.testing.assert_allclose(getattr(again, name), getattr(recording, name), rtol=1e-8)


def test_other_columns_are_read_by_name_in_any_order(tmp_path):
    path = written(tmp_path, 'u, other, t, note', [f'{5.0 * t},{7.0},{t},good' for t in TIME])
    recording = read_recording(path, ['t', 'u', 'other'])
    np.testing.assert_allclose(recording.time, TIME)
    np.testing.assert_allclose(recording.input, 5.0 * TIME)
    assert np.all(recording.output == 7.0)


@pytest.mark.parametrize('header, rows, reason', [
    ('time_s,deflection_m', ['1,2'] * 30, 'expected charge_C once'),
    ('time_s,deflection_m,charge_C,extra', ['1,2,3,4'] * 30, 'column extra in addition'),
    ('', [], 'columns none'),
    (HEADER, ROWS[:9], '9 samples'),
    (HEADER, [*ROWS, '0.1,0.0,0.0'], r'time\[30\] is 0.1 after 0.29'),
    (HEADER, [*ROWS, '0.3,0.0'], 'line 32 has 2 fields, expected 3'),
    (HEADER, [*ROWS, '0.3,x,'], "line 32: deflection_m is 'x', charge_C is '', expected numbers"),
    ('Time,deflection_m,q', ROWS, 'expected time_s, charge_C once; name those to read'),
    (HEADER.replace(',', ';'), ROWS, "separated by ';', expected commas"),
    (HEADER, [*ROWS, '0.3,nan,0.0'], r'input\[30\] is nan')])
def test_an_invalid_file_is_refused_with_line_and_reason(tmp_path, header, rows, reason):
    with pytest.raises(ParameterError, match=f'data.csv: .*{reason}'):
        read_recording(written(tmp_path, header, rows))


def test_a_missing_or_binary_file_is_refused(tmp_path):
    with pytest.raises(ParameterError, match='nowhere.csv: cannot be read'):
        read_recording(tmp_path / 'nowhere.csv')
    (tmp_path / 'data.csv').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(ParameterError, match='not a text file'):
        read_recording(tmp_path / 'data.csv')
    with pytest.raises(ParameterError, match='expected time, input and output'):
        read_recording(written(tmp_path), ['time_s'])


def test_a_byte_order_mark_is_accepted(tmp_path):
    path = written(tmp_path)
    expected = read_recording(path).output
    path.write_bytes(b'\xef\xbb\xbf' + path.read_bytes())
    np.testing.assert_array_equal(read_recording(path).output, expected)


def test_a_late_byte_that_is_not_text_is_refused_in_one_line(tmp_path):
    path = written(tmp_path, rows=[f'{0.01 * number:.2f},0.0,0.0' for number in range(9000)])
    size = path.stat().st_size
    path.write_bytes(path.read_bytes() + b'90.0,\xe9,0.0\n')
    with pytest.raises(ParameterError, match=(
            f'data.csv: not a text file .*0xe9 in position {size + 5}:')) as refused:
        read_recording(path)
    assert '\n' not in str(refused.value)


def test_series_of_different_lengths_are_refused():
    with pytest.raises(ParameterError, match="differ: .*'output': 29"):
        FilmRecording(TIME, TIME, TIME[1:])
