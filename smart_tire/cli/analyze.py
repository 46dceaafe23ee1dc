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
from collections.abc import Sequence
from pathlib import Path

from smart_tire.cli._bags import (
    check_options, check_overhead, diverged, each_bag, lacks_inputs, NOTHING_ESTIMATED, open_bag,
    print_errors)
from smart_tire.cli._outputs import (
    FIGURES, refuse_existing, refuse_existing_bag, refuse_folder_of_bag)
from smart_tire.cli._progress import ProgressLine
from smart_tire.errors import ParameterError
from smart_tire.paths import bag_name


def run(args: argparse.Namespace) -> int:
    """Analyze all bags; return the largest exit status."""
    names = folder_names(args.bags)
    for name, count in Counter(names).items():
        if count > 1:
            raise ParameterError(f'{count} bags have the name {name}')
    outs = [args.out] if len(args.bags) == 1 else [args.out / name for name in names]
    for out in outs:
        check_out(out, args)
    check_options(args)
    check_overhead(args)
    return each_bag(args, outs, analyze_one)


def check_out(out: Path, args: argparse.Namespace) -> None:
    """Raise ParameterError if ``out`` contains results or is inside an input bag."""
    refuse_folder_of_bag(out, args.bags)
    for folder in ('estimates', 'smoothed')[:1 + args.smooth]:
        refuse_folder_of_bag(out / folder, args.bags)
        refuse_existing_bag(out / folder, force=args.force)
    figures = () if args.no_figures else FIGURES
    refuse_existing([out / name for name in ('summary.json', *figures)], force=args.force)


def folder_names(bags: Sequence[Path]) -> list[str]:
    """Return a name for each bag: its own, or that of its folder where the names are equal."""
    names = [bag_name(bag) for bag in bags]
    if len(set(names)) < len(names):
        folders = [bag.resolve().parent.name for bag in bags]
        return folders if len(set(folders)) == len(folders) else names
    return names


def analyze_one(bag: Path, out: Path, args: argparse.Namespace) -> int:
    """Analyze one bag, write the results to ``out``, print a report; return the exit status."""
    from smart_tire.analysis.offline import analyze
    from smart_tire.analysis.tables import lines
    with open_bag(bag, args) as (opened, source):
        params, shown = source.params, opened.notes
        if lacks_inputs(opened):
            return NOTHING_ESTIMATED
    with ProgressLine(bag_name(bag)) as progress:
        analysis = analyze(bag, out, params, progress.share, smooth=args.smooth,
                           names=opened.names, source=source, checks=args.checks,
                           overhead=args.overhead)
    status = print_errors(analysis.contents.errors)
    if analysis.summary is None:
        print(f'{bag}: nothing can be estimated')
        for text in analysis.contents.skipped:
            print(f'  skipped: {text}')
        return NOTHING_ESTIMATED
    for line in lines(analysis.summary):
        print(line)
    for note in analysis.contents.notes:
        if note not in shown:  # found out while reading
            print(f'  {note}')
    if not args.no_figures:
        from smart_tire.analysis.figures import write_figures
        write_figures(out, analysis.result, params.robot)
    print(f'  written to {out}')
    return diverged(bag, analysis.summary, status)
