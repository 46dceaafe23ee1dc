# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire report``: one HTML file per bag, with interactive figures and tables."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path

import smart_tire
from smart_tire.cli._bags import (
    analyzed, check_options, check_overhead, diverged, each_bag, NOTHING_ESTIMATED)
from smart_tire.cli._outputs import refuse_existing, refuse_folder_of_bag
from smart_tire.errors import ParameterError
from smart_tire.fleet import path_of, Source
from smart_tire.paths import bag_name, write_text

SUFFIXES = ('.html', '.htm')
DEMO_BAG = 'bag'  # folder of the bag in the output of "smart_tire demo", which has no name


def run(args: argparse.Namespace) -> int:
    """Write the reports of all bags; return the largest exit status."""
    outs = output_files(args.bags, args.out, Path.cwd() if args.dask else Path())
    for out in outs:
        refuse_folder_of_bag(out, args.bags)
    refuse_existing(outs, force=args.force, inputs=[*args.bags, *args.params])
    check_options(args)
    check_overhead(args)
    return each_bag(args, args.bags, outs, report_one)[0]


def output_files(paths: Sequence[Source], out: Path | None, folder: Path) -> list[Path]:
    """
    Return the file to write for each of ``paths``, in ``folder`` if ``out`` is not given.

    Raises ParameterError if two are equal.
    """
    if out is not None and out.suffix in SUFFIXES:
        if len(paths) > 1:
            raise ParameterError(f'--out {out} is one file for {len(paths)} bags: give a folder')
        return [out]
    names = [f'{report_name(path_of(path))}_report.html' for path in paths]
    for name, count in Counter(names).items():
        if count > 1:
            raise ParameterError(f'{count} bags would be written to {name}: report them one by '
                                 'one')
    return [(out or folder) / name for name in names]


def report_name(bag: Path) -> str:
    """Return the title of the report: the name of the bag, of its folder if it has none."""
    name = bag_name(bag)
    return bag.resolve().parent.name if name == DEMO_BAG else name


def report_one(bag: Path, out: Path, args: argparse.Namespace, url: str | None
               ) -> tuple[int, None]:
    """Analyze one bag, which may be a copy of that at ``url``, and write its report."""
    from smart_tire.analysis.html_report.content import report_of
    from smart_tire.analysis.html_report.page import html_page
    from smart_tire.analysis.tables import date_text
    found = analyzed(bag, report_name(bag), args, consequence=', no report is written',
                     overhead=args.overhead)
    if found is None:
        return NOTHING_ESTIMATED, None
    facts = [('Recorded', date_text(found.analysis.contents.start_ns)),
             ('Bag', url or str(bag.resolve())),
             ('Report', f'{datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC'),
             ('Software', f'smart_tire {smart_tire.__version__}')]
    write_text(out, html_page(report_of(
        found.analysis, found.source, report_name(bag), facts)))
    print(f'{bag}: report written to {out} ({out.stat().st_size / 1e6:.1f} MB)')
    return diverged(bag, found.summary, found.status), None
