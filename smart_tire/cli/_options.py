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
Options and paths that several verbs share: bags and their parameters, inputs, outputs.

Paths are checked before a verb starts, since its libraries take seconds to import. They are
recognized by the names of the arguments. Even with ``--force`` only files that the program itself
writes are deleted, by name.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import math
import os
from pathlib import Path
import re
import sys
from typing import Any, TYPE_CHECKING

from smart_tire.errors import ParameterError, printable
from smart_tire.findings import Finding, Level
from smart_tire.paths import BAG_METADATA, check_file, check_writable, find_bag

if TYPE_CHECKING:
    from smart_tire.analysis.pipeline import BagParams, EstimatorParams
    from smart_tire.bags import Bag, TopicNames
    from smart_tire.parameters import RobotParams

REQUIRED = ('imu/data', 'wheel_states')  # inputs without which nothing is estimated
BAGS, FILES, OUTPUTS = ('bag', 'bags', 'lifted', 'overhead'), ('params', 'data'), ('out', 'save')
# of analysis/figures.py and, for followed paths, analysis/drive_report.py
FIGURES = ('slip.png', 'path.png', 'friction.png', 'crossing.png', 'tracking.png')
CONFIRMATION = 'drive'
STEP_NAMES = ('rest', 'straight', 'turns', 'lifted')  # of a calibration
IDENTIFIED, NOT_IDENTIFIED = 0, 1  # exit statuses


def positive(text: str) -> float:
    """Return ``text`` as a number; raise ValueError unless it is positive and finite."""
    number = float(text)
    if not 0.0 < number < math.inf:
        raise ValueError(text)
    return number


def not_negative(text: str) -> float:
    """Return ``text`` as a number; raise ValueError unless it is non-negative and finite."""
    return 0.0 if float(text) == 0.0 else positive(text)


def step_and_bag(text: str) -> tuple[str, Path]:
    """Return step and bag of ``STEP=BAG``, or of ``BAG``, a recording of several steps."""
    step, separator, path = text.partition('=')
    if not separator:
        return 'mixed', Path(text)
    if step not in STEP_NAMES or not path:
        raise argparse.ArgumentTypeError(
            f'{text}: expected BAG or STEP=BAG with one of {", ".join(STEP_NAMES)}')
    return step, Path(path)


def check_options(args: argparse.Namespace) -> None:
    """Raise ParameterError if an option of ``--params`` and ``--remap`` is invalid for any bag."""
    from smart_tire.analysis.pipeline import EstimatorParams
    from smart_tire.bags import TopicNames
    EstimatorParams.load(args.params)
    TopicNames.parse(args.remap)


@contextmanager
def open_bag(path: Path, args: argparse.Namespace, *, required: Collection[str] = REQUIRED,
             prefix: str = '') -> Iterator[tuple[Bag, BagParams]]:
    """
    Open a bag with the options of ``--params`` and ``--remap``; yield it and its parameters.

    Prints the source of the parameters, and the topics and joints that were recognized, with
    ``prefix`` before each line. Raises BagError if one of the ``required`` topics has to be
    selected with an option, ParameterError if an option or a parameter is invalid.
    """
    from smart_tire.analysis.pipeline import bag_params
    from smart_tire.bags import Bag, check_inputs, TopicNames
    with Bag(path, TopicNames.parse(args.remap)) as bag:
        source = bag_params(bag, args.params)
        bag.joints = source.params.robot.joints
        check_inputs(bag, required)
        for line in (*source.lines(), *bag.notes):
            print(prefix + line)
        yield bag, source


def bag_settings(paths: Sequence[Path], args: argparse.Namespace,
                 checked: Collection[Path] = ()) -> tuple[EstimatorParams, TopicNames]:
    """
    Return parameters and topic names for bags of one robot; print as ``open_bag`` does.

    Also prints the errors that the checks find in those of the bags that are ``checked``.
    Raises ParameterError if the bags carry different parameters of the robot.
    """
    found = []
    for path in paths:
        prefix = f'{path}: ' if len(paths) > 1 else ''
        with open_bag(path, args, prefix=prefix) as (bag, source):
            found.append((source.params, bag.names))
            if path in checked:
                print_checks(bag, source.params.robot, prefix)
        if source.params.robot != found[0][0].robot:
            raise ParameterError(f'{paths[0]} and {path} carry different parameters of the '
                                 'robot: select one set with --params')
    return found[0]


def check_paths(args: argparse.Namespace) -> None:
    """
    Check all paths in ``args``; replace a folder that contains one bag by this bag.

    Raises BagError or ParameterError for the first path that cannot be used.
    """
    for names, check in (BAGS, _found), (FILES, check_file), (OUTPUTS, check_writable):
        for name in names:
            if hasattr(args, name):
                setattr(args, name, _checked(getattr(args, name), check))


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


def confirmed() -> bool:
    """Ask on standard input whether a robot may drive; return whether this was confirmed."""
    print(f'Type "{CONFIRMATION}" to continue: ', end='', flush=True)
    typed = sys.stdin.readline().strip()
    if not sys.stdin.isatty():
        print()  # nobody has pressed Enter
    return typed == CONFIRMATION


def refuse_existing(paths: Iterable[Path], *, force: bool, inputs: Iterable[Path] = ()) -> None:
    """Raise ParameterError if a path is an input or, without ``force``, if one exists."""
    read = {path.resolve() for path in inputs}
    for path in paths:
        if path.resolve() in read:
            raise ParameterError(f'{path} is an input: choose another --out')
        if os.path.lexists(path) and not force:
            raise ParameterError(f'{path} exists: choose another --out, or --force to replace it')


def refuse_existing_bag(folder: Path, *, force: bool) -> None:
    """Raise ParameterError if ``folder`` exists; with ``force`` only if it has other files."""
    refuse_existing([folder], force=force)
    if not os.path.lexists(folder):
        return
    if not folder.is_dir():
        raise ParameterError(f'{folder} is a file: choose another --out')
    if others := {path.name for path in folder.iterdir()} - _bag_files(folder):
        raise ParameterError(f'{folder} contains {min(others)}, which --force does not delete: '
                             'choose another --out')


def refuse_folder_of_bag(out: Path, bags: Iterable[Path]) -> None:
    """Raise ParameterError if ``out`` is or is inside the folder of one of ``bags``."""
    for bag in bags:
        path = bag.resolve()
        folder = path if path.is_dir() else path.parent
        inside = path.is_dir() or (folder / BAG_METADATA).exists()  # not if a single file
        if out.resolve() == folder or inside and folder in out.resolve().parents:
            raise ParameterError(f'{out} is in the folder of the bag {bag}: choose another --out')


def remove_bag(folder: Path) -> None:
    """Delete the bag in ``folder``; call ``refuse_existing_bag`` before."""
    if folder.is_dir():
        remove(folder, _bag_files(folder))


def remove(folder: Path, names: Iterable[str]) -> None:
    """Delete files of ``folder``, and the folder itself if it is empty then."""
    try:
        for name in names:
            (folder / name).unlink(missing_ok=True)
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
    except OSError as error:
        raise ParameterError(f'{folder}: cannot be replaced ({error.strerror})') from error


def _bag_files(folder: Path) -> set[str]:
    files = re.compile(rf'{re.escape(folder.resolve().name)}_[0-9]+\.mcap')
    return {path.name for path in folder.iterdir() if files.fullmatch(path.name)} | {BAG_METADATA}


def print_errors(errors: Iterable[Finding], prefix: str = '') -> None:
    """Print the errors that the checks of ``smart_tire doctor`` have found in a recording."""
    for error in errors:
        print(f'{prefix}error: {error.text}')


def print_checks(bag: Bag, robot: RobotParams, prefix: str = '') -> None:
    """Read an open bag, and print its errors."""
    from smart_tire.analysis.checks import findings
    from smart_tire.analysis.checks.recording import read
    print_errors((one for one in findings(read(bag, robot)) if one.level is Level.ERROR), prefix)


def print_counts(counts: Mapping[str, int]) -> None:
    """Print the message count of each topic."""
    width = max((len(str(count)) for count in counts.values()), default=1)
    for topic, count in sorted(counts.items()):
        print(f'  {count:{width}} {printable(topic)}')


def print_warnings(warnings: Iterable[str]) -> None:
    """Print the warnings of a bag reader."""
    for warning in warnings:
        print(f'warning: {printable(warning)}')
