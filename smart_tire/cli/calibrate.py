# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire calibrate``: guided calibration of a robot, live or from recordings."""

from __future__ import annotations

import argparse
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from smart_tire.cli._bags import bag_settings
from smart_tire.cli._identified import NOT_IDENTIFIED, report, written
from smart_tire.cli._options import STEP_NAMES
from smart_tire.cli._outputs import refuse_existing
from smart_tire.errors import ParameterError
from smart_tire.parameters import load_node
from smart_tire.paths import write_text
from smart_tire.uncertain import Uncertain

if TYPE_CHECKING:
    from smart_tire.identification.calibrate import Bags
    from smart_tire.calibration.sequence import Calibration

PARAMETER_FILE, CAMERA_FILE = 'robot.yaml', 'overhead.yaml'
FIGURES = ('stiffness.png', 'motor.png', 'icr.png')
STEPS_OF = {'geometry': ('rest', 'turns'), 'icr': ('turns',), 'gains': ('turns',),
            'stiffness': ('straight',), 'motor': ('straight', 'lifted')}  # of ``--only``


def run(args: argparse.Namespace) -> int:
    """Record the steps unless bags are given, identify, and write the parameter file."""
    if args.kind:
        return calibrate_camera(args)
    if args.bags and (args.drive or args.lifted):
        raise ParameterError('--drive and --lifted are for a live calibration, without --bags')
    inputs = [*args.params, *(path for _, path in args.bags)]
    figures = FIGURES if args.only is None else (f'{args.only}.png',)
    refuse_existing([args.out / name for name in (PARAMETER_FILE, *figures)], force=args.force,
                    inputs=inputs)
    if args.bags:
        bags: dict[str, list[Path]] = {}
        for step, path in args.bags:
            bags.setdefault(step, []).append(path)
    else:
        from smart_tire.cli._calibrate_live import record_steps
        from smart_tire.parameters import load_robot
        bags = record_steps(args, load_robot(args.params), steps_of(args))
        if not bags:
            raise ParameterError('all steps were skipped: there is nothing to calibrate from')
    return identify(args, bags) if args.only is None else identify_only(args, bags)


def calibrate_camera(args: argparse.Namespace) -> int:
    """Find the places of the overhead camera and of the tags; return the exit status."""
    from smart_tire.identification.camera import calibrate
    from smart_tire.analysis.overhead import overhead_params
    from smart_tire.bags import Bag, TopicNames
    if args.bag is None:
        raise ParameterError('calibrate camera: a recording is needed')
    out = args.out / CAMERA_FILE
    refuse_existing([out], force=args.force, inputs=[args.bag, *args.params])
    with Bag(args.bag, TopicNames.parse(args.remap)) as bag:
        params = overhead_params(bag, args.params)
        bag.joints = params.robot.joints
        slip = load_node(args.params, 'slip_estimator')
        made = calibrate(bag, params, Uncertain(
            slip.icr_x, slip.icr_x_sigma * params.robot.wheelbase))
    args.out.mkdir(parents=True, exist_ok=True)
    return written(made, [args.bag], out, out)


def steps_of(args: argparse.Namespace) -> list[str]:
    """Return the steps of a live calibration."""
    steps = STEP_NAMES if args.only is None else STEPS_OF[args.only]
    return [step for step in steps if step != 'lifted' or args.lifted]


def identify_only(args: argparse.Namespace, bags: Bags) -> int:
    """Identify the kind ``--only``, as ``smart_tire identify`` does; return the exit status."""
    from smart_tire.identification.identify import Source
    from smart_tire.identification.robot import known
    ground, lifted = ([path for step, paths in bags.items() for path in paths
                       if (step == 'lifted') is off] for off in (False, True))
    if not ground:
        raise ParameterError(f'--only {args.only}: no recording on the ground')
    used, names, status = bag_settings(
        [*ground, *lifted], args, ground if args.checks else ())
    return report(args.only, Source(
        ground, known(used.params.robot, used.given), reference='any' if args.truth else 'none',
        names=names, lifted=lifted), args.out / PARAMETER_FILE,
        args.out / f'{args.only}.png') or status


def identify(args: argparse.Namespace, bags: Bags) -> int:
    """Identify from ``bags``, print a table, write parameter file and figures."""
    from smart_tire.identification.calibrate import calibrate_bags, figures
    from smart_tire.analysis.drawing import save_all
    used, names, status = bag_settings(
        [path for paths in bags.values() for path in paths], args,
        [path for step, paths in bags.items() if step != 'lifted' for path in paths]
        if args.checks else ())
    result = calibrate_bags(bags, used.params, f'{date.today():%Y-%m-%d}', truth=args.truth,
                            names=names, given=used.given)
    found = result.calibration
    print_calibration(found)
    if not found.found:
        print('nothing could be identified from these recordings: no file is written')
        return NOT_IDENTIFIED
    args.out.mkdir(parents=True, exist_ok=True)
    out = args.out / PARAMETER_FILE
    write_text(out, result.text)
    drawn = save_all(figures(found), args.out)
    print(f'written to {", ".join(map(str, (out, *drawn)))}')
    return status


def print_calibration(found: Calibration) -> None:
    """Print the identified values, and the reasons of those that are kept."""
    for one in found.found.values():
        shown = one.rounded()
        error = '' if shown.sigma is None else f' ± {shown.sigma}'
        print(f'{one.name:34}{shown.value}{error}  {one.step}'
              + (f', {one.note}' if one.note else ''))
    for name, reason in found.kept.items():
        print(f'{name:34}kept: {reason}')
    for note in found.notes:
        print(f'note: {note}')
