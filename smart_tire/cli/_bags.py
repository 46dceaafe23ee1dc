# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags as inputs of the verbs: opened with their options, estimated one by one, reported."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, ExitStack, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from itertools import count as numbers
import logging
from logging.handlers import BufferingHandler
from pathlib import Path
import sys
import time
from typing import Any, NamedTuple, TYPE_CHECKING, TypeVar

from smart_tire.cli._progress import ProgressLine, remaining
from smart_tire.errors import BagError, ParameterError, printable, SmartTireError
from smart_tire.findings import Finding, Level
from smart_tire.fleet import is_url, local_bag, Source
from smart_tire.fleet.running import jobs_for, Outcome, run_each

if TYPE_CHECKING:
    from smart_tire.analysis.offline import Analysis
    from smart_tire.analysis.pipeline import BagParams
    from smart_tire.analysis.result import Result
    from smart_tire.analysis.summary import Tree
    from smart_tire.bags import Bag, TopicNames

REQUIRED = ('imu/data', 'wheel_states')  # inputs without which nothing is estimated
ESTIMATED, NOTHING_ESTIMATED, DIVERGED, USAGE, CONTRADICTED = 0, 1, 1, 2, 4  # exit statuses
FAILED = 1
BAG_LOGGER = 'smart_tire.bags'  # of the losses
MAX_LOSSES = 100  # lines about a bag
Item = TypeVar('Item')
Value = TypeVar('Value')


def check_options(args: argparse.Namespace) -> None:
    """Raise ParameterError if an option of ``--params`` and ``--remap`` is invalid for any bag."""
    from smart_tire.analysis.pipeline import EstimatorParams
    from smart_tire.bags import TopicNames
    EstimatorParams.load(args.params)
    TopicNames.parse(args.remap)


def check_overhead(args: argparse.Namespace) -> None:
    """Raise ParameterError or BagError if ``--overhead`` cannot be used with these bags."""
    if args.overhead is not None:
        from smart_tire.analysis.offline import read_overhead
        if len(args.bags) > 1:
            raise ParameterError(f'--overhead is for one bag, {len(args.bags)} are given')
        read_overhead(args.overhead)


@contextmanager
def open_bag(path: Path, args: argparse.Namespace, *, required: Collection[str] = REQUIRED,
             prefix: str = '', estimates: Path | None = None) -> Iterator[tuple[Bag, BagParams]]:
    """
    Open a bag with the options of ``--params`` and ``--remap``; yield it and its parameters.

    Without ``--params`` these are those with which the bag of ``estimates``, if given, was made.

    Prints the source of the parameters, and the topics and joints that were recognized, with
    ``prefix`` before each line. Raises BagError if one of the ``required`` topics has to be
    selected with an option, ParameterError if an option or a parameter is invalid.
    """
    from smart_tire.analysis.pipeline import bag_params, NODES
    from smart_tire.bags import Bag, check_inputs, TopicNames
    with Bag(path, TopicNames.parse(args.remap)) as bag:
        source = bag_params(bag, args.params)
        if estimates is not None and not args.params:
            with Bag(estimates) as made:
                own = bag_params(made)
            source = own if set(NODES) <= set(own.origins) else source
        bag.joints = source.params.robot.joints
        check_inputs(bag, required)
        for line in (*source.lines(), *bag.notes):
            print(prefix + line)
        yield bag, source


def lacks_inputs(bag: Bag) -> bool:
    """Return whether a bag lacks inputs of the estimators; print what it has instead."""
    from smart_tire.bags import contents
    found = bag.match(REQUIRED)
    if missing := [name for name in REQUIRED if name not in found]:
        print(f'{bag.path}: nothing can be estimated without {" and ".join(missing)}; '
              + '; '.join(contents(bag)))
    return bool(missing)


class Analyzed(NamedTuple):
    """What a verb gets from a bag."""

    bag: Bag  # closed
    source: BagParams
    analysis: Analysis
    summary: Tree
    status: int  # by the errors in the recording


def analyzed(path: Path, name: str, args: argparse.Namespace, *, prefix: str = '',
             consequence: str = '', **options: Any) -> Analyzed | None:
    """
    Analyze the bag at ``path`` with the options of a verb, and ``name`` in the progress line.

    Prints the errors that the checks find. Returns None, with the reasons and the ``consequence``
    printed, if nothing can be estimated. ``options`` are those of ``analyze``, ``prefix`` begins
    the lines about parameters and errors.
    """
    from smart_tire.analysis.offline import analyze
    with open_bag(path, args, prefix=prefix) as (bag, source):
        if lacks_inputs(bag):
            return None
    with ProgressLine(name) as progress:
        found = analyze(path, options.pop('out', None), source.params, progress.share,
                        names=bag.names, source=source, checks=args.checks, **options)
    status = print_errors(found.contents.errors, prefix)
    if found.summary is not None:
        return Analyzed(bag, source, found, found.summary, status)
    print(f'{path}: nothing can be estimated{consequence}')
    for text in found.contents.skipped:
        print(f'  skipped: {text}')
    return None


def bag_settings(paths: Sequence[Path], args: argparse.Namespace,
                 checked: Collection[Path] = ()) -> tuple[BagParams, TopicNames, int]:
    """
    Return parameters, topic names and exit status for bags of one robot.

    Prints as ``open_bag`` does, and the errors that the checks find in those of the bags that are
    ``checked``, which decide the status. Raises ParameterError if the bags carry different
    parameters of the robot.
    """
    found, status = [], ESTIMATED
    for path in paths:
        prefix = f'{path}: ' if len(paths) > 1 else ''
        with open_bag(path, args, prefix=prefix) as (bag, source):
            found.append((source, bag.names))
            if path in checked:
                status = max(status, print_checks(bag, source, prefix))
        if source.params.robot != found[0][0].params.robot:
            raise ParameterError(f'{paths[0]} and {path} carry different parameters of the '
                                 'robot: select one set with --params')
    return *found[0], status


@dataclass(frozen=True)
class BagCall:
    """
    A call of ``work`` with bag and output, the options, and the place of the bag, if it is a URL.

    It may be in another process, so that what it prints and logs is part of the result.
    """

    work: Callable[[Path, Any, argparse.Namespace, str | None], Any]
    args: argparse.Namespace
    captured: bool  # else it prints and logs itself

    def __call__(self, job: tuple[Source, Any]) -> tuple[Any, str, list[str]]:
        """Return result, or the error of the bag, printed text and logged losses."""
        source, out = job
        text, log, copy = StringIO(), BufferingHandler(MAX_LOSSES), ''
        with ExitStack() as stack:
            if self.captured or is_url(source):
                stack.enter_context(redirect_stdout(text))
                logger = logging.getLogger(BAG_LOGGER)
                logger.addHandler(log)
                stack.callback(logger.removeHandler, log)
            try:
                with local_bag(source, time.sleep) as bag:
                    copy = str(bag)
                    url = str(source) if is_url(source) else None
                    found: Any = self.work(bag, out, self.args, url)
            except SmartTireError as error:
                found = error
        printed = text.getvalue()
        return (found, printed.replace(copy, str(source)) if copy else printed,
                [str(record.args[1]) for record in log.buffer if isinstance(record.args, tuple)])


def each_bag(args: argparse.Namespace, bags: Sequence[Source], outs: Sequence[Any],
             work: Callable[[Path, Any, argparse.Namespace, str | None], tuple[int, Any]]
             ) -> tuple[int, dict[Any, Any]]:
    """
    Call ``work`` with each of ``bags``, its output, the options, and the URL of the bag or None.

    It returns exit status and result. Return the largest status, and output -> result. Prints
    what ``work`` prints; a bag that cannot be read does not stop the others.
    """
    found: dict[Any, Any] = {}
    status = ESTIMATED
    call = BagCall(work, args, captured=len(outs) > 1)
    with closing(each_item(args, call, list(zip(bags, outs)))) as results:
        for (source, out), value in results:
            result, text, losses = (value, '', []) if isinstance(value, BaseException) else value
            sys.stdout.write(text)
            for line in losses:  # later ones of the same bag are more complete
                logging.getLogger(BAG_LOGGER).warning('%s: %s', source, line)
            if isinstance(result, BaseException):
                print(f'smart_tire {args.verb}: {error_text(result)}', file=sys.stderr)
                own = USAGE if isinstance(result, (BagError, ParameterError)) else FAILED
            else:
                own, found[out] = result
            status = max(status, own)
    return status, found


def each_item(args: argparse.Namespace, function: Callable[[Item], Value], items: Sequence[Item],
              *, isolated: bool = False) -> Generator[Outcome[Item, Value], None, None]:
    """
    Yield the results of ``run_each`` with ``--jobs`` and ``--dask``, and show the progress.

    A single item is computed in this process unless ``isolated``.
    """
    jobs = jobs_for(len(items), args.jobs) if isolated or len(items) > 1 else 0
    begin = time.monotonic()
    with ExitStack() as stack:
        results = stack.enter_context(closing(run_each(
            function, items, jobs=jobs, cluster=args.dask, wait=time.sleep)))
        progress = stack.enter_context(ProgressLine(f'smart_tire {args.verb}')) if len(
            items) > 1 else None
        for done in numbers():
            if progress is not None:
                progress.show(remaining(done, len(items), time.monotonic() - begin))
            if (result := next(results, None)) is None:
                return
            yield result


def error_text(error: BaseException) -> str:
    """Return what is printed of an error; one that is not of this package has its type."""
    return str(error) if isinstance(error, SmartTireError) else f'{type(error).__name__}: {error}'


def print_errors(errors: Iterable[Finding], prefix: str = '') -> int:
    """Print the errors that the checks have found in a recording; return the exit status."""
    status = ESTIMATED
    for error in errors:
        print(f'{prefix}error: {error.text}')
        status = CONTRADICTED
    return status


def print_checks(bag: Bag, used: BagParams, prefix: str = '') -> int:
    """Read an open bag, and print its errors; return the exit status."""
    from smart_tire.checks import findings
    from smart_tire.checks.recording import read
    found = findings(read(bag, used.params.robot, radius_given=used.radius_given))
    return print_errors((one for one in found if one.level is Level.ERROR), prefix)


def diverged(bag: Path, summary: Tree, status: int) -> int:
    """Print as the last line that the estimate diverged, if it did, else return ``status``."""
    if summary['diverged'] is None:
        return status
    print(f'{bag}: {summary["diverged"]}; correct the errors that "smart_tire doctor" names')
    return DIVERGED


def print_comparison(found: Mapping[str, Result], out: Path | None, *, figure: bool) -> None:
    """Print the results next to each other; write tables and a figure to ``out``, if given."""
    from smart_tire.analysis.comparison import comparison_tables, named, write_comparison
    runs = named(found)
    for table in comparison_tables(runs):
        for line in table.lines():
            print(line)
    if out is not None:
        write_comparison(out, runs, figure=figure)
        print(f'  written to {out}')


def print_counts(counts: Mapping[str, int]) -> None:
    """Print the message count of each topic."""
    width = max((len(str(count)) for count in counts.values()), default=1)
    for topic, count in sorted(counts.items()):
        print(f'  {count:{width}} {printable(topic)}')


def print_warnings(warnings: Iterable[str]) -> None:
    """Print the warnings of a bag reader."""
    for warning in warnings:
        print(f'warning: {printable(warning)}')
