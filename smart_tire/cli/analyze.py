# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire analyze``: run the estimators offline on bags."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from smart_tire.cli._bags import (
    analyzed, check_options, check_overhead, diverged, each_bag, NOTHING_ESTIMATED,
    print_comparison)
from smart_tire.cli._outputs import (
    COMPARISON, export_names, FIGURES, folder_names, next_to, refuse_existing, refuse_existing_bag,
    refuse_folder_of_bag, remove, remove_bag, undone_if_interrupted)
from smart_tire.errors import ParameterError
from smart_tire.fleet import Source
from smart_tire.paths import bag_name, check_writable

if TYPE_CHECKING:
    from smart_tire.analysis.result import Result


MAX_COMPARED = 20  # bags; the paths of more cannot be distinguished in one figure


def run(args: argparse.Namespace) -> int:
    """Analyze all bags, compare some, or write a data set; return the largest exit status."""
    if args.dataset is not None:
        from smart_tire.cli._dataset import write_dataset
        return write_dataset(args)
    if args.reports or args.robot:
        raise ParameterError('--reports and --robot are for --dataset DIR')
    outs = output_folders(args.bags, args.out)
    common = args.out if len(outs) > 1 else None  # of the files that compare the results
    for out in outs.values():
        check_writable(out)
        check_out(out, args)
    if common is not None:
        refuse_existing([common / name for name in COMPARISON], force=args.force)
    check_options(args)
    check_overhead(args)
    with undone_if_interrupted(partial(remove_results, outs.values(), common, args)):
        status, found = each_bag(args, args.bags, list(outs.values()), analyze_one)
        results = {name: one for name, out in outs.items() if (one := found.get(out)) is not None}
        if len(results) > 1:
            print_comparison(results, common, figure=not args.no_figures)
    return status


def output_folders(bags: Sequence[Source], out: Path | None) -> dict[str, Path]:
    """Return the folder for the results of each bag, by its name; raise ParameterError."""
    names = folder_names(bags)
    for name, count in Counter(names).items():
        if count > 1:
            raise ParameterError(f'{count} bags have the name {name}')
    if out is None:
        return {name: next_to(bag, 'analyzed') for name, bag in zip(names, bags)}
    return {name: out / name if len(bags) > 1 else out for name in names}


def remove_results(outs: Iterable[Path], common: Path | None, args: argparse.Namespace) -> None:
    """Delete all results of this run."""
    for out in outs:
        for folder in ('estimates', 'smoothed')[:1 + args.smooth]:
            remove_bag(out / folder)
        remove(out, result_names(args))
    if common is not None:
        remove(common, COMPARISON)


def check_out(out: Path, args: argparse.Namespace) -> None:
    """Raise ParameterError if ``out`` contains results or is inside an input bag."""
    refuse_folder_of_bag(out, args.bags)
    for folder in ('estimates', 'smoothed')[:1 + args.smooth]:
        refuse_folder_of_bag(out / folder, args.bags)
        refuse_existing_bag(out / folder, force=args.force)
    refuse_existing([out / name for name in result_names(args)], force=args.force)


def result_names(args: argparse.Namespace) -> list[str]:
    """Return the files next to the bags of estimates."""
    return ['summary.json', *(() if args.no_figures else FIGURES), *export_names(args.formats)]


def analyze_one(bag: Path, out: Path, args: argparse.Namespace, url: str | None
                ) -> tuple[int, Result | None]:
    """
    Analyze one bag, write the results to ``out``, print a report.

    ``bag`` may be a copy of that at ``url``. Return exit status, and the result if the bag is one
    of a few, which are compared.
    """
    from smart_tire.analysis.export import export
    from smart_tire.analysis.tables import lines
    from smart_tire.recording import SampleArrays
    found = analyzed(bag, bag_name(bag), args, out=out, smooth=args.smooth,
                     overhead=args.overhead, origin=url)
    if found is None:
        return NOTHING_ESTIMATED, None
    for line in lines(found.summary):
        print(line)
    for note in found.analysis.contents.notes:
        if note not in found.bag.notes:  # found out while reading
            print(f'  {note}')
    if not args.no_figures:
        from smart_tire.analysis.figures import write_figures
        write_figures(out, found.analysis.result, found.source.params.robot)
    result = found.analysis.result
    export(out, result.comparisons, args.formats)
    print(f'  written to {out}')
    compared = replace(result, inputs=SampleArrays()) if len(args.bags) <= MAX_COMPARED else None
    return diverged(bag, found.summary, found.status), compared
