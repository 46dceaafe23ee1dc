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
``smart_tire demo`` on a busy machine: exit status and what it says about the host, run by run.

``make demo-loaded RUNS=10`` runs it; the exit status is 1 if one of the demos has failed.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
import re
import subprocess
import sys
import time

from soak import BUSY, running

LOOPS_PER_CORE = 2
# The lines that are shown: what the demo says about the host and its errors.
SAID = re.compile(r'host late|.*x real time|starved|demo: |smart_tire demo: (?!working)')


def main() -> int:
    """Run the demos; return 1 if one has failed."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--runs', type=int, default=10, help='demos (%(default)s)')
    parser.add_argument('--loops', type=int, default=LOOPS_PER_CORE * (os.cpu_count() or 1),
                        help='busy processes at the same time (%(default)s: two per core)')
    parser.add_argument('--out', type=Path, default=Path('bench_output/demo-loaded'),
                        help='folder of the results (%(default)s)')
    args = parser.parse_args()
    failed = 0
    with running(args.loops, BUSY):
        for run in range(1, args.runs + 1):
            begin = time.monotonic()
            result = subprocess.run(
                [sys.executable, '-m', 'smart_tire.cli.main', 'demo', '--force', '--seed',
                 str(run), '--out', str(args.out / f'{run}')],
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
            failed += result.returncode != 0
            print(f'run {run}: exit {result.returncode} after {time.monotonic() - begin:.0f} s, '
                  f'load {os.getloadavg()[0]:.1f}', flush=True)
            (args.out / f'{run}' / 'terminal.txt').write_text(result.stdout)
            for line in result.stdout.splitlines():
                if SAID.match(line):
                    print(f'  {line}', flush=True)
    print(f'{args.runs - failed} of {args.runs} demos ended with status 0')
    return int(failed > 0)


if __name__ == '__main__':
    sys.exit(main())
