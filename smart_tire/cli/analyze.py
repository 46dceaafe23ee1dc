"""``smart_tire analyze``: recorded inputs through the estimators, faster than real time."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import sys
from typing import TYPE_CHECKING

from smart_tire.cli._overwrite import (
    add_force, FIGURES, refuse_existing, refuse_existing_bag, refuse_folder_of_bag)
from smart_tire.errors import BagError

if TYPE_CHECKING:
    from smart_tire.analysis.offline import Progress
    from smart_tire.analysis.pipeline import EstimatorParams

NAME = 'analyze'
HELP = 'estimate slip, friction and path from bags, as fast as it can'
ESTIMATED, NOTHING, USAGE = 0, 1, 2
STEP = 0.25  # of a bag, between two lines of progress where there is no terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments of this verb."""
    parser.add_argument('bags', type=Path, nargs='+', metavar='BAG',
                        help='rosbag2 folder, or a file of one')
    parser.add_argument('--params', type=Path, action='append', default=[], metavar='FILE',
                        help='ROS parameter file; may be repeated, later ones win')
    parser.add_argument('--out', type=Path, required=True, metavar='DIR',
                        help='folder for estimates, summary.json and figures')
    parser.add_argument('--smooth', action='store_true',
                        help='also say what the whole bag tells of each instant: DIR/smoothed')
    parser.add_argument('--no-figures', action='store_true', help='draw nothing')
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Analyze the bags one after the other; the worst of them gives the exit status."""
    names = [folder_name(bag) for bag in args.bags]
    for name, count in Counter(names).items():
        if count > 1:
            print(f'smart_tire analyze: {count} bags are named {name}', file=sys.stderr)
            return USAGE
    outs = [args.out] if len(args.bags) == 1 else [args.out / name for name in names]
    for out in outs:
        check_out(out, args)
    from smart_tire.analysis.pipeline import EstimatorParams
    params = EstimatorParams.load(args.params)
    status = ESTIMATED
    for bag, out in zip(args.bags, outs):
        try:
            status = max(status, analyze_one(
                bag, out, params, figures=not args.no_figures, smooth=args.smooth))
        except BagError as error:
            print(f'smart_tire analyze: {error}', file=sys.stderr)
            status = USAGE
    return status


def check_out(out: Path, args: argparse.Namespace) -> None:
    """Raise ParameterError if ``out`` holds results or belongs to a bag that is read."""
    refuse_folder_of_bag(out, args.bags)
    for folder in ('estimates', 'smoothed')[:1 + args.smooth]:
        refuse_folder_of_bag(out / folder, args.bags)
        refuse_existing_bag(out / folder, force=args.force)
    figures = () if args.no_figures else FIGURES
    refuse_existing([out / name for name in ('summary.json', *figures)], force=args.force)


def folder_name(bag: Path) -> str:
    """Return the name of a bag: that of its folder, or of its file without suffix."""
    bag = bag.resolve()
    return bag.name if bag.is_dir() else bag.stem


def analyze_one(bag: Path, out: Path, params: EstimatorParams, *, figures: bool,
                smooth: bool) -> int:
    """Analyze one bag into ``out`` and print what it tells; return the exit status."""
    from smart_tire.analysis.offline import analyze
    from smart_tire.analysis.report import lines
    with shown_progress(folder_name(bag)) as progress:
        result = analyze(bag, out, params, progress, smooth=smooth)
    if result.summary is None:
        print(f'{bag}: nothing to estimate')
        for text in result.intake.left_out:
            print(f'  left out: {text}')
        return NOTHING
    for line in lines(result.summary):
        print(line)
    if figures:
        from smart_tire.analysis.figures import write_figures
        write_figures(out, result.intake.inputs, result.estimates, result.intake.truth,
                      params.robot, smoothed=result.smoothed)
    print(f'  written to {out}')
    return ESTIMATED


@contextmanager
def shown_progress(name: str) -> Iterator[Progress]:
    """Give a function that shows the share that is done: a bar on a terminal, else lines."""
    from rich.progress import Progress as Bars
    if not sys.stdout.isatty():
        yield Lines(name).show
        return
    # No thread of its own that redraws it: the analysis forks.
    with Bars(transient=True, auto_refresh=False) as bars:
        bar = bars.add_task(name, total=1.0)
        yield lambda share: bars.update(bar, completed=share, refresh=True)


class Lines:
    """Progress where nothing can be drawn over: a line now and then."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._next = STEP

    def show(self, share: float) -> None:
        """Print a line if enough was done since the last one."""
        if share >= self._next:
            print(f'{self._name}: {100.0 * share:.0f} %', flush=True)
            self._next = share - share % STEP + STEP
