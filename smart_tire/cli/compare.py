# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire compare``: runs next to each other in one table and one figure."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from smart_tire.cli._bags import (
    analyzed, check_options, NOTHING_ESTIMATED, print_comparison)
from smart_tire.cli._outputs import (
    COMPARISON, export_names, folder_names, refuse_existing, refuse_folder_of_bag, remove,
    undone_if_interrupted)
from smart_tire.errors import ParameterError
from smart_tire.paths import is_analysis

REFERENCES = 'ground_truth/', 'overhead/'  # begin of their names

if TYPE_CHECKING:
    from smart_tire.analysis.result import Result


def run(args: argparse.Namespace) -> int:
    """Compare all runs; return the largest exit status."""
    jobs = labeled(args.runs, args.variants)
    exports = export_names(args.formats)
    if args.out is not None:
        refuse_folder_of_bag(args.out, args.runs)
        refuse_existing([*(args.out / name for name in COMPARISON), *(
            args.out / label / name for label in jobs for name in exports)], force=args.force)
    elif exports:
        raise ParameterError(f'--{args.formats[0]} needs --out DIR for its files')
    for _, files in jobs.values():
        check_options(argparse.Namespace(params=files, remap=args.remap))
    results, status = results_of(jobs, args)
    if not results:
        return status

    def remove_results() -> None:
        for label in results if exports else ():
            remove(args.out / label, exports)
        if args.out is not None:
            remove(args.out, COMPARISON)

    with undone_if_interrupted(remove_results):
        print_comparison(results, args.out, figure=True)
        if exports:
            from smart_tire.analysis.export import export
            for label, one in results.items():
                export(args.out / label, one.comparisons, args.formats)
    return status


def results_of(jobs: Mapping[str, tuple[Path, list[Path]]], args: argparse.Namespace
               ) -> tuple[dict[str, Result], int]:
    """Return the results of all ``jobs`` that have any, by label, and the exit status."""
    from smart_tire.analysis.comparison import read_analysis, read_references
    from smart_tire.bags import TopicNames
    given = None
    if args.truth is not None:  # its topics are not those of the runs
        references = [one for one in args.remap if one.strip('/').startswith(REFERENCES)]
        given = read_references(args.truth, TopicNames.parse(references))
        args = argparse.Namespace(**{
            **vars(args), 'remap': [one for one in args.remap if one not in references]})
    results: dict[str, Result] = {}
    status = 0
    for label, (path, files) in jobs.items():
        if is_analysis(path):
            results[label] = read_analysis(path)
            continue
        found, own = result_of(label, path, argparse.Namespace(**{**vars(args), 'params': files}))
        status = max(status, own)
        if found is not None:
            results[label] = found
    if given is not None:
        results = {label: replace(one, truth=given.truth, camera=given.camera)
                   for label, one in results.items()}
    return {label: replace(one, align=args.align) for label, one in results.items()}, status


def labeled(paths: Sequence[Path], variants: Sequence[list[Path]]
            ) -> dict[str, tuple[Path, list[Path]]]:
    """
    Return path and parameter files of each run, by its label; raise ParameterError.

    Each of ``variants`` are the parameter files of one run of each bag.
    """
    jobs = [(' '.join(filter(None, [
        name if len(paths) > 1 or not files else '', '+'.join(file.stem for file in files)])),
        (path, files)) for path, name in zip(paths, folder_names(paths))
        for files in variants or [[]]]
    for label, count in Counter(label for label, _ in jobs).items():
        if count > 1:
            raise ParameterError(f'{count} runs have the name {label}')
    return dict(jobs)


def result_of(label: str, bag: Path, args: argparse.Namespace) -> tuple[Result | None, int]:
    """Return what is estimated from a bag, None if nothing is, and the exit status."""
    from smart_tire.recording import SampleArrays
    print(f'{label}:')
    found = analyzed(bag, label, args, prefix='  ', smooth=args.smooth)
    if found is None:
        return None, NOTHING_ESTIMATED
    return replace(found.analysis.result, inputs=SampleArrays()), found.status
