# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire analyze --dataset``: many bags into one data set."""

from __future__ import annotations

import argparse
from collections import Counter
from contextlib import closing
import time

from smart_tire.cli._bags import (
    check_options, CONTRADICTED, DIVERGED, each_item, ESTIMATED, NOTHING_ESTIMATED, USAGE)
from smart_tire.errors import OutputError, ParameterError
from smart_tire.findings import counted
from smart_tire.fleet import drives
from smart_tire.fleet.dataset import Dataset
from smart_tire.fleet.drives import AnalyzedDrive, drive_name, DriveJob
from smart_tire.fleet.page import write_page

INCOMPLETE = 3
STATUSES = {drives.ESTIMATED: ESTIMATED, drives.NOTHING: NOTHING_ESTIMATED,
            drives.DIVERGED: DIVERGED, drives.UNREADABLE: USAGE, drives.INCOMPLETE: INCOMPLETE,
            drives.CONTRADICTED: CONTRADICTED}  # as of other verbs


def write_dataset(args: argparse.Namespace) -> int:
    """Write all bags that are not done; print a line for each; return the exit status."""
    if args.smooth or args.formats or args.overhead or args.no_figures:
        raise ParameterError('--dataset has no smoothed estimates, exports and figures: leave '
                             'out --smooth, --tum, --kitti, --csv, --parquet, --overhead and '
                             '--no-figures')
    check_options(args)
    dataset = Dataset(args.dataset.resolve())
    job = DriveJob(dataset.folder, time.sleep, tuple(path.resolve() for path in args.params),
                   tuple(args.remap), args.robot, args.checks, args.reports, args.force)
    bags = list({drive_name(bag): bag for bag in args.bags}.values())
    became: Counter[str] = Counter()
    with closing(each_item(args, job, bags, isolated=True)) as results:
        for source, value in results:
            if isinstance(value, OutputError):
                raise value
            drive = job.unreadable(source, value) if isinstance(value, BaseException) else value
            became['done before' if drive.done_before else drive.row['status']] += 1
            if not drive.done_before:
                print(f'{source}: {line(drive)}', flush=True)
    write_page(dataset)
    print(f'{counted(len(bags), "bag")}: '
          + ', '.join(f'{count} {what}' for what, count in became.most_common())
          + f'; written to {args.dataset}')
    found = [STATUSES[status] for status in became if status in STATUSES]
    return max((one for one in found if one != INCOMPLETE), default=0) or (
        INCOMPLETE if INCOMPLETE in found else ESTIMATED)


def line(drive: AnalyzedDrive) -> str:
    """Return what became of a bag, as one line."""
    row = drive.row
    if row.get('distance') is None:
        return f'{row["status"]}: {row["error"]}'
    return ', '.join([row['status'], *filter(None, [drive.robot, drive.date]),
                      f'{row["distance"]:.1f} m', counted(len(row['errors']), 'error'),
                      counted(len(row['warnings']), 'warning')])
