# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""``smart_tire overhead``: pose, velocity and slip from the images of a camera above the floor."""

from __future__ import annotations

import argparse
import math

from smart_tire.cli._bags import print_warnings
from smart_tire.cli._outputs import (
    refuse_existing, refuse_existing_bag, refuse_folder_of_bag, remove, remove_bag,
    undone_if_interrupted)
from smart_tire.cli._progress import ProgressLine
from smart_tire.paths import bag_name

ESTIMATED, NOTHING_ESTIMATED = 0, 1  # exit statuses


def run(args: argparse.Namespace) -> int:
    """Estimate from the images in a bag, write the results; return the exit status."""
    from smart_tire.analysis.overhead import locate, overhead_params, write
    from smart_tire.bags import Bag, TopicNames
    refuse_folder_of_bag(args.out, [args.bag])
    refuse_existing_bag(args.out / 'estimates', force=args.force)
    refuse_existing([args.out / name for name in ('summary.json', 'camera.png')], force=args.force)
    given = {} if math.isnan(args.time_offset) else {'overhead.time_offset': args.time_offset}
    with Bag(args.bag, TopicNames.parse(args.remap)) as bag:
        params = overhead_params(bag, args.params, **given)
        bag.joints = params.robot.joints
        with ProgressLine(bag_name(args.bag)) as progress:
            result = locate(bag, params, progress.share)
        notes = [*bag.notes, *bag.faults.lines()]
        print_warnings(bag.warnings)
    for note in notes:
        print(f'  {note}')

    def remove_results() -> None:
        remove_bag(args.out / 'estimates')
        remove(args.out, ['camera.png', 'summary.json'])

    remove_results()
    with undone_if_interrupted(remove_results):
        write(result, args.bag, args.out, params, notes)
    if not result.motions:
        print(f'{args.bag}: nothing can be estimated: {result.line()}')
        return NOTHING_ESTIMATED
    offset = result.offset
    print(f'{args.bag}: {result.line()}')
    print(f'  time offset {offset.value:.4f} +- {offset.sigma:.4f} s ({result.offset_source})')
    print(f'  pixel noise {result.noise:.3f} pixels, {len(result.slips)} instants with slip')
    print(f'  written to {args.out}')
    return ESTIMATED
