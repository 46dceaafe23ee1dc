# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of a film from simulated and real recordings, and their file."""

from dataclasses import replace

import numpy as np
import pytest

from smart_tire.errors import EstimatorError, ParameterError
from smart_tire.estimation.film.calibration import PRODUCTS, read_params
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.models.film.hysteresis import monotone_branches, relaxed
from smart_tire.papers.film_bench import identify_film, write_params
from smart_tire.papers.film_files import COLUMNS, FilmRecording, read_recording
from smart_tire.papers.film_measurement import smoothed
from support.film_bench import one_loop, several_loops, TRUE, write_recording
from support.real_recordings import real_recording
import yaml

FILM = FILMS['25x3']
TIME = np.arange(30) * 0.01
HEADER = ','.join(COLUMNS)
ROWS = [f'{t:.2f},{0.001 * t},{-1e-9 * t}' for t in TIME]


@pytest.fixture(scope='module')
def identified():
    return identify_film(several_loops(), FILM)


def test_the_bench_is_identified_without_notes(identified):
    params, _, notes = identified
    assert notes == []
    for name in PRODUCTS:
        assert getattr(params, name) == pytest.approx(TRUE[name], rel=0.02)
    assert params.noise == pytest.approx(0.02e-9, rel=0.1)
    assert params.model_error < 0.3 * params.noise


def test_the_file_round_trip_keeps_all_parameters(identified, tmp_path):
    params, fit, notes = identified
    write_params(tmp_path / 'film.yaml', params, fit, notes, gain=34.47e-9)
    again = read_params(tmp_path / 'film.yaml')
    np.testing.assert_array_equal(again.covariance, params.covariance)
    assert again.film == params.film and again.operator == params.operator
    assert (again.low_corner, again.drift, again.noise, again.model_error) == (
        params.low_corner, params.drift, params.noise, params.model_error)
    at_gain = yaml.safe_load((tmp_path / 'film.yaml').read_text())['at_gain']
    assert [at_gain[name] for name in ('alpha', 'a', 'b')] == pytest.approx(
        [0.15e9, 0.54, 0.28], rel=0.02)


def test_a_loop_that_is_too_small_gets_a_note():
    _, fit, notes = identify_film(one_loop(0.0005), FILM)
    assert any('not determined: alpha_gain' in note and 'b_gain only' in note for note in notes)
    assert abs(fit.b_gain.value - TRUE['b_gain']) < 4.0 * fit.b_gain.sigma


def test_strokes_of_one_size_get_a_note():
    note = 'all strokes are of one size'
    assert any(note in one for one in identify_film(one_loop(), FILM)[2])
    both = several_loops()
    half = both.time.size // 2
    assert not any(note in one for one in identify_film(FilmRecording(
        both.time[:half], both.input[:half], both.output[:half]), FILM)[2])


def test_tension_spikes_and_a_touching_film_get_notes():
    recording = several_loops()
    deflection, output = recording.input.copy(), recording.output.copy()
    tension = slice(2490, 2511)  # around a time when the film is flat
    deflection[tension], output[tension] = -1e-4, 5e-9
    deflection[1000] += 0.01
    params, _, notes = identify_film(FilmRecording(recording.time, deflection, output), FILM)
    assert any('film under tension' in note for note in notes)
    assert any('1 spikes' in note for note in notes)
    assert params.b_gain == pytest.approx(TRUE['b_gain'], rel=0.03)
    _, _, notes = identify_film(recording, replace(FILM, length=0.0135))
    assert any('touches itself' in note for note in notes)


def test_a_deflection_of_the_opposite_sign_is_refused_with_the_reason():
    recording = one_loop()
    mirrored = FilmRecording(recording.time, -recording.input, recording.output)
    with pytest.raises(EstimatorError, match='deflections are negative'):
        identify_film(mirrored, FILM)


def test_a_real_piezo_stage_is_described_to_a_few_percent():
    loop = read_recording(real_recording('piezo_loop/loop.csv'), ['t', 'input', 'output'])
    params, fit, notes = identify_film(loop, None)
    assert fit.share < 0.03
    # its narrow loop makes the slope after a reversal observable, but not alpha and a
    assert fit.b_gain.determined and 11.0 < params.b_gain < 13.5
    assert any('not determined' in note for note in notes)
    assert any('times the noise' in note for note in notes)
    with pytest.raises(ParameterError, match='a > b >= a / 2'):
        _ = params.operator


def test_the_charge_of_the_unseen_half_of_a_real_loop_is_predicted():
    loop = read_recording(real_recording('piezo_loop/loop.csv'), ['t', 'input', 'output'])
    half, (u, _) = loop.time.size // 2, smoothed(loop.input)
    params, _, _ = identify_film(
        FilmRecording(loop.time[:half], loop.input[:half], loop.output[:half]), None)
    branches = monotone_branches(np.concatenate([u[:1], u]), 0.01 * np.ptp(u))
    alpha, a, b = params.alpha_gain, params.a_gain, params.b_gain
    known = a * u + relaxed(np.concatenate([u[:1], u]), branches, alpha, (a - b) / alpha, 0.0)
    first = relaxed(np.concatenate([u[:1], u]), branches, alpha, 0.0, 1.0)
    fits = {'duhem': (known, np.column_stack([first, np.ones(u.size)])),
            'linear': (0.0 * u, np.column_stack([u, np.ones(u.size)]))}
    error = {}
    for name, (given, free) in fits.items():
        factors = np.linalg.lstsq(free[:half], (loop.output - given)[:half], rcond=None)[0]
        residual = (loop.output - given - free @ factors)[half:]
        error[name] = np.sqrt(np.mean(residual**2)) / np.ptp(loop.output[half:])
    assert error['duhem'] < 0.015 and error['linear'] > 0.06


@pytest.mark.parametrize('change, why', [
    (lambda tree: tree.pop('products'), 'products is missing'),
    (lambda tree: tree['products'].pop('a_gain'), 'a_gain is missing'),
    (lambda tree: tree['amplifier'].pop('drift'), 'drift is missing'),
    (lambda tree: tree.update(noise='much'), 'much'),
    (lambda tree: tree.update(covariance=[[1.0]]), '5 x 5'),
    (lambda tree: tree['film'].update(length_m=-1.0), 'length is -1'),
    (lambda tree: tree['products'].update(a_gain=3.0), 'a_gain|float')])
def test_a_broken_file_is_refused_with_the_reason(identified, tmp_path, change, why):
    path = tmp_path / 'film.yaml'
    write_params(path, *identified)
    tree = yaml.safe_load(path.read_text())
    change(tree)
    path.write_text(yaml.safe_dump(tree))
    with pytest.raises(ParameterError, match=f'film.yaml: .*({why})'):
        read_params(path)


def test_a_missing_or_invalid_file_is_refused(tmp_path):
    with pytest.raises(ParameterError, match='cannot be read'):
        read_params(tmp_path / 'film.yaml')
    (tmp_path / 'film.yaml').write_text('{')
    with pytest.raises(ParameterError, match='not valid YAML'):
        read_params(tmp_path / 'film.yaml')
    with pytest.raises(ParameterError, match='film.yaml'):
        (tmp_path / 'film.yaml').write_text('')
        read_params(tmp_path / 'film.yaml')


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
