# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The command line: verbs, help, errors, completion in the shell, ``ros2 smart_tire``."""

from __future__ import annotations

import argparse
from importlib import import_module
from io import BytesIO, TextIOWrapper
import os
from pathlib import Path
import platform
import subprocess
import sys

import pytest
import smart_tire
from smart_tire.cli import recover
from smart_tire.cli.main import main, SmartTireCommand, VERBS
from smart_tire.errors import BagError, EstimatorError, ParameterError

pytestmark = pytest.mark.processes

SLOW = ('asyncio', 'numpy', 'scipy', 'matplotlib', 'rosbags', 'mcap', 'rclpy')


@pytest.fixture
def verb(monkeypatch):
    """Return a function that replaces ``run`` of the verb ``recover``."""
    def replace(run):
        monkeypatch.setattr(import_module('smart_tire.cli.main'), 'check_paths', lambda args: None)
        monkeypatch.setattr(import_module('smart_tire.cli.recover'), 'run', run)
        return main(['recover', 'some_bag'])
    return replace


def raising(error):
    """Return a verb's ``run`` that fails with ``error``."""
    def run(args):
        raise error
    return run


def test_a_misspelled_node_in_a_parameter_file_is_reported(tmp_path, monkeypatch, capsys):
    path = tmp_path / 'mine.yaml'
    path.write_text('slip_estimatr: {ros__parameters: {}}')
    monkeypatch.setattr(import_module('smart_tire.cli.main'), 'run_verb', lambda args: 0)
    assert main(['drive', '--path', 'square', '--params', str(path)]) == 0
    assert capsys.readouterr().err == (
        f'warning: {path}: slip_estimatr is ignored, did you mean slip_estimator?\n')


@pytest.mark.parametrize('of_ros', [False, True])
def test_a_terminal_that_is_not_utf_8_gets_all_lines(of_ros, verb, monkeypatch):
    terminal = TextIOWrapper(BytesIO(), 'ascii', 'strict')
    monkeypatch.setattr(sys, 'stdout', terminal)
    say = lambda args: print('1 ± 2\nwritten') or 0  # noqa: E731
    assert verb(say) == 0
    if of_ros:
        terminal.reconfigure(errors='strict')
        parser = argparse.ArgumentParser()
        SmartTireCommand().add_arguments(parser, 'ros2')
        assert SmartTireCommand().main(
            parser=parser, args=parser.parse_args(['recover', 'some_bag'])) == 0
    terminal.flush()
    assert terminal.buffer.getvalue() == b'1 ? 2\nwritten\n' * (1 + of_ros)


@pytest.mark.parametrize('name', VERBS)
def test_every_verb_describes_itself(name, capsys):
    with pytest.raises(SystemExit) as ended:
        main([name, '--help'])
    assert ended.value.code == 0
    assert VERBS[name]['help'] in ' '.join(capsys.readouterr().out.split())


def test_help_lists_all_verbs_without_slow_imports():
    code = ('import sys; from smart_tire.cli.main import main\n'
            'try: main(["--help"])\n'
            f'finally: print([name for name in {SLOW} if name in sys.modules], file=sys.stderr)')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True,
                          check=True, env={'PYTHONPATH': ':'.join(filter(None, sys.path))})
    assert done.stderr.strip() == '[]'
    assert all(f'  {name}' in done.stdout for name in VERBS)


@pytest.mark.parametrize(('environment', 'ros'), [
    ({}, 'no ROS distribution'), ({'ROS_DISTRO': 'jazzy'}, 'ROS jazzy')])
def test_the_version_names_package_python_and_ros(environment, ros, capsys, monkeypatch):
    monkeypatch.delenv('ROS_DISTRO', raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SystemExit) as ended:
        main(['--version'])
    assert ended.value.code == 0
    assert capsys.readouterr().out == (
        f'smart_tire {smart_tire.__version__} (Python {platform.python_version()}, {ros})\n')


@pytest.mark.parametrize('words', [['fly'], ['recover'], ['replay', 'bag', '--rate', '-1'],
                                   ['replay', 'bag', '--rate', 'nan'], ['record', '--loud']])
def test_an_invalid_command_line_is_a_usage_error(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert 'usage: smart_tire' in capsys.readouterr().err


def test_without_a_verb_they_are_listed(capsys):
    assert main([]) == 2
    listed = capsys.readouterr().err
    assert all(f'  {name}' in listed for name in VERBS)


def test_a_misspelled_verb_has_a_suggestion(capsys):
    for word, expected in (('anlyze', 'anlyze: no verb, did you mean analyze?'),
                           ('xyz', 'xyz: no verb; known: demo, ')):
        with pytest.raises(SystemExit) as ended:
            main([word])
        assert ended.value.code == 2
        assert expected in capsys.readouterr().err


@pytest.mark.parametrize(('error', 'status', 'output'), [
    (BagError('x: not a bag'), 2, 'x: not a bag'),
    (ParameterError('wheel_radius: -1'), 2, 'wheel_radius: -1'),
    (EstimatorError('diverged'), 1, 'diverged'),
    (ModuleNotFoundError("No module named 'rclpy'", name='rclpy'), 1, 'rclpy is not installed'),
    (KeyboardInterrupt(), 130, 'interrupted')])
def test_errors_are_printed_in_one_line(verb, capsys, error, status, output):
    assert verb(raising(error)) == status
    out, err = capsys.readouterr()
    assert out == ''
    assert err.startswith('smart_tire recover: ')
    assert output in err
    assert err.count('\n') == 1


@pytest.mark.parametrize('error', [ModuleNotFoundError('us', name='smart_tire.odd'), KeyError(3)])
def test_programming_errors_are_not_hidden(verb, error):
    with pytest.raises(type(error)):
        verb(raising(error))


def test_ros_arguments_are_left_to_rclpy(monkeypatch):
    seen = []
    monkeypatch.setattr(import_module('smart_tire.cli.record'), 'run',
                        lambda args: seen.append(args.topics) or 0)
    assert main(['record', '--topics', 'odom', '--ros-args', '-r', '__ns:=/robot']) == 0
    assert seen == [['odom']]


def test_a_closed_output_pipe_is_not_an_error():
    code = ('import sys; from smart_tire.cli import main, recover\n'
            'main.check_paths = lambda args: None\n'
            'recover.run = lambda args: [print(line) for line in range(100_000)] and 0\n'
            'sys.exit(main.main(["recover", "some_bag"]))')
    with subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == '0\n'
        process.stdout.close()
        assert process.stderr.read() == ''
    assert process.returncode == 141  # as after SIGPIPE


ROOT = Path(smart_tire.__file__).parents[1]
SEPARATOR = '\013'


def completions(line, folder):
    """Return what a shell is offered at the end of ``line``."""
    answer = folder / 'completions'
    subprocess.run(
        [sys.executable, '-m', 'smart_tire.cli.main'], check=False, cwd=folder,
        env={**os.environ, 'PYTHONPATH': str(ROOT), '_ARGCOMPLETE': '1', 'COMP_LINE': line,
             'COMP_POINT': str(len(line)), '_ARGCOMPLETE_IFS': SEPARATOR,
             '_ARGCOMPLETE_STDOUT_FILENAME': str(answer)})
    return {word.strip() for word in answer.read_text().split(SEPARATOR)}


@pytest.mark.parametrize(('line', 'offered'), [
    ('smart_tire ', {'--help', '--version', '-h', *VERBS}),
    ('smart_tire ana', {'analyze'}),
    ('smart_tire analyze --smo', {'--smooth'}),
    ('smart_tire replay --wait', {'--wait', '--wait-for'}),
    ('smart_tire identify g', {'gains', 'geometry'}),
    ('smart_tire identify motor --li', {'--lifted'}),
    ('smart_tire analyze my_b', {'my_bag/'}),
    ('smart_tire analyze my_bag --params rob', {'robot.yaml'}),
    ('smart_tire drive --path figure', {'figure_eight'}),
    ('smart_tire drive --path my_', {'my_bag/'}),
    ('smart_tire topics wheel_s', {'wheel_slip', 'wheel_slip/typed', 'wheel_states'})])
def test_options_kinds_files_and_topics_are_completed(line, offered, tmp_path):
    (tmp_path / 'my_bag').mkdir()
    (tmp_path / 'robot.yaml').touch()
    assert completions(line, tmp_path) == offered


def test_global_completion_recognizes_the_command():
    main = (ROOT / 'smart_tire' / 'cli' / 'main.py').read_text(encoding='utf-8')
    assert 'PYTHON_ARGCOMPLETE_OK' in main[:1024]  # argcomplete reads no more


def test_a_verb_is_run_with_its_arguments(monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr(recover, 'run', lambda args: seen.append(args) or 3)
    bag = tmp_path / 'drive.mcap'
    bag.touch()
    parser, extension = argparse.ArgumentParser(prog='ros2'), SmartTireCommand()
    words = ['recover', str(bag), '--force']
    extension.add_arguments(parser, 'ros2 smart_tire', argv=['ros2', 'smart_tire', *words])
    assert extension.main(parser=parser, args=parser.parse_args(words)) == 3
    (given,) = seen
    assert (given.bag, given.force) == (bag, True)
