"""
Where verbs write: what exists is replaced with ``--force`` only, what was read never.

Even then no file is deleted but those that the program itself writes, known by their names.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
import os
from pathlib import Path

from smart_tire.errors import ParameterError

FIGURES = ('slip.png', 'path.png', 'friction.png', 'contact.png')  # of analysis/figures.py
METADATA = 'metadata.yaml'  # of a bag


def add_force(parser: argparse.ArgumentParser) -> None:
    """Let the user ask for the replacement of former results."""
    parser.add_argument('--force', action='store_true', help='replace results that exist')


def refuse_existing(paths: Iterable[Path], *, force: bool, inputs: Iterable[Path] = ()) -> None:
    """Raise ParameterError for the first path that exists, with ``force`` if it is an input."""
    read = {path.resolve() for path in inputs}
    for path in paths:
        if path.resolve() in read:
            raise ParameterError(f'{path} is what is read: choose another --out')
        if os.path.lexists(path) and not force:
            raise ParameterError(f'{path} exists: choose another --out, or --force to replace it')


def refuse_existing_bag(folder: Path, *, force: bool) -> None:
    """Raise ParameterError if ``folder`` exists, with ``force`` if it holds what is not ours."""
    refuse_existing([folder], force=force)
    if not os.path.lexists(folder):
        return
    if not folder.is_dir():
        raise ParameterError(f'{folder} is a file: choose another --out')
    if others := {path.name for path in folder.iterdir()} - _bag_files(folder):
        raise ParameterError(f'{folder} holds {min(others)}, which --force does not delete: '
                             'choose another --out')


def refuse_folder_of_bag(out: Path, bags: Iterable[Path]) -> None:
    """Raise ParameterError if ``out`` is, or is in, the folder of one of ``bags``."""
    for bag in bags:
        path = bag.resolve()
        folder = path if path.is_dir() else path.parent
        inside = path.is_dir() or (folder / METADATA).exists()  # a lone file may lie anywhere
        if out.resolve() == folder or inside and folder in out.resolve().parents:
            raise ParameterError(f'{out} is in the folder of the bag {bag}: choose another --out')


def remove_bag(folder: Path) -> None:
    """Delete the bag in ``folder``, which ``refuse_existing_bag`` has let pass."""
    if folder.is_dir():
        remove(folder, _bag_files(folder))


def remove(folder: Path, names: Iterable[str]) -> None:
    """Delete files of ``folder``, and the folder itself if nothing else is in it."""
    try:
        for name in names:
            (folder / name).unlink(missing_ok=True)
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
    except OSError as error:
        raise ParameterError(f'{folder}: cannot be replaced ({error.strerror})') from error


def _bag_files(folder: Path) -> set[str]:
    return {f'{folder.resolve().name}_0.mcap', METADATA}
