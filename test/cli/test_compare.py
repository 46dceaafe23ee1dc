# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire compare``, and ``analyze`` of several bags: labels, references, files."""

from concurrent.futures import wait
import csv
from pathlib import Path
import shutil
import signal

import pytest

from smart_tire.cli.compare import labeled
from smart_tire.cli.main import main
from smart_tire.errors import ParameterError
from smart_tire.parameters import build, SimulatorParams
from smart_tire.samples import WheelCommand
from smart_tire.simulation.offline import simulate
from support.foreign import Foreign
from support.recordings import write_bag

FILES = {'comparison.csv', 'comparison.png', 'comparison.tex'}


def drive(seed):
    """Return the events of a short drive."""
    return simulate(build(SimulatorParams, {'film.wheels': ['front_left'], 'seed': seed}),
                    [(0.5, 100.0, 60.0)], 4.0)


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Return two bags, the second without ground truth."""
    folder = tmp_path_factory.mktemp('recorded')
    return (write_bag(folder / 'known', drive(2)),
            write_bag(folder / 'blind', [event for event in drive(2)
                                         if not event[1].startswith('ground_truth')]))


@pytest.fixture
def robots(tmp_path):
    """Return parameter files of two radii of the wheels."""
    paths = []
    for name, radius in (('right', 0.087), ('large', 0.1)):
        paths.append(tmp_path / f'{name}.yaml')
        paths[-1].write_text(f'/**: {{ros__parameters: {{wheel_radius: {radius}, '
                             'film: {wheels: [front_left]}}}')
    return paths


def compare(*words):
    return main(['compare', *map(str, words)])


def rows(folder):
    """Return label and method -> position error at the end [m]."""
    return {(row['run'], row['method']): row['pose.position_end_m'] and float(
        row['pose.position_end_m'])
        for row in csv.DictReader((folder / 'comparison.csv').open())}


def test_parameters_are_compared_on_one_bag(bags, robots, tmp_path, capsys):
    out, (right, large) = tmp_path / 'out', robots
    assert compare(bags[0], '--params', right, '--params', large, '--out', out, '--tum') == 0
    assert {path.name for path in out.iterdir()} == {'right', 'large', *FILES}
    assert {path.name for path in (out / 'large').iterdir()} == {'odom.tum', 'reference.tum'}
    found = rows(out)
    assert list(found) == [(label, method) for label in ('right', 'large') for method in (
        'estimate', 'gyroscope + wheels', 'wheels only')]
    assert found['right', 'estimate'] < found['large', 'estimate']
    printed = capsys.readouterr().out
    assert 'right:\n  parameters: ' in printed and 'alignment of the paths: start' in printed
    assert compare(bags[0], '--params', right, large, '--out', out) == 2
    assert 'comparison.csv exists' in capsys.readouterr().err


def test_analyses_are_read_with_the_reference_of_their_bag(bags, robots, tmp_path, capsys):
    known, blind = bags
    common = ['--params', robots[0], '--no-figures', '--no-checks']
    for bag in bags:
        assert main(['analyze', str(bag), *map(str, common), '--out',
                     str(tmp_path / bag.name)]) == 0
    capsys.readouterr()
    both = tmp_path / 'known', tmp_path / 'blind'
    assert compare(*both, '--out', tmp_path / 'a') == 0
    found = rows(tmp_path / 'a')
    assert found['known', 'estimate'] > 0.0 and found['blind', 'estimate'] == ''
    assert compare(*both, '--truth', known, '--out', tmp_path / 'b', '--align', 'se2') == 0
    found = rows(tmp_path / 'b')
    assert found['known', 'estimate'] == found['blind', 'estimate'] > 0.0
    shutil.copytree(tmp_path / 'known', tmp_path / 'moved')
    (tmp_path / 'moved' / 'summary.json').write_text('{"bag": "nowhere"}')
    assert compare(tmp_path / 'moved', '--out', tmp_path / 'c') == 0
    assert rows(tmp_path / 'c') == {('moved', 'estimate'): ''}
    (tmp_path / 'moved' / 'summary.json').write_text('{}')
    assert compare(tmp_path / 'moved') == 2
    assert 'summary.json: not the summary of an analysis' in capsys.readouterr().err


def test_topics_of_other_names_have_references_and_dead_reckoning_too(robots, tmp_path, capsys):
    topics = {'wheel_states': 'base/joint_states', 'wheel_commands': 'arm/joint_states',
              'ground_truth/odom': 'mocap/odom'}
    events = [(receive_ns, topic, sample) for received_ns, name, one in drive(2)
              for receive_ns, topic, sample in [(received_ns, name, one), *(
                  [(received_ns, 'wheel_commands', WheelCommand(one.stamp_ns, one.velocity))]
                  if name == 'wheel_states' else [])]]
    bag = Foreign(topics).write(tmp_path / 'bag', events)
    blind = Foreign(topics, omitted=['ground_truth/odom', 'ground_truth/wheel_slip']).write(
        tmp_path / 'blind', events)
    given = [f'{name}:=/{topics[name]}' for name in ('wheel_states', 'ground_truth/odom')]
    remap = [word for rule in given for word in ('--remap', rule)]
    methods = ['estimate', 'gyroscope + wheels', 'wheels only']
    assert compare(bag, *remap, '--params', robots[0], '--out', tmp_path / 'a') == 0
    found = rows(tmp_path / 'a')
    assert [method for _, method in found] == methods and all(found.values())
    assert compare(blind, *remap, '--params', robots[0], '--truth', bag, '--out',
                   tmp_path / 'b') == 0
    assert list(rows(tmp_path / 'b').values()) == pytest.approx(list(found.values()))
    assert main(['analyze', str(bag), *remap, '--params', str(robots[0]), '--no-figures', '--out',
                 str(tmp_path / 'analyzed')]) == 0
    assert compare(tmp_path / 'analyzed', '--out', tmp_path / 'c') == 0
    assert list(rows(tmp_path / 'c').values()) == pytest.approx(list(found.values()))


def test_several_bags_are_compared_by_analyze(bags, robots, tmp_path, capsys):
    words = [*map(str, bags), '--params', str(robots[0]), '--no-checks', '--csv']
    assert main(['analyze', *words, '--out', str(tmp_path / 'out')]) == 0
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {'known', 'blind', *FILES}
    assert {'odom.csv', 'wheel_slip.csv', 'path.png'} <= {
        path.name for path in (tmp_path / 'out' / 'blind').iterdir()}
    assert 'Errors of the runs' in capsys.readouterr().out
    assert main(['analyze', *words, '--out', str(tmp_path / 'out')]) == 2
    words += ['--out', str(tmp_path / 'out'), '--force', '--no-figures']  # each takes a second
    assert main(['analyze', *words]) == 0


def test_without_out_nothing_is_written(bags, robots, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob('*')), sorted(bags[0].parent.rglob('*'))
    assert compare(bags[0], '--params', robots[0]) == 0
    assert 'gyroscope + wheels' in capsys.readouterr().out
    assert compare(bags[0], '--params', robots[0], '--kitti') == 2
    assert '--kitti needs --out DIR' in capsys.readouterr().err
    assert (sorted(tmp_path.rglob('*')), sorted(bags[0].parent.rglob('*'))) == before


def test_a_bag_that_has_no_inputs_is_no_run(robots, tmp_path, capsys):
    empty = write_bag(tmp_path / 'empty', [])
    assert compare(empty, '--params', robots[0], '--out', tmp_path / 'out') == 1
    assert 'nothing can be estimated' in capsys.readouterr().out
    assert not (tmp_path / 'out').exists()


def test_labels_are_of_bags_files_or_both():
    a, b, robot, tuning = map(Path, ('x/a', 'y/b', 'robot.yaml', 'tuning.yaml'))
    assert labeled([a, b], []) == {'a': (a, []), 'b': (b, [])}
    assert labeled([a], [[robot], [robot, tuning]]) == {
        'robot': (a, [robot]), 'robot+tuning': (a, [robot, tuning])}
    assert list(labeled([a, b], [[robot], [tuning]])) == [
        'a robot', 'a tuning', 'b robot', 'b tuning']
    assert list(labeled([a, Path('z/a')], [])) == ['x', 'z']
    with pytest.raises(ParameterError, match='2 runs have the name a'):
        labeled([a, a], [])


def test_an_interrupt_leaves_no_files(bags, robots, tmp_path, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt
    out = tmp_path / 'out'
    monkeypatch.setattr('smart_tire.analysis.export.export', interrupt)
    assert compare(bags[0], '--params', robots[0], '--out', out, '--tum') == 130
    assert not out.exists()


def test_an_interrupt_while_bags_are_compared_leaves_no_files(
        bags, robots, tmp_path, monkeypatch):
    out = tmp_path / 'out'

    def interrupt(folder, *_, **__):
        (folder / 'comparison.csv').write_text('a part')
        raise KeyboardInterrupt
    monkeypatch.setattr('smart_tire.analysis.comparison.write_comparison', interrupt)
    assert main(['analyze', *map(str, bags), '--params', str(robots[0]), '--no-figures',
                 '--out', str(out)]) == 130
    assert not out.exists()


@pytest.mark.parametrize('mine', [False, True])
def test_an_interrupted_analysis_leaves_nothing_that_refuses_the_next(
        mine, bags, robots, tmp_path, monkeypatch):
    out, words = tmp_path / 'out', [*map(str, bags), '--params', str(robots[0]), '--out',
                                    str(tmp_path / 'out'), '--no-checks']

    def pause(folder, *_):
        if folder.name == 'blind':
            if mine:
                (out / 'known').mkdir(parents=True, exist_ok=True)
                (out / 'known' / 'notes.txt').write_text('mine')
            (tmp_path / 'paused').touch()
            signal.pause()  # until this process, which reads the bag, is ended
        return []

    def interrupted(running, **_):
        while not (tmp_path / 'paused').exists():
            if (found := wait(running, timeout=0.05)).done:
                return found
        raise KeyboardInterrupt
    with monkeypatch.context() as patch:
        patch.setattr('smart_tire.analysis.figures.write_figures', pause)
        patch.setattr('smart_tire.fleet.running.wait_for', interrupted)
        assert main(['analyze', *words]) == 130
    assert [path for path in out.rglob('*') if path.is_file()] == (
        [out / 'known' / 'notes.txt'] if mine else [])
    assert main(['analyze', *words, '--no-figures']) == 0
