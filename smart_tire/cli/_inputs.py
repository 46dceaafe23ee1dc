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
Paths on the command line, checked before a verb starts.

Arguments are recognized by their names, which are the same in all verbs. A wrong path is reported
at once, since the libraries of a verb take seconds to import.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
import sys
from typing import Any

from smart_tire.paths import check_file, check_writable, find_bag

BAGS = ('bag', 'bags', 'lifted')
FILES = ('params', 'data')
OUTPUTS = ('out', 'save')


def check_paths(args: argparse.Namespace) -> None:
    """
    Check all paths in ``args``; replace a folder that contains one bag by this bag.

    Raises BagError or ParameterError for the first path that cannot be used.
    """
    for name in BAGS:
        apply(args, name, _found)
    for name in FILES:
        apply(args, name, _checked(check_file))
    for name in OUTPUTS:
        apply(args, name, _checked(check_writable))


def apply(args: argparse.Namespace, name: str, function: Callable[[Path], Path]) -> None:
    """Replace the paths of an argument, a path or a list, by ``function`` of each."""
    given: Any = getattr(args, name, None)
    if isinstance(given, Path):
        setattr(args, name, function(given))
    elif isinstance(given, list):
        setattr(args, name, [_applied(one, function) for one in given])


def _applied(given: Any, function: Callable[[Path], Path]) -> Any:
    """Return ``given`` with ``function`` of it, or of the paths in it if it is a tuple."""
    if isinstance(given, tuple):
        return tuple(_applied(one, function) for one in given)
    return function(given) if isinstance(given, Path) else given


def _found(path: Path) -> Path:
    bag = find_bag(path)
    if bag != path:
        print(f'{path}: reading the bag {bag}', file=sys.stderr)
    return bag


def _checked(check: Callable[[Path], None]) -> Callable[[Path], Path]:
    def function(path: Path) -> Path:
        check(path)
        return path

    return function
