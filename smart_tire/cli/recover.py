# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire recover``: repair a damaged bag."""

from __future__ import annotations

import argparse

from smart_tire.cli._bags import print_counts, print_warnings
from smart_tire.cli._outputs import (
    next_to, refuse_existing_bag, refuse_folder_of_bag, remove_bag, undone_if_interrupted)


def run(args: argparse.Namespace) -> int:
    """Write the repaired bag; print message counts and warnings."""
    out = args.out or next_to(args.bag, 'recovered')
    refuse_folder_of_bag(out, [args.bag])
    refuse_existing_bag(out, force=args.force)
    from smart_tire.bags import recover
    remove_bag(out)
    with undone_if_interrupted(lambda: remove_bag(out)):
        result = recover(args.bag, out)
    start_ns, end_ns = result.span_ns
    print(f'{out}: {sum(result.counts.values())} messages, {(end_ns - start_ns) * 1e-9:.1f} s')
    print_counts(result.counts)
    print_warnings(result.warnings)
    if not result.warnings and not result.losses:
        print('no damage found')
    return 0
