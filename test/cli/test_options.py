# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Paths on the command line: inputs are checked, results replaced with --force only."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
import subprocess
import sys

import pytest
from smart_tire.bags import BagWriter
from smart_tire.cli import demo as demo_verb
from smart_tire.cli._options import BAGS, check_paths, FILES, OUTPUTS, RUNS
from smart_tire.cli._outputs import (
    FIGURES, lock, refuse_existing, refuse_existing_bag, refuse_folder_of_bag, remove, remove_bag)
from smart_tire.cli.main import main, new_parser
from smart_tire.errors import ParameterError

pytestmark = pytest.mark.processes

SLOW = ('numpy', 'scipy', 'matplotlib', 'rosbags', 'mcap', 'rclpy')
INPUTS = ('BAG', 'OTHER', 'DATA.csv', 'P')  # empty files: a verb that reads one first reports it
# Command line, existing file, and the path in the message.
CASES = {
    'demo, bag': (['demo', '--out', 'OUT'], 'OUT/bag/bag_0.mcap', 'OUT/bag'),
    'drive, figure': (['drive', '--path', 'square', '--out', 'OUT'], 'OUT/path.png',
                      'OUT/path.png'),
    'analyze, estimates': (['analyze', 'BAG', '--out', 'OUT'],
                           'OUT/estimates/estimates_0.mcap', 'OUT/estimates'),
    'analyze, smoothed': (['analyze', 'BAG', '--smooth', '--out', 'OUT'],
                          'OUT/smoothed/smoothed_0.mcap', 'OUT/smoothed'),
    'analyze, summary': (['analyze', 'BAG', '--no-figures', '--out', 'OUT'],
                         'OUT/summary.json', 'OUT/summary.json'),
    'analyze, one of two': (['analyze', 'BAG', 'OTHER', '--out', 'OUT'],
                            'OUT/OTHER/summary.json', 'OUT/OTHER/summary.json'),
    **{f'identify {kind}, {name}': (['identify', kind, 'BAG', '--out', 'OUT.yaml'], name, name)
       for kind in ('film', 'gains', 'geometry', 'icr', 'stiffness')
       for name in ('OUT.yaml', 'OUT.png')},
    'identify icr, default': (['identify', 'icr', 'BAG'], 'BAG_icr.yaml', 'BAG_icr.yaml'),
    'measure, default': (['measure', 'film', 'DATA.csv', '--params', 'P'],
                         'DATA_measured.png', 'DATA_measured.png'),
    'reproduce, figure': (['reproduce', '--out', 'OUT'], 'OUT/paper_a_fig_4.png',
                          'OUT/paper_a_fig_4.png'),
    'record': (['record', '--out', 'OUT'], 'OUT/OUT_0.mcap', 'OUT'),
    'recover': (['recover', 'BAG', '--out', 'OUT'], 'OUT/OUT_0.mcap', 'OUT'),
    'recover, default': (['recover', 'BAG'], 'BAG_recovered/BAG_recovered_0.mcap',
                         'BAG_recovered'),
}

every_case = pytest.mark.parametrize(('words', 'file', 'named'), CASES.values(), ids=CASES)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Return a working directory that contains the inputs only."""
    monkeypatch.chdir(tmp_path)
    for name in INPUTS:
        (tmp_path / name).touch()
    return tmp_path


def make(path, text='mine'):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@every_case
def test_an_existing_result_is_kept_and_named_in_one_line(words, file, named, here, capsys):
    make(here / file)
    before = sorted(here.rglob('*'))
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'smart_tire {words[0]}: ')
    assert f'{named} exists' in line and '--force' in line
    assert sorted(here.rglob('*')) == before
    assert (here / file).read_text() == 'mine'


@pytest.mark.parametrize('case', [
    'demo, bag', 'analyze, summary', 'identify film, OUT.yaml', 'identify gains, OUT.yaml',
    'measure, default', 'reproduce, figure', 'record', 'recover'])
def test_existing_results_are_detected_before_slow_imports(case, here):
    words, file, _ = CASES[case]
    make(here / file)
    code = ('import sys; from smart_tire.cli.main import main\n'
            f'assert main({words}) == 2\n'
            f'assert not {set(SLOW)} & set(sys.modules), set(sys.modules)')
    subprocess.run([sys.executable, '-c', code], check=True, cwd=here,
                   env={'PYTHONPATH': ':'.join(filter(None, sys.path))})


def test_inputs_are_not_replaced_even_with_force(here):
    data = make(here / 'data.csv')
    with pytest.raises(ParameterError, match='is an input'):
        refuse_existing([here / 'new', here / 'sub' / '..' / 'data.csv'], force=True,
                        inputs=[data])
    refuse_existing([here / 'new'], force=False, inputs=[data])


def test_a_dangling_link_counts_as_existing(here):
    (here / 'link').symlink_to(here / 'nowhere')
    with pytest.raises(ParameterError, match='link exists'):
        refuse_existing([here / 'link'], force=False)


def test_a_bag_is_removed_completely(here):
    with BagWriter(here / 'bag'):
        make(here / 'bag' / 'bag_1.mcap')  # of a long recording
    refuse_existing_bag(here / 'bag', force=True)
    remove_bag(here / 'bag')
    assert not (here / 'bag').exists()
    remove_bag(here / 'bag')  # nothing to do


@pytest.mark.parametrize('name', ['notes.txt', 'bag_x.mcap', 'bag_0.db3', 'other_0.mcap'])
def test_a_folder_with_other_files_is_rejected_even_with_force(name, here):
    with BagWriter(here / 'bag'):
        pass
    make(here / 'bag' / name)
    with pytest.raises(ParameterError, match=f'contains {name}'):
        refuse_existing_bag(here / 'bag', force=True)


def test_a_file_instead_of_a_bag_is_rejected_even_with_force(here):
    with pytest.raises(ParameterError, match='is a file'):
        refuse_existing_bag(make(here / 'bag'), force=True)


def test_only_named_files_and_empty_folders_are_deleted(here):
    make(here / 'figures' / 'slip.png')
    notes = make(here / 'figures' / 'notes.txt')
    remove(here / 'figures', FIGURES)
    assert sorted((here / 'figures').iterdir()) == [notes]
    notes.unlink()
    remove(here / 'figures', FIGURES)
    assert not (here / 'figures').exists()


def test_a_folder_instead_of_a_file_is_an_error_in_one_line(here):
    (here / 'figures' / 'slip.png').mkdir(parents=True)
    with pytest.raises(ParameterError, match='cannot be replaced'):
        remove(here / 'figures', FIGURES)


@pytest.mark.parametrize(('bag', 'out'), [
    ('drive', 'drive'), ('drive', 'drive/results'), ('drive', 'drive/../drive/a/b'),
    ('drive/drive_0.mcap', 'drive'), ('drive/drive_0.mcap', 'drive/results'),
    ('lone/file.mcap', 'lone')])
def test_the_folder_of_a_bag_is_rejected(bag, out, here):
    make(here / 'drive' / 'drive_0.mcap')
    make(here / 'drive' / 'metadata.yaml')
    make(here / 'lone' / 'file.mcap')
    with pytest.raises(ParameterError, match='is in the folder of the bag'):
        refuse_folder_of_bag(here / out, [here / 'lone' / 'nowhere', here / bag])


@pytest.mark.parametrize(('bag', 'out'), [
    ('drive', 'results'), ('drive', 'drive2'), ('lone/file.mcap', 'lone/results')])
def test_a_folder_next_to_a_bag_is_accepted(bag, out, here):
    make(here / 'drive' / 'metadata.yaml')
    make(here / 'lone' / 'file.mcap')
    refuse_folder_of_bag(here / out, [here / bag])


def test_the_demo_deletes_its_own_files_only(here):
    own = [make(here / 'out' / name) for name in (
        'summary.json', 'conversions.csv', 'demo.yaml', 'figures/slip.png', 'figures/crossing.png',
        'logs/recorder.log', 'logs/imu_driver.log', 'ports/imu', 'bag/bag_0.mcap',
        'bag/metadata.yaml')]
    others = [make(here / 'out' / name) for name in (
        'notes.txt', 'figures/mine.png', 'logs/mine.log', 'more/summary.json')]
    params = demo_verb._prepare(here / 'out', 1)
    assert 'seed: 1' in params.read_text()
    assert {path for path in own if path.exists()} == {params}
    assert all(path.read_text() == 'mine' for path in others)
    assert not (here / 'out' / 'bag').exists()


def path_arguments(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield the names of the arguments of all verbs, and of their kinds, that are paths."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for kind in action.choices.values():
                yield from path_arguments(kind)
        elif action.type is Path:
            yield action.dest


def test_every_path_is_checked():
    assert set(path_arguments(new_parser())) <= {*BAGS, *RUNS, *FILES, *OUTPUTS}


def checked(**arguments):
    """Return the arguments after the check."""
    args = argparse.Namespace(**arguments)
    check_paths(args)
    return vars(args)


@pytest.fixture
def demo(tmp_path):
    """Return a folder with one bag below."""
    (tmp_path / 'demo' / 'bag').mkdir(parents=True)
    (tmp_path / 'demo' / 'bag' / 'metadata.yaml').touch()
    return tmp_path / 'demo'


def test_bags_in_folders_are_found_and_named_in_a_line_each(demo, capsys):
    bag = demo / 'bag'
    found = checked(bag=demo, bags=[bag, demo], lifted=[demo], rate=2.0, params=[], out=None)
    assert found == {'bag': bag, 'bags': [bag, bag], 'lifted': [bag], 'rate': 2.0,
                     'params': [], 'out': None}
    out, err = capsys.readouterr()
    assert out == ''
    assert err.splitlines() == [f'{demo}: reading the bag {bag}'] * 3


@pytest.mark.parametrize('name', ['params', 'data'])
def test_files_must_exist_given_alone_or_in_a_list(name, demo):
    file = demo / 'bag' / 'metadata.yaml'
    assert checked(**{name: file}) == {name: file}
    assert checked(**{name: [file]}) == {name: [file]}
    for missing in (demo / 'none', [file, demo / 'none']):
        with pytest.raises(ParameterError, match='none: cannot be read .No such file'):
            checked(**{name: missing})


def test_the_output_must_be_writable(demo):
    with pytest.raises(ParameterError, match='is not a folder'):
        checked(out=demo / 'bag' / 'metadata.yaml' / 'out')


@pytest.mark.parametrize('words', [
    ['analyze', 'nonsuch', '--out', 'x'], ['replay', 'nonsuch'], ['recover', 'nonsuch'],
    ['identify', 'film', 'nonsuch'], ['identify', 'icr', 'nonsuch'],
    ['measure', 'film', 'nonsuch', '--params', 'nonsuch'],
    ['analyze', '.', '--params', 'nonsuch', '--out', 'x']])
def test_a_wrong_path_is_reported_before_anything_slow_is_imported(words, demo):
    code = ('import sys; from smart_tire.cli.main import main; status = main(sys.argv[1:])\n'
            f'print(status, [name for name in {SLOW} if name in sys.modules])')
    done = subprocess.run([sys.executable, '-c', code, *words], capture_output=True, text=True,
                          check=True, cwd=demo)
    assert done.stdout == '2 []\n'
    assert 'nonsuch: ' in done.stderr
    assert 'no such file or directory' in done.stderr.lower()


def test_a_folder_has_one_run_at_a_time(here):
    """Also after the results of an earlier one, all that was in it, have been deleted."""
    first = ('import pathlib, sys\nfrom smart_tire.cli._outputs import lock, remove\n'
             'out = pathlib.Path("out")\nlock(out)\n(out / "a").touch()\n'
             'remove(out, ["a"], keep=True)\nprint("ready", flush=True)\nsys.stdin.read()')
    second = ('import pathlib\nfrom smart_tire.cli._outputs import lock\n'
              'lock(pathlib.Path("out"))')
    with subprocess.Popen([sys.executable, '-c', first], stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == 'ready\n'
        other = subprocess.run([sys.executable, '-c', second], capture_output=True, text=True)
        process.stdin.close()
    assert 'another run writes to out: choose another --out' in other.stderr
    assert subprocess.run([sys.executable, '-c', second]).returncode == 0


def test_a_folder_that_cannot_be_locked_is_named(here):
    Path('file').touch()
    with pytest.raises(ParameterError, match='file/out: cannot be written'):
        lock(Path('file', 'out'))
