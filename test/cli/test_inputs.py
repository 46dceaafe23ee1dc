# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Paths on the command line: checked for every verb before its slow imports."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
import subprocess
import sys

import pytest

from smart_tire.cli._options import BAGS, check_paths, FILES, OUTPUTS
from smart_tire.cli.main import new_parser, VERBS
from smart_tire.errors import BagError, ParameterError

SLOW = ('numpy', 'scipy', 'matplotlib', 'rosbags', 'mcap', 'rclpy')


def path_arguments(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield the names of the arguments of a verb, and of its kinds, that are paths."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for kind in action.choices.values():
                yield from path_arguments(kind)
        elif action.type is Path:
            yield action.dest


@pytest.mark.parametrize('verb', VERBS)
def test_every_path_is_checked(verb):
    assert set(path_arguments(new_parser(verb))) <= {*BAGS, *FILES, *OUTPUTS}


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
        with pytest.raises(ParameterError, match='none: no such file'):
            checked(**{name: missing})


def test_the_output_must_be_writable(demo):
    with pytest.raises(ParameterError, match='is not a folder'):
        checked(out=demo / 'bag' / 'metadata.yaml' / 'out')


def test_a_bag_is_checked_before_parameters_and_output(demo):
    with pytest.raises(BagError):
        checked(out=demo / 'bag' / 'metadata.yaml' / 'out', params=[demo / 'none'],
                bags=[demo / 'none'])


@pytest.mark.parametrize('words', [
    ['analyze', 'nonsuch', '--out', 'x'], ['replay', 'nonsuch'], ['recover', 'nonsuch'],
    *(['identify', kind, 'nonsuch'] for kind in (
        'film', 'gains', 'geometry', 'icr', 'motor', 'stiffness')),
    ['measure', 'film', 'nonsuch', '--params', 'nonsuch'],
    ['analyze', '.', '--params', 'nonsuch', '--out', 'x']])
def test_a_wrong_path_is_reported_before_anything_slow_is_imported(words, demo):
    code = ('import sys; from smart_tire.cli.main import main; status = main(sys.argv[1:])\n'
            f'print(status, [name for name in {SLOW} if name in sys.modules])')
    done = subprocess.run([sys.executable, '-c', code, *words], capture_output=True, text=True,
                          check=True, cwd=demo)
    assert done.stdout == '2 []\n'
    assert 'nonsuch: no such file' in done.stderr
