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
Outputs of the verbs: they never replace an input, nor without ``--force`` what exists.

Even with ``--force`` only files that the program itself writes are deleted, by name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
import fcntl
import os
from pathlib import Path
import re

from smart_tire.errors import ParameterError
from smart_tire.fleet import is_url, path_of, Source
from smart_tire.paths import BAG_METADATA, bag_name, explained

# of analysis/figures.py and, for followed paths, analysis/drive_report.py
FIGURES = ('slip.png', 'path.png', 'friction.png', 'crossing.png', 'tracking.png')

COMPARISON = ('comparison.csv', 'comparison.tex', 'comparison.png')  # analysis/comparison.py
# of analysis/export.py
PATHS, TABLES = ('odom', 'reference'), ('odom', 'wheel_slip', 'icr', 'ground_state',
                                        'tire_friction')


def export_names(formats: Iterable[str]) -> list[str]:
    """Return the files that ``--tum`` and the others write."""
    return [f'{prefix}{name}.{form}' for form in formats for prefix in ('', 'smoothed_')
            for name in (PATHS if form in ('tum', 'kitti') else TABLES)]


def folder_names(bags: Sequence[Source]) -> list[str]:
    """Return a name for each bag: its own, or that of the nearest folder where they differ."""
    paths = list(map(path_of, bags))
    levels = zip(*([bag_name(path), *reversed(path.resolve().parent.parts)] for path in paths))
    return next((list(names) for names in levels if len(set(names)) == len(names)),
                [bag_name(path) for path in paths])


def next_to(bag: Source, what: str) -> Path:
    """
    Return the path of results next to ``bag``, or to the bag of which it is a file.

    Those of a URL are in the working directory.
    """
    if is_url(bag):
        return Path(f'{bag_name(path_of(bag))}_{what}')
    path = path_of(bag).resolve()
    if not path.is_dir() and (path.parent / BAG_METADATA).exists():
        path = path.parent
    return path.with_name(f'{bag_name(path)}_{what}')


@contextmanager
def undone_if_interrupted(undo: Callable[[], None]) -> Iterator[None]:
    """Call ``undo`` at Ctrl-C: results that are not complete would refuse the next run."""
    try:
        yield
    except KeyboardInterrupt:
        undo()
        raise


def lock(folder: Path) -> None:
    """
    Create ``folder``, and lock it until this process ends.

    Raises ParameterError if another process has it, or if it cannot be created.
    """
    with explained(folder, 'written'):
        folder.mkdir(parents=True, exist_ok=True)
        try:
            fcntl.flock(os.open(folder, os.O_RDONLY), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ParameterError(
                f'another run writes to {folder}: choose another --out') from error


def refuse_existing(paths: Iterable[Path], *, force: bool, inputs: Iterable[Source] = ()) -> None:
    """Raise ParameterError if a path is an input or, without ``force``, if one exists."""
    read = {path_of(path).resolve() for path in inputs}
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


def refuse_folder_of_bag(out: Path, bags: Iterable[Source]) -> None:
    """Raise ParameterError if ``out`` is or is inside the folder of one of ``bags``."""
    for bag in bags:
        path = path_of(bag).resolve()
        folder = path if path.is_dir() else path.parent
        inside = path.is_dir() or (folder / BAG_METADATA).exists()  # not if a single file
        if out.resolve() == folder or inside and folder in out.resolve().parents:
            raise ParameterError(f'{out} is in the folder of the bag {bag}: choose another --out')


def remove_bag(folder: Path) -> None:
    """Delete the bag in ``folder``; call ``refuse_existing_bag`` before."""
    if folder.is_dir():
        remove(folder, _bag_files(folder))


def remove(folder: Path, names: Iterable[str], *, keep: bool = False) -> None:
    """Delete files of ``folder``, and the folder itself if it is empty then, unless ``keep``."""
    with explained(folder, 'replaced'):
        for name in names:
            (folder / name).unlink(missing_ok=True)
        if not keep and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def _bag_files(folder: Path) -> set[str]:
    files = re.compile(rf'{re.escape(folder.resolve().name)}_[0-9]+\.mcap')
    return {path.name for path in folder.iterdir() if files.fullmatch(path.name)} | {BAG_METADATA}
