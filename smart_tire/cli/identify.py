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

"""
``smart_tire identify KIND``: parameters from recordings, with standard errors.

Each kind is a module ``_identify_<kind>`` of this folder with the interface of a verb.
"""

from __future__ import annotations

import argparse
from importlib import import_module
from typing import Any

NAME = 'identify'
HELP = 'identify parameters of film, tire or robot from recordings, with standard errors'
KINDS = ('film', 'gains', 'geometry', 'icr', 'motor', 'stiffness')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of every kind."""
    choices = parser.add_subparsers(dest='kind', metavar='KIND', required=True)
    for name in KINDS:
        module: Any = import_module(f'smart_tire.cli._identify_{name}')
        kind = choices.add_parser(name, help=module.HELP, description=module.HELP)
        module.add_arguments(kind)
        kind.set_defaults(run_kind=module.run)


def run(args: argparse.Namespace) -> int:
    """Run the selected kind; return the exit status."""
    return int(args.run_kind(args))
