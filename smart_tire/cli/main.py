# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
The command ``smart_tire VERB ...``.

The verbs and their arguments are in verbs.yaml. Each is a module of this folder with a function
``run(args)``, which returns the exit status; only that of the given verb is imported.
Completion in the shell: PYTHON_ARGCOMPLETE_OK
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from contextlib import suppress
from importlib import import_module
from io import TextIOWrapper
from itertools import chain
import logging
import os
from pathlib import Path
import platform
import signal
import sys
from typing import Any

import smart_tire
from smart_tire.cli._options import (
    check_paths, count, not_negative, positive, source, step_and_bag)
from smart_tire.errors import (
    BagError, did_you_mean, ParameterError, printable, SmartTireError)
from smart_tire.yaml_text import load_own

VERBS: dict[str, Any] = load_own(
    Path(__file__).with_name('verbs.yaml').read_text(encoding='utf-8'))['verbs']
TYPES = {'path': Path, 'int': int, 'float': float, 'positive': positive,
         'not_negative': not_negative, 'step': step_and_bag, 'source': source, 'count': count}
COMPUTING = {  # without output
    'analyze', 'compare', 'design', 'identify', 'map', 'measure', 'overhead', 'recover', 'report',
    'reproduce'}
FAILED, USAGE, INCOMPLETE, INTERRUPTED, BROKEN_PIPE = 1, 2, 3, 130, 141  # exit statuses
COMPLETING = '_ARGCOMPLETE'   # set by the shell that asks for completions
ROS_ARGUMENTS = '--ros-args'  # rclpy reads the arguments from here on
ROS_PACKAGE_SUFFIXES = ('rclpy', '_msgs', '_srvs', '_interfaces')
EXTRAS = {'view': ('rerun', 'rerun_cli'), 'parquet': ('pyarrow',),  # of setup.py -> modules
          'fleet': ('fsspec', 'distributed', 's3fs'), 'camera': ('cv2', 'filterpy')}


def new_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = argparse.ArgumentParser(
        prog='smart_tire',
        description='Wheel slip, localization and tire-road friction from sensors in the tires.',
        epilog='"smart_tire VERB --help" describes the arguments of a verb.')
    fill_parser(parser)
    return parser


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the verbs and their arguments to ``parser``."""
    parser.add_argument('--version', action='version', version=version_text())
    choices = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    for name, verb in VERBS.items():
        inner = choices.add_parser(name, help=verb['summary'], description=verb['help'])
        add_arguments(inner, verb.get('arguments', ()))
        if 'kinds' in verb:
            kinds = inner.add_subparsers(dest='kind', metavar='KIND', required=True)
            for one, kind in verb['kinds'].items():
                add_arguments(kinds.add_parser(one, help=kind['help'], description=kind['help']),
                              kind['arguments'])


def add_arguments(parser: Any, arguments: Iterable[Any]) -> None:
    """Add the ``arguments`` in verbs.yaml to a parser, or to a group of one."""
    for one in arguments:
        if isinstance(one, list):
            add_arguments(parser, one)
        elif 'one_of' in one:
            add_arguments(parser.add_mutually_exclusive_group(
                required=one.get('required', False)), one['one_of'])
        else:
            settings = {'help': argparse.SUPPRESS, **one}
            if 'type' in one:
                settings['type'] = TYPES[one['type']]
            completer = settings.pop('completer', '')
            action = parser.add_argument(settings.pop('name'), **settings)
            if completer:
                action.completer = COMPLETERS[completer]


def complete_path(prefix: str, **_: object) -> list[str]:
    """Return the names of paths to drive and the files that begin with ``prefix``."""
    from argcomplete.completers import FilesCompleter
    from smart_tire.control.path_library import PATHS
    return [name for name in PATHS if name.startswith(prefix)] + list(FilesCompleter()(prefix))


def complete_topic(**_: object) -> tuple[str, ...]:
    """Return the names of the topics."""
    from smart_tire.messages.describe import TOPIC_NAMES
    return TOPIC_NAMES


COMPLETERS = {'path': complete_path, 'topic': complete_topic}


def version_text() -> str:
    """Return the version of the package, of Python and of the ROS distribution, if any."""
    distribution = os.environ.get('ROS_DISTRO')
    ros = f'ROS {distribution}' if distribution else 'no ROS distribution'
    return f'smart_tire {smart_tire.__version__} (Python {platform.python_version()}, {ros})'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb given on the command line; return the exit status."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # see smart_tire.launching
    # Threads for matrices as small as these only wait for each other: on a busy machine the
    # calibrations take eight times as long with them. Read when numpy is imported, by a verb.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    replace_characters()
    words = list(sys.argv[1:] if argv is None else argv)
    if ROS_ARGUMENTS in words:
        words = words[:words.index(ROS_ARGUMENTS)]
    parser = new_parser()
    if COMPLETING in os.environ:
        import argcomplete
        argcomplete.autocomplete(parser)
    if not words:
        parser.print_help(sys.stderr)
        return USAGE
    if not words[0].startswith('-') and words[0] not in VERBS:
        parser.error(f'{words[0]}: no verb' + did_you_mean(
            words[0], VERBS, f'; known: {", ".join(VERBS)}'))
    return execute(parser.parse_args(words))


def replace_characters() -> None:
    """Print ``?`` for what a terminal cannot show that is not UTF-8."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors='replace')


def execute(args: argparse.Namespace) -> int:
    """Run the verb in ``args``; print an error in one line; return the exit status."""
    try:
        check_paths(args)
        warn_of_names(getattr(args, 'params', ()))
        warn_of_names(list(chain(*getattr(args, 'variants', ()))))
        with LossReport(args.verb) as losses:
            status = run_verb(args) or losses.status
            sys.stdout.flush()
        return status
    except (BagError, ParameterError) as error:
        return report_error(args.verb, error, USAGE)
    except SmartTireError as error:
        return report_error(args.verb, error, FAILED)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith('smart_tire'):
            raise
        return report_error(
            args.verb, f'{error.name} is not installed ({install_hint(error.name)})', FAILED)
    except KeyboardInterrupt:
        return report_error(args.verb, 'interrupted', INTERRUPTED)
    except BrokenPipeError:  # the reader has closed the pipe, as "head" does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE


def warn_of_names(files: Any) -> None:
    """Print a line for each block in parameter ``files`` with a misspelled name of a node."""
    if isinstance(files, list):  # a single one is no ROS parameter file
        from smart_tire.parameters import NODE_PARAMS
        from smart_tire.parameters.files import misspelled
        for file in files:
            with suppress(ParameterError):  # the verb reports it, if it reads the file
                for _, text in misspelled(file, NODE_PARAMS):
                    print(f'warning: {text}', file=sys.stderr)


def run_verb(args: argparse.Namespace) -> int:
    """Run the verb in ``args``; return the exit status."""
    verb = import_module(f'smart_tire.cli.{args.verb}')
    if args.verb not in COMPUTING:
        return int(verb.run(args))
    from smart_tire.cli._progress import ProgressLine
    with ProgressLine(f'smart_tire {args.verb}'):
        return int(verb.run(args))


def install_hint(module: str) -> str:
    """Return how to install a missing module."""
    package = module.split('.')[0]
    if package.endswith(ROS_PACKAGE_SUFFIXES):
        return 'source a ROS 2 distribution, or pip install smart_tire[ros]'
    extra = next((extra for extra, packages in EXTRAS.items() if package in packages), '')
    return f'pip install smart_tire[{extra}]' if extra else (
        'pip install smart_tire installs all dependencies')


def report_error(verb: str, error: object, status: int) -> int:
    """Print one line with the error; return ``status``."""
    print(f'smart_tire {verb}: {error}', file=sys.stderr)
    return status


class LossReport(logging.Handler):
    """
    Collects the losses of the bags that a verb reads; a context manager.

    Prints one line for each bag at the end, on standard error.
    """

    def __init__(self, verb: str) -> None:
        super().__init__(logging.WARNING)
        self._verb = verb
        self._lines: dict[str, str] = {}  # by path

    def __enter__(self) -> LossReport:
        self._logger = logging.getLogger('smart_tire.bags')
        self._logger.addHandler(self)
        return self

    def __exit__(self, *_: object) -> None:
        self._logger.removeHandler(self)
        for path, line in self._lines.items():
            report_error(self._verb, printable(f'{path}: {line}'), INCOMPLETE)

    def emit(self, record: logging.LogRecord) -> None:
        """Note a report of ``report_losses``; later ones of the same bag are more complete."""
        path, line = map(str, record.args or ('bag', record.msg))
        self._lines[path] = line

    @property
    def status(self) -> int:
        """Return the exit status of a verb that has done its work."""
        return INCOMPLETE if self._lines else 0


class SmartTireCommand:
    """
    Wheel slip, localization and tire-road friction from sensors in the tires.

    The interface is that of ``ros2cli.command.CommandExtension``, which is not imported: the
    package also runs without ros2cli.
    """

    def add_arguments(self, parser: argparse.ArgumentParser, cli_name: str, *,
                      argv: Sequence[str] | None = None) -> None:
        """Add the verbs and their arguments."""
        fill_parser(parser)

    def main(self, *, parser: argparse.ArgumentParser, args: argparse.Namespace) -> int:
        """Run the verb; return the exit status."""
        replace_characters()
        return execute(args)


if __name__ == '__main__':
    sys.exit(main())
