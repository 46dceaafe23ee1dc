# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire reproduce``: figures and tables of both papers from models and simulation."""

from __future__ import annotations

import argparse
from pathlib import Path

from smart_tire.cli._outputs import refuse_existing, remove, undone_if_interrupted
from smart_tire.cli._progress import ProgressLine
from smart_tire.paths import explained


def run(args: argparse.Namespace) -> int:
    """Simulate the experiments and write figures and report; return the exit status."""
    def written() -> list[Path]:
        return [args.out / 'report.html', *sorted(args.out.glob('paper_*.png'))]

    refuse_existing(written(), force=args.force)
    from smart_tire.papers.runner import reproduce
    with explained(args.out, 'written'), ProgressLine('smart_tire reproduce') as progress, (
            undone_if_interrupted(lambda: remove(args.out, [path.name for path in written()]))):
        report = reproduce(args.out, lambda done, total, what: progress.show(
            f'{done}/{total}  {what}'))
    print(f'written to {report}')
    return 0
