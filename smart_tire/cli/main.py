"""
The command ``smart_tire VERB ...``.

A verb is a module of this folder with ``NAME``, ``HELP``, ``add_arguments(parser)`` and
``run(args)``, which returns the exit status. What is slow to import it imports in ``run``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module
import sys
from typing import Any

from smart_tire.errors import BagError, ParameterError, SmartTireError

VERBS = ('demo', 'record', 'replay', 'recover', 'analyze')
FAILED, USAGE, INTERRUPTED = 1, 2, 130
ROS_ARGUMENTS = '--ros-args'  # from here on they are for rclpy, which finds them by itself
ROS_HINT = 'source a ROS 2 distribution, or install smart_tire[ros]'


def load(verb: str) -> Any:
    """Return the module of a verb."""
    return import_module(f'smart_tire.cli.{verb}')


def new_parser(verbs: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser for ``verbs``."""
    parser = argparse.ArgumentParser(
        prog='smart_tire', description='Slip, friction and localization from tires that feel.')
    choices = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    for module in map(load, verbs):
        verb = choices.add_parser(module.NAME, help=module.HELP, description=module.HELP)
        module.add_arguments(verb)
        verb.set_defaults(run=module.run)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb that the command line names; return the exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    if ROS_ARGUMENTS in words:
        words = words[:words.index(ROS_ARGUMENTS)]
    asked = [verb for verb in VERBS if words and words[0] == verb]
    args = new_parser(asked or VERBS).parse_args(words)
    try:
        return int(args.run(args))
    except (BagError, ParameterError) as error:
        return complain(args.verb, error, USAGE)
    except SmartTireError as error:
        return complain(args.verb, error, FAILED)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith('smart_tire'):
            raise
        return complain(args.verb, f'{error.name} is not installed ({ROS_HINT})', FAILED)
    except KeyboardInterrupt:
        return complain(args.verb, 'interrupted', INTERRUPTED)


def complain(verb: str, error: object, status: int) -> int:
    """Say in one line what is wrong; return ``status``."""
    print(f'smart_tire {verb}: {error}', file=sys.stderr)
    return status


if __name__ == '__main__':
    sys.exit(main())
