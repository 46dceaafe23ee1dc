"""
The command ``smart_tire VERB ...``.

A verb is a module of this folder with ``NAME``, ``HELP``, ``add_arguments(parser)`` and
``run(args)``, which returns the exit status. Only the one that is asked for is imported.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module
import os
import signal
import sys
from typing import Any

from smart_tire.errors import BagError, ParameterError, SmartTireError

VERBS = {
    'demo': 'the whole stack on a simulated robot',
    'record': 'topics into a bag',
    'replay': 'a bag onto topics',
    'recover': 'a whole bag out of a broken one',
    'analyze': 'estimates and figures out of bags',
    'identify': 'parameters out of recordings, with standard errors',
    'measure': 'deflections out of the charge of an identified film',
    'reproduce': 'figures and tables of the papers, computed anew',
}
FAILED, USAGE, INTERRUPTED, UNREAD = 1, 2, 130, 141
ROS_ARGUMENTS = '--ros-args'  # from here on they are for rclpy, which finds them by itself
OF_ROS = ('rclpy', '_msgs', '_srvs', '_interfaces')  # ends of the names of its packages


def new_parser(asked: str | None) -> argparse.ArgumentParser:
    """Return the parser for the verb that is ``asked`` for, or for an overview of all."""
    parser = argparse.ArgumentParser(
        prog='smart_tire', description='Slip, friction and localization from tires that feel.',
        epilog='"smart_tire VERB --help" tells more.')
    choices = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    for name, summary in VERBS.items():
        verb = choices.add_parser(name, help=summary)
        if name == asked:
            module: Any = import_module(f'smart_tire.cli.{name}')
            verb.description = module.HELP
            module.add_arguments(verb)
            verb.set_defaults(run=module.run)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb that the command line names; return the exit status."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # see smart_tire.launching
    words = list(sys.argv[1:] if argv is None else argv)
    if ROS_ARGUMENTS in words:
        words = words[:words.index(ROS_ARGUMENTS)]
    args = new_parser(words[0] if words else None).parse_args(words)
    try:
        status = int(args.run(args))
        sys.stdout.flush()
        return status
    except (BagError, ParameterError) as error:
        return complain(args.verb, error, USAGE)
    except SmartTireError as error:
        return complain(args.verb, error, FAILED)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith('smart_tire'):
            raise
        return complain(args.verb, f'{error.name} is not installed ({hint(error.name)})', FAILED)
    except KeyboardInterrupt:
        return complain(args.verb, 'interrupted', INTERRUPTED)
    except BrokenPipeError:  # whoever reads has had enough, as "head" has
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD


def hint(module: str) -> str:
    """Return where a missing module comes from."""
    if module.split('.')[0].endswith(OF_ROS):
        return 'source a ROS 2 distribution, or pip install smart_tire[ros]'
    return 'pip install smart_tire brings all it needs'


def complain(verb: str, error: object, status: int) -> int:
    """Say in one line what is wrong; return ``status``."""
    print(f'smart_tire {verb}: {error}', file=sys.stderr)
    return status


if __name__ == '__main__':
    sys.exit(main())
