# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire design``: results, files and refusals."""

import csv
import json

import pytest
from smart_tire.cli.main import main
from smart_tire.design import search

DRIVE = 'time_s,left_rpm,right_rpm\n0.5,60,80\n5,60,80\n'


@pytest.fixture
def few(monkeypatch):
    """Let each property have one or two values, as a run of minutes is too long here."""
    monkeypatch.setattr(search, 'AXES', {
        name: (first, step, 1 + (name == 'wheels'), factor, label)
        for name, (first, step, _, factor, label) in search.AXES.items()})
    monkeypatch.setattr(search, 'FACTORS', (1.0,))


def test_the_best_layout_is_printed_and_written(few, tmp_path, capsys):
    (tmp_path / 'drive.csv').write_text(DRIVE)
    out = tmp_path / 'out'
    command = ['design', '--ground', '0.5,60,0.02', '--drive', str(tmp_path / 'drive.csv'),
               '--films', '2', '--rate', '300', '--budget', '9', '--out', str(out)]
    assert main(command) == 0
    printed = capsys.readouterr().out
    found = json.loads((out / 'summary.json').read_text())
    assert [row['name'] for row in found['layouts']] == ['none', 'robot', '1 x 1', '2 x 1']
    none, robot, _, two = found['layouts']
    assert none['friction'] > robot['friction'] > two['friction']
    assert none['film_slip'] is None  # no films
    assert two['radio_load'] <= 9000.0 * (1.0 + 1e-6) and two['rate'] <= 300.0
    assert found['best'] == {name: two[name] for name in found['best']}
    assert found['cases'][0]['ground'] == {
        'name': '0.5,60,0.02', 'stiffness': 60.0, 'friction': 0.5, 'drag': 0.02}
    assert found['cases'][0]['drive']['duration'] == 5.0
    line = next(line for line in printed.splitlines() if line.endswith('best'))
    assert line.startswith('2 x 1') and f'{100.0 * two["friction"]:.2f} %' in line
    assert f'friction: {two["friction"] / robot["friction"]:.3f} times' in printed
    rows = list(csv.DictReader((out / 'layouts.csv').open()))
    assert float(rows[3]['friction']) == pytest.approx(two['friction'], rel=1e-5)
    changes = list(csv.DictReader((out / 'sensitivity.csv').open()))
    assert {row['property'] for row in changes} == {
        *search.AXES, 'wheel_speed', 'tire_length', 'tire_stiffness'}
    assert (out / 'design_maps.png').stat().st_size > 10_000
    assert main(command) == 2  # exists
    assert '--force' in capsys.readouterr().err


def test_another_quantity_without_maps_and_torque(few, tmp_path, capsys):
    assert main(['design', '--ground', 'concrete', '--quantity', 'slip', '--no-maps',
                 '--no-torque', '--films', '1', '--out', str(tmp_path)]) == 0
    assert 'slip: ' in capsys.readouterr().out
    assert not (tmp_path / 'design_maps.png').exists()


@pytest.mark.parametrize(('arguments', 'message'), [
    (['--ground', 'snow'], '--ground snow: expected MU,C_X,DRAG'),
    (['--ground', '0.5,60'], 'MU,C_X,DRAG'),
    (['--ground', '0.5,nan,0.01'], 'MU,C_X,DRAG'),
    (['--ground', '0,60,0.01'], 'MU,C_X,DRAG'),
    (['--drive', 'spin'], '--drive spin: no such file, and not one of turn, fast_turn'),
    (['--films', '0'], 'invalid count value'),
    (['--rate', '-5'], 'invalid positive value'),
    (['--params', 'missing.yaml'], 'missing.yaml')])
def test_wrong_arguments_are_refused(arguments, message, tmp_path, capsys):
    try:
        status = main(['design', *arguments, '--out', str(tmp_path / 'out')])
    except SystemExit as stop:
        status = stop.code
    error = capsys.readouterr().err
    assert status == 2 and message in error and 'Traceback' not in error
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize(('text', 'message'), [
    (DRIVE.replace('rpm', 'rad_s'), 'expected left_rpm'),
    (DRIVE.replace('0.5,60', '0.5,fast'), "left_rpm is 'fast'"),
    (DRIVE.replace('5,60,80\n', '4,60,80\n', 2), 'an end at 5 to 60 s'),
    ('time_s,left_rpm,right_rpm\n9,60,80\n5,60,80\n', 'times that increase'),
    (DRIVE.replace('60,80\n5', 'inf,80\n5'), 'finite numbers'),
    ('time_s,left_rpm,right_rpm\n', 'expected finite numbers')])
def test_a_wrong_drive_is_refused(text, message, tmp_path, capsys):
    (tmp_path / 'drive.csv').write_text(text)
    assert main(['design', '--drive', str(tmp_path / 'drive.csv'),
                 '--out', str(tmp_path / 'out')]) == 2
    assert message in capsys.readouterr().err


def test_a_robot_without_films_is_refused(tmp_path, capsys):
    (tmp_path / 'robot.yaml').write_text(
        '/**:\n  ros__parameters:\n    film:\n      wheels: []\n')
    assert main(['design', '--params', str(tmp_path / 'robot.yaml'),
                 '--out', str(tmp_path / 'out')]) == 2
    assert 'film.wheels is empty' in capsys.readouterr().err
