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
Arguments that several verbs share: their types and checks.

Paths are checked before a verb starts, since its libraries take seconds to import. They are
recognized by the names of the arguments.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import math
from pathlib import Path
import sys
from typing import Any

from smart_tire.fleet.sources import bags_of, is_url, path_of, Source
from smart_tire.paths import check_file, check_writable, find_bag, is_analysis

BAGS, FILES = ('bag', 'bags', 'lifted', 'overhead', 'truth'), ('params', 'variants', 'data')
OUTPUTS, RUNS = ('out', 'save', 'dataset'), ('runs',)  # runs are bags or analyses
CONFIRMATION = 'drive'
STEP_NAMES = ('rest', 'straight', 'turns', 'lifted')  # of a calibration


def positive(text: str) -> float:
    """Return ``text`` as a number; raise ValueError unless it is positive and finite."""
    number = float(text)
    if not 0.0 < number < math.inf:
        raise ValueError(text)
    return number


def not_negative(text: str) -> float:
    """Return ``text`` as a number; raise ValueError unless it is non-negative and finite."""
    return 0.0 if float(text) == 0.0 else positive(text)


def source(text: str) -> Source:
    """Return the path or URL of a bag."""
    return text if is_url(text) else path_of(text)


def count(text: str) -> int:
    """Return ``text`` as a number; raise ValueError unless it is 1 or more."""
    if (number := int(text)) < 1:
        raise ValueError(text)
    return number


def step_and_bag(text: str) -> tuple[str, Path]:
    """Return step and bag of ``STEP=BAG``, or of ``BAG``, a recording of several steps."""
    step, separator, path = text.partition('=')
    if not separator:
        return 'mixed', Path(text)
    if step not in STEP_NAMES or not path:
        raise argparse.ArgumentTypeError(
            f'{text}: expected BAG or STEP=BAG with one of {", ".join(STEP_NAMES)}')
    return step, Path(path)


def check_paths(args: argparse.Namespace) -> None:
    """
    Check all paths in ``args``; replace a folder that contains one bag by this bag.

    Raises BagError or ParameterError for the first path that cannot be used.
    """
    several = hasattr(args, 'jobs')  # of the verb, which takes any number of bags
    if several:
        name, all_found = ('runs', _all_runs) if hasattr(args, 'runs') else ('bags', _all_found)
        setattr(args, name, [bag for one in getattr(args, name) for bag in all_found(one)])
    for names, check in ((BAGS, _found), (RUNS, _found_run), (FILES, check_file),
                         (OUTPUTS, check_writable)):
        for name in names:
            if hasattr(args, name) and not (several and name in ('bags', 'runs')):
                setattr(args, name, _checked(getattr(args, name), check))
    if getattr(args, 'dask', ''):  # workers have another working directory
        for name in {*BAGS, *RUNS, *FILES, *OUTPUTS} & vars(args).keys():
            setattr(args, name, _checked(getattr(args, name), Path.absolute))


def _checked(given: Any, check: Callable[[Path], Path | None]) -> Any:
    """Return ``given`` with the results of ``check``, if any, for the paths in it."""
    if isinstance(given, (list, tuple)):
        return type(given)(_checked(one, check) for one in given)
    return check(given) or given if isinstance(given, Path) else given


def _found(path: Path) -> Path:
    bag = find_bag(path)
    if bag != path:
        print(f'{path}: reading the bag {bag}', file=sys.stderr)
    return bag


def _all_found(argument: Source) -> list[Source]:
    """Return the bags that an argument names; print how many, or which one, if not this one."""
    bags = bags_of([argument])
    if len(bags) > 1:
        print(f'{argument}: reading {len(bags)} bags', file=sys.stderr)
    elif str(bags[0]) != str(argument):
        print(f'{argument}: reading the bag {bags[0]}', file=sys.stderr)
    return bags


def _all_runs(argument: Source) -> list[Source]:
    return [argument] if isinstance(argument, Path) and is_analysis(argument) else _all_found(
        argument)


def _found_run(path: Path) -> Path:
    return path if is_analysis(path) else _found(path)


def confirmed() -> bool:
    """Ask on standard input whether a robot may drive; return whether this was confirmed."""
    print(f'Type "{CONFIRMATION}" to continue: ', end='', flush=True)
    typed = sys.stdin.readline().strip()
    if not sys.stdin.isatty():
        print()  # nobody has pressed Enter
    return typed == CONFIRMATION
