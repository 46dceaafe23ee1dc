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

A verb is a module of this folder with ``NAME``, ``HELP``, ``add_arguments(parser)`` and
``run(args)``, which returns the exit status. Only the module of the given verb is imported.
Completion in the shell: PYTHON_ARGCOMPLETE_OK
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module
import os
import platform
import signal
import sys
from typing import Any

import smart_tire
from smart_tire.cli._options import check_paths
from smart_tire.errors import BagError, ParameterError, SmartTireError

VERBS = {
    'demo': 'run the full stack on a simulated robot and evaluate it',
    'drive': 'drive the simulated or the running robot along a path or by the keyboard',
    'record': 'record topics into a bag',
    'replay': 'publish the messages of a bag',
    'recover': 'repair a truncated or damaged bag',
    'analyze': 'run the estimators on bags; write estimates, summary and figures',
    'view': 'show a bag or live topics in the rerun viewer',
    'report': 'run the estimators on bags; write one HTML file with interactive figures',
    'doctor': 'check a recording, or the ports, host and nodes of a robot',
    'status': 'show the state of all nodes and topics',
    'identify': 'identify parameters from recordings, with standard errors',
    'calibrate': 'calibrate a robot step by step, live or from recordings',
    'measure': 'measure deflections with an identified film',
    'topics': 'print what the fields of each topic mean, with their units',
    'reproduce': 'recompute the figures and tables of both papers',
}
COMPUTING = {'analyze', 'identify', 'measure', 'recover', 'report', 'reproduce'}  # without output
FAILED, USAGE, INTERRUPTED, BROKEN_PIPE = 1, 2, 130, 141  # exit statuses
COMPLETING = '_ARGCOMPLETE'   # set by the shell that asks for completions
ROS_ARGUMENTS = '--ros-args'  # rclpy reads the arguments from here on
ROS_PACKAGE_SUFFIXES = ('rclpy', '_msgs', '_srvs', '_interfaces')


def new_parser(selected: str | None) -> argparse.ArgumentParser:
    """Return the parser with the arguments of the ``selected`` verb, if any."""
    parser = argparse.ArgumentParser(
        prog='smart_tire',
        description='Wheel slip, localization and tire-road friction from sensors in the tires.',
        epilog='"smart_tire VERB --help" describes the arguments of a verb.')
    fill_parser(parser, selected)
    return parser


def fill_parser(parser: argparse.ArgumentParser, selected: str | None) -> None:
    """Add the verbs to ``parser``, and the arguments of the ``selected`` one, if any."""
    parser.add_argument('--version', action='version', version=version_text())
    choices = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    for name, summary in VERBS.items():
        verb = choices.add_parser(name, help=summary)
        if name == selected:
            module: Any = import_module(f'smart_tire.cli.{name}')
            verb.description = module.HELP
            module.add_arguments(verb)
            verb.set_defaults(run=module.run)


def version_text() -> str:
    """Return the version of the package, of Python and of the ROS distribution, if any."""
    distribution = os.environ.get('ROS_DISTRO')
    ros = f'ROS {distribution}' if distribution else 'no ROS distribution'
    return f'smart_tire {smart_tire.__version__} (Python {platform.python_version()}, {ros})'


def complete() -> None:
    """Write the completions of the command line that the shell is editing, and exit."""
    import argcomplete
    from argcomplete.lexers import split_line
    _, _, _, words, _ = split_line(
        os.environ['COMP_LINE'], int(os.environ['COMP_POINT']))
    after_program = words[int(os.environ[COMPLETING]):]
    argcomplete.autocomplete(new_parser(after_program[0] if after_program else None))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb given on the command line; return the exit status."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # see smart_tire.launching
    words = list(sys.argv[1:] if argv is None else argv)
    if ROS_ARGUMENTS in words:
        words = words[:words.index(ROS_ARGUMENTS)]
    if COMPLETING in os.environ:
        complete()
    return execute(new_parser(words[0] if words else None).parse_args(words))


def execute(args: argparse.Namespace) -> int:
    """Run the verb in ``args``; print an error in one line; return the exit status."""
    try:
        check_paths(args)
        status = run_verb(args)
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


def run_verb(args: argparse.Namespace) -> int:
    """Run the verb in ``args``; return the exit status."""
    if args.verb not in COMPUTING:
        return int(args.run(args))
    from smart_tire.cli._progress import Progress
    with Progress(f'smart_tire {args.verb}'):
        return int(args.run(args))


def install_hint(module: str) -> str:
    """Return how to install a missing module."""
    if module.split('.')[0].endswith(ROS_PACKAGE_SUFFIXES):
        return 'source a ROS 2 distribution, or pip install smart_tire[ros]'
    if module.split('.')[0] in ('rerun', 'rerun_cli'):
        return 'pip install smart_tire[view]'
    return 'pip install smart_tire installs all dependencies'


def report_error(verb: str, error: object, status: int) -> int:
    """Print one line with the error; return ``status``."""
    print(f'smart_tire {verb}: {error}', file=sys.stderr)
    return status


class SmartTireCommand:
    """
    Wheel slip, localization and tire-road friction from sensors in the tires.

    The interface is that of ``ros2cli.command.CommandExtension``, which is not imported: the
    package also runs without ros2cli.
    """

    NAME = 'smart_tire'

    def add_arguments(self, parser: argparse.ArgumentParser, cli_name: str, *,
                      argv: Sequence[str] | None = None) -> None:
        """Add the verbs, with the arguments of the one on the command line."""
        words = os.environ['COMP_LINE'].split() if COMPLETING in os.environ else \
            list(sys.argv if argv is None else argv)
        after = words[words.index(self.NAME) + 1:] if self.NAME in words else []
        fill_parser(parser, after[0] if after else None)

    def main(self, *, parser: argparse.ArgumentParser, args: argparse.Namespace) -> int:
        """Run the verb; return the exit status."""
        return execute(args)


if __name__ == '__main__':
    sys.exit(main())
