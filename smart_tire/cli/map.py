# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire map``: friction map of the places that one or many drives have passed."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from smart_tire.cli._bags import (
    check_options, each_bag, lacks_inputs, NOTHING_ESTIMATED, open_bag)
from smart_tire.cli._outputs import (
    folder_names, refuse_existing, refuse_existing_bag, refuse_folder_of_bag, remove, remove_bag,
    undone_if_interrupted)
from smart_tire.cli._progress import ProgressLine
from smart_tire.paths import analyzed_bag, bag_name, is_analysis

if TYPE_CHECKING:
    from smart_tire.mapping.track import FrictionTrack

MAPPED = 0  # exit status


def run(args: argparse.Namespace) -> int:
    """Map the friction on all drives; return the largest exit status of any."""
    from smart_tire.analysis.friction_map import FILES, MASK_FILES, write_map, write_mask
    from smart_tire.mapping.grid import friction_map
    from smart_tire.parameters import load_node
    names = (*FILES, *MASK_FILES) if args.stop_within else FILES
    refuse_folder_of_bag(args.out, args.runs)
    refuse_existing([args.out / name for name in names], force=args.force)
    refuse_existing_bag(args.out / 'bag', force=args.force)
    check_options(args)
    control = load_node(args.params, 'trajectory_controller')
    drives = folder_names(args.runs)
    status, results = each_bag(args, args.runs, drives, track_of)
    tracks = [results[drive] for drive in drives if results.get(drive) is not None]
    if not tracks:
        print('no drive has any estimate of friction: no map')
        return max(status, NOTHING_ESTIMATED)
    found = friction_map(tracks, args.resolution)

    def remove_results() -> None:
        remove_bag(args.out / 'bag')
        remove(args.out, names)

    remove_results()
    with undone_if_interrupted(remove_results):
        write_map(args.out, found, tracks)
        if args.stop_within:
            write_mask(args.out, found, control, args.stop_within)
    rows, columns = found.raster.friction.shape
    print(f'{int(found.cells.current.sum())} of {columns} x {rows} cells of '
          f'{args.resolution:g} m in {found.raster.frame}, from {len(tracks)} drives; '
          f'{int((found.cells.current == 0).sum())} grounds before changes')
    print(f'  written to {args.out}')
    return status


def track_of(path: Path, name: str, args: argparse.Namespace, _: str | None
             ) -> tuple[int, FrictionTrack | None]:
    """Return status and track of a bag or an analysis, named ``name``; None without friction."""
    from smart_tire.analysis import friction_map
    from smart_tire.analysis.comparison import read_analysis
    from smart_tire.analysis.offline import analyze
    from smart_tire.analysis.pipeline import bag_params
    from smart_tire.bags import Bag, TopicNames
    with ExitStack() as stack:
        if is_analysis(path):
            result = read_analysis(path)
            estimates, camera = result.estimates, result.camera
            with Bag(path / 'estimates') as written:
                robot = bag_params(written, args.params).params.robot
            recorded = analyzed_bag(path)
            bag = recorded and stack.enter_context(Bag(recorded[0], TopicNames(recorded[1])))
        else:
            bag, source = stack.enter_context(open_bag(path, args, prefix=f'{name}: '))
            if lacks_inputs(bag):
                return MAPPED, None
            robot = source.params.robot
            with ProgressLine(bag_name(path)) as progress:
                found = analyze(path, None, source.params, progress.share, names=bag.names,
                                source=source)
            estimates, camera = found.estimates, found.contents.camera
        track = friction_map.track_of(estimates, camera, robot, bag, drive=name)
    if not len(track):
        print(f'{name}: no friction was estimated')
        return MAPPED, None
    return MAPPED, track
