# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The command line of ``smart_tire analyze``: grammar, files and exit status."""

import json
from pathlib import Path

from benchmarks.wrong_data import VARIANTS
import pytest

from smart_tire.cli._outputs import folder_names
from smart_tire.cli.main import main
from smart_tire.parameters import build, RobotParams, SimulatorParams
from smart_tire.samples import GRAVITY, ImuSample, STOPPED, WheelSample
from smart_tire.simulation.offline import simulate
from support.recordings import START_NS, write_bag

ONE_WHEEL = {'film.wheels': ['front_left'], 'seed': 2}


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Return the bag of a short drive."""
    return write_bag(tmp_path_factory.mktemp('recorded') / 'drive', simulate(
        build(SimulatorParams, ONE_WHEEL), [(0.5, 100.0, 60.0)], 4.0))


@pytest.fixture
def robot(tmp_path):
    """Return a parameter file that fits the drive."""
    path = tmp_path / 'robot.yaml'
    path.write_text('/**: {ros__parameters: {wheel_radius: 0.087, film: {wheels: [front_left]}}}')
    return path


def analyze(*words):
    return main(['analyze', *map(str, words)])


def test_the_smoother_has_its_own_bag_and_report(bag, robot, tmp_path, capsys):
    out = tmp_path / 'out'
    assert analyze(bag, '--params', robot, '--out', out, '--smooth') == 0
    assert {path.name for path in out.iterdir()} >= {
        'estimates', 'smoothed', 'summary.json', 'slip.png', 'path.png', 'friction.png'}
    output = capsys.readouterr().out
    assert output.count('position error, rms [m]') == 2 and 'RTS smoother' in output


def test_several_bags_have_a_folder_each(bag, robot, tmp_path):
    other = tmp_path / 'again'
    other.symlink_to(bag / 'drive_0.mcap')
    out = tmp_path / 'out'
    copy = tmp_path / 'copy'
    copy.mkdir()
    (copy / 'copy_0.mcap').write_bytes((bag / 'drive_0.mcap').read_bytes())
    assert analyze(bag, copy, '--params', robot, '--no-figures', '--out', out) == 0
    assert sorted(path.name for path in out.iterdir()) == [
        'comparison.csv', 'comparison.tex', 'copy', 'drive']
    assert sorted(path.name for path in (out / 'copy').iterdir()) == ['estimates', 'summary.json']


def test_without_out_results_are_next_to_the_bag(robot, tmp_path, bag):
    copy = tmp_path / 'here' / 'copy'
    copy.mkdir(parents=True)
    for file in bag.iterdir():
        (copy / file.name).write_bytes(file.read_bytes())
    words = ['--params', robot, '--no-figures']
    assert analyze(copy, *words) == 0
    assert sorted(path.name for path in (tmp_path / 'here' / 'copy_analyzed').iterdir()) == [
        'estimates', 'summary.json']
    assert analyze(copy / 'drive_0.mcap', *words) == 2  # the same folder
    assert analyze(copy / 'drive_0.mcap', *words, '--force') == 0
    assert sorted(path.name for path in (tmp_path / 'here').iterdir()) == [
        'copy', 'copy_analyzed']


def test_results_are_in_the_folder_and_replaced_with_force_only(bag, robot, tmp_path, capsys):
    out, words = tmp_path / 'out', [bag, '--params', robot, '--out', tmp_path / 'out']
    assert analyze(*words) == 0
    assert {path.name for path in out.iterdir()} >= {
        'estimates', 'summary.json', 'slip.png', 'path.png', 'friction.png'}
    assert json.loads((out / 'summary.json').read_text())['bag'] == str(bag)
    assert 'position error' in capsys.readouterr().out
    written = {path: path.stat().st_mtime_ns for path in out.rglob('*.*')}
    (out / 'notes.txt').write_text('mine')
    assert analyze(*words) == 2
    assert 'out/estimates exists' in capsys.readouterr().err
    assert {path: path.stat().st_mtime_ns for path in written} == written
    assert analyze(*words, '--force') == 0
    assert all(path.stat().st_mtime_ns > before for path, before in written.items())
    assert (out / 'notes.txt').read_text() == 'mine'


@pytest.mark.parametrize('force', [[], ['--force']])
@pytest.mark.parametrize('out', ['', 'results'])
def test_nothing_is_ever_written_into_the_folder_of_a_bag(bag, out, force, capsys):
    before = sorted(bag.rglob('*'))
    assert analyze(bag, '--out', bag / out, *force) == 2
    assert 'is in the folder of the bag' in capsys.readouterr().err
    assert analyze(bag / 'drive_0.mcap', '--out', bag / out, *force) == 2
    assert analyze(bag, 'other', '--out', bag.parent, *force) == 2  # bag.parent / 'drive'
    assert sorted(bag.rglob('*')) == before


def test_a_bag_without_inputs_gives_status_one_and_the_others_are_analyzed(
        bag, robot, tmp_path, capsys):
    empty = write_bag(tmp_path / 'empty', [])
    assert analyze(empty, bag, '--params', robot, '--no-figures', '--out', tmp_path / 'out') == 1
    output = capsys.readouterr().out
    assert f'{empty}: nothing can be estimated without imu/data and wheel_states' in output
    assert (tmp_path / 'out' / 'drive' / 'summary.json').exists()


@pytest.mark.parametrize('verb', ['analyze', 'compare', 'report'])
def test_of_a_bag_that_is_too_short_nothing_is_written_and_what_it_lacks_is_said(
        verb, tmp_path, capsys):
    short = write_bag(tmp_path / 'short', [
        (START_NS, 'imu/data', ImuSample(START_NS, (0.0, 0.0, GRAVITY), (0.0, 0.0, 0.0))),
        (START_NS + 1, 'wheel_states', WheelSample(START_NS + 1, STOPPED))])
    assert main([verb, str(short), '--out', str(tmp_path / 'out')]) == 1
    output = capsys.readouterr().out
    assert f'{short}: nothing can be estimated' in output
    assert '  skipped: tire_samples is not in the bag: no tire_friction' in output
    assert not (tmp_path / 'out').exists()


def test_a_damaged_bag_gives_status_two_and_the_others_are_analyzed(
        bag, robot, tmp_path, capsys):
    out, damaged = tmp_path / 'out', tmp_path / 'damaged.mcap'
    damaged.write_text('no bag')
    assert analyze(damaged, bag, '--params', robot, '--no-figures', '--out', out) == 2
    assert 'damaged.mcap: not an MCAP file' in capsys.readouterr().err
    assert (out / 'drive' / 'summary.json').exists()


@pytest.fixture(scope='module')
def degrees(tmp_path_factory):
    """Return the bag of a drive with curves, its gyro in deg/s."""
    events = simulate(build(SimulatorParams, {**ONE_WHEEL, 'ground.base': 'concrete'}), [
        (0.5, 90.0, 90.0), (2.0, 100.0, 60.0), (4.0, 40.0, 80.0), (6.0, 0.0, 0.0),
        (7.0, -60.0, -80.0), (9.0, 0.0, 0.0)], 10.0)
    return write_bag(tmp_path_factory.mktemp('wrong') / 'degrees',
                     VARIANTS['gyro in deg/s'].change(events, RobotParams()))


@pytest.mark.parametrize('verb, out', [('analyze', 'out'), ('report', 'out.html')])
def test_an_estimate_that_diverges_is_no_result(verb, out, degrees, robot, tmp_path, capsys):
    words = ['--params', str(robot), '--out', str(tmp_path / out)]
    words += ['--no-figures'] if verb == 'analyze' else []
    assert main([verb, str(degrees), *words]) == 1
    lines = capsys.readouterr().out.splitlines()
    error, = (line for line in lines if line.startswith('error: '))
    assert 'imu/data: yaw rate is' in error and 'in deg/s' in error
    assert lines.index(error) <= 2
    assert 'the estimate diverges from' in lines[-1] and 'expected at most 2.' in lines[-1]
    if verb == 'report':
        page = (tmp_path / out).read_text()
        assert 'Error in the recording: imu/data' in page and 'diverges from' in page
        return
    summary = json.loads((tmp_path / out / 'summary.json').read_text())
    assert summary['diverged'] in lines[-1]
    assert [one['where'] for one in summary['findings'] if one['level'] == 'error'] == [
        'imu/data']
    assert analyze(degrees, '--no-checks', '--force', *words) == 1
    output = capsys.readouterr().out
    assert 'error: ' not in output and 'the estimate diverges from' in output


@pytest.mark.parametrize('verb, out', [('analyze', 'out'), ('report', 'out.html')])
def test_results_that_the_checks_contradict_are_kept_with_status_four(verb, out, bag, tmp_path):
    words = [verb, str(bag), '--out', str(tmp_path / out), '--force']
    words += ['--no-figures'] if verb == 'analyze' else []
    assert main(words) == 4  # nothing gives the wheel radius
    if verb == 'analyze':
        found, = (one for one in json.loads((tmp_path / out / 'summary.json').read_text())[
            'findings'] if one['level'] == 'error')
        assert found['where'] == 'wheel_radius' and 'not given' in found['found']
        assert set(found) == {'level', 'where', 'found', 'expected', 'action'}
    else:
        notes = (tmp_path / out).read_text().partition('class="notes"')[2]
        assert notes.partition('<p>')[2].startswith('Error in the recording: wheel_radius: not')
    assert main([*words, '--no-checks']) == 0


def test_bags_of_the_same_name_in_several_folders_are_named_by_the_folders():
    assert folder_names([Path('a/bag'), Path('b/bag'), Path('b/c')]) == ['bag', 'bag', 'c']
    assert folder_names([Path('a/bag'), Path('b/bag')]) == ['a', 'b']
    assert folder_names([Path('a/out/bag'), Path('b/out/bag')]) == ['a', 'b']
    assert folder_names([Path('a/bag'), Path('a/bag')]) == ['bag', 'bag']
    assert folder_names([Path('a/first'), Path('a/second.mcap')]) == ['first', 'second']


@pytest.mark.parametrize('text, message', [
    ('/**: {ros__parameters: {wheel_radius: -1.0}}', 'wheel_radius'),
    ('/**: {ros__parameters: {wheel_radios: 1.0}}', 'did you mean wheel_radius'),
    ('nonsense', 'ros__parameters')])
def test_an_invalid_parameter_file_gives_status_two(bag, tmp_path, capsys, text, message):
    path = tmp_path / 'bad.yaml'
    path.write_text(text)
    assert analyze(bag, '--params', path, '--out', tmp_path / 'out') == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()
