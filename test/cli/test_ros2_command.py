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

"""``ros2 smart_tire``: the interface that ros2cli expects."""

from __future__ import annotations

import argparse

import pytest

from smart_tire.cli import recover
from smart_tire.cli.main import SmartTireCommand, VERBS


def parsed(*words, argv=None):
    """Parse a command line as ros2cli does."""
    parser = argparse.ArgumentParser(prog='ros2')
    extension = SmartTireCommand()
    command = parser.add_subparsers().add_parser('smart_tire')
    extension.add_arguments(command, 'ros2 smart_tire', argv=argv or ['ros2', *words])
    return extension, parser, parser.parse_args(words)


def test_a_verb_is_run_with_its_arguments(monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr(recover, 'run', lambda args: seen.append(args) or 3)
    bag = tmp_path / 'drive.mcap'
    bag.touch()
    extension, parser, args = parsed('smart_tire', 'recover', str(bag), '--force')
    assert extension.main(parser=parser, args=args) == 3
    (given,) = seen
    assert (given.bag, given.force) == (bag, True)


def test_errors_are_printed_in_one_line(capsys):
    extension, parser, args = parsed('smart_tire', 'recover', 'nowhere')
    assert extension.main(parser=parser, args=args) == 2
    assert capsys.readouterr().err == 'smart_tire recover: nowhere: no such file or directory\n'


def test_help_lists_all_verbs(capsys):
    with pytest.raises(SystemExit):
        parsed('smart_tire', '--help')
    output = capsys.readouterr().out
    assert output.startswith('usage: ros2 smart_tire ')
    assert all(f'  {verb}' in output for verb in VERBS)


def test_options_of_the_verb_being_completed_are_known(monkeypatch):
    monkeypatch.setenv('_ARGCOMPLETE', '1')
    monkeypatch.setenv('COMP_LINE', 'ros2 smart_tire replay --wa')
    monkeypatch.setattr('sys.argv', ['ros2'])
    parser = argparse.ArgumentParser()
    SmartTireCommand().add_arguments(parser, 'ros2 smart_tire')
    assert parser.parse_args(['replay', 'bag', '--wait', '3']).wait == 3.0
