# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Run the estimators on a bag; write their estimates to a bag and a summary."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import closing, ExitStack
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg.lapack  # noqa: F401 (for the stages, before their processes are forked)

from smart_tire.analysis.dead_reckoning import baselines
from smart_tire.analysis.driven_paths import PATH, PathLog
from smart_tire.analysis.figure import PICTURE
from smart_tire.analysis.pipeline import (
    BagParams, EstimateRecord, ESTIMATES, estimates_of, EstimatorParams, INPUTS, LOST_WITHOUT,
    Measured, measured, OVERHEAD, SmoothedSlip, TRUTHS)
from smart_tire.analysis.processes import pipelined
from smart_tire.analysis.result import Result
from smart_tire.analysis.summary import divergence, evaluation, input_stats, plain, Tree
from smart_tire.bags import (
    Bag, BagTopic, BagWriter, PARAMETERS_KEY, report_losses, STANDARD_NAMES, TopicNames)
from smart_tire.checks import findings
from smart_tire.checks.messages import check_host
from smart_tire.checks.recording import CheckedRecording, problems_of
from smart_tire.errors import BagError
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.estimation.friction.film_stage import FilmStage
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.findings import Finding, Level
from smart_tire.messages import find_topic, topic_of
from smart_tire.parameters import FrictionEstimatorParams, RobotParams
from smart_tire.recording import Faults, SampleArrays
from smart_tire.samples import (
    Friction, GroundState, NS_PER_S, Odometry, WheelSample, WheelSlip)

BATCH_SIZE = 500  # messages that are sent together from one process to the other
COMPARED_VALUES = dict(zip((*TRUTHS, *OVERHEAD), (
    'poses', 'slips', 'friction values', 'poses', 'slips')))

Progress = Callable[[float], None]  # is called with the completed share, 0 to 1


@dataclass
class BagContents:
    """Inputs, references and wanted paths of a bag."""

    inputs: SampleArrays = field(default_factory=SampleArrays)
    truth: SampleArrays = field(default_factory=SampleArrays)
    camera: SampleArrays = field(default_factory=SampleArrays)  # of the overhead camera
    paths: PathLog = field(default_factory=PathLog)  # that were to be followed
    late: Counter[str] = field(default_factory=Counter)
    faults: Faults = field(default_factory=Faults)
    losses: list[str] = field(default_factory=list)    # of messages that cannot be read, one line
    skipped: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)     # recognized topics and joints
    warnings: list[str] = field(default_factory=list)  # of the reader; also in ``skipped``
    topics: dict[str, BagTopic] = field(default_factory=dict)  # all, by name in the bag
    findings: list[Finding] = field(default_factory=list)  # errors and warnings, if requested
    host: str | None = None  # that the host was late when the bag was recorded
    start_ns: int = 0   # receive time of the first message
    duration_s: float = 0.0

    @property
    def errors(self) -> list[Finding]:
        """Return the errors among the findings."""
        return [one for one in self.findings if one.level is Level.ERROR]


class StageBatch(NamedTuple):
    """What a stage has made of some messages, for the next one."""

    share: float  # completed share of the analysis
    received: list[tuple[int, Any]]  # receive time [ns]; ``Measured``, then sample for slip


@dataclass
class Analysis:
    """Inputs and results of an analysis."""

    contents: BagContents = field(default_factory=BagContents)
    estimates: SampleArrays = field(default_factory=SampleArrays)
    smoothed: SampleArrays | None = None  # None if not requested
    summary: Tree | None = None     # None if nothing was estimated
    picture: Path | None = None     # a camera frame with the path, if one was drawn
    robot: RobotParams = field(default_factory=RobotParams)

    @cached_property
    def result(self) -> Result:
        """Return the estimates and what they are compared with, for figures and tables."""
        contents = self.contents
        compared = len(contents.truth) + len(contents.camera)
        return Result(self.estimates, contents.inputs, contents.truth, contents.camera,
                      self.smoothed, baselines(contents.inputs, self.robot) if compared else {},
                      contents.paths.wanted())


class EstimateWriter:
    """Writes estimates to streams and, with a folder, to a bag."""

    def __init__(self, folder: Path | None, bags: ExitStack, params: EstimatorParams) -> None:
        self.estimates = SampleArrays()
        self.empty = True  # until the first estimate
        self._folder, self._bags, self._params = folder, bags, params
        self._writer: BagWriter | None = None

    def write(self, receive_ns: int, estimates: Iterable[EstimateRecord]) -> None:
        """Write estimates; the first one creates the bag."""
        for estimate in estimates:
            self.empty = False
            self.estimates.add_sample(estimate)
            if self._folder is None:
                continue
            if self._writer is None:
                _remove_old_bag(self._folder)
                self._writer = self._bags.enter_context(BagWriter(
                    self._folder, custom_data={PARAMETERS_KEY: self._params.text}, live=False))
            self._writer.write_sample(topic_of(estimate), receive_ns, estimate)


def analyze(path: Path, out: Path | None, params: EstimatorParams,
            progress: Progress = lambda share: None, *, smooth: bool = False,
            names: TopicNames = STANDARD_NAMES, source: BagParams | None = None,
            checks: bool = False, overhead: Path | None = None,
            origin: str | None = None) -> Analysis:
    """
    Analyze the bag at ``path``; write the bag ``out``/estimates and ``out``/summary.json.

    With ``smooth`` also write the estimates of the RTS smoother to ``out``/smoothed. ``names``
    are the topics with other names in the bag; ``source``, where ``params`` are from, is written
    to the summary. With ``checks`` the contents have the warnings and errors of ``doctor``.
    ``overhead`` is a bag with the estimates of the overhead camera, instead of those in the first
    bag. ``origin`` is the URL of which ``path`` is a copy. The bags of estimates carry
    ``params``. Nothing is written without ``out`` or if nothing can be estimated; existing
    estimates are replaced. Raises BagError if a bag cannot be read or ``out`` cannot be written.
    """
    names_out = ('estimates', 'smoothed') if smooth else ('estimates',)
    folders = [None if out is None else out / name for name in names_out]
    _check_folders(path, (out, *folders))
    analysis = Analysis(robot=params.robot)
    if overhead is not None and (picture := overhead.parent / PICTURE).is_file():
        analysis.picture = picture
    with ExitStack() as stack:
        writers = [EstimateWriter(folder, stack, params) for folder in folders]
        slip = (SmoothedSlip if smooth else SlipEstimator)(params.slip)
        read = partial(_read, path, params, names, checks, source is None or source.radius_given,
                       overhead)
        held: list[tuple[int, EstimateRecord | None]] = []  # None: the next smoothed motion
        for item in stack.enter_context(closing(pipelined(
                read, partial(_with_friction, params.friction)))):
            if isinstance(item, BagContents):
                analysis.contents = item
                report_losses(path, item.losses)  # the logger of the first process has them only
                continue
            progress(item.share / (1 + smooth))
            for receive_ns, sample in item.received:
                estimates = estimates_of(slip, sample)
                writers[0].write(receive_ns, estimates)
                held += [(receive_ns, None if isinstance(one, Odometry) else one)
                         for one in estimates
                         if smooth and isinstance(one, (Odometry, Friction, GroundState))]
        if isinstance(slip, SmoothedSlip):
            with closing(slip):
                motion = slip.smoothed()
                for count, (receive_ns, one) in enumerate(held, 1):
                    writers[1].write(receive_ns, next(motion) if one is None else [one])
                    progress((1.0 + count / len(held)) / 2.0)
    analysis.estimates = writers[0].estimates
    analysis.smoothed = writers[1].estimates if smooth else None
    if not writers[0].empty:
        analysis.summary = {**_summary(
            origin or path, analysis, slip, None if source is None else source.tree,
            params.robot.wheel_radius), 'remap': dict(names.remap)}
        if out is not None:
            _write(out / 'summary.json', analysis.summary)
    return analysis


def _check_folders(path: Path, folders: Iterable[Path | None]) -> None:
    """Raise BagError if one of ``folders``, which are written, is that of the bag ``path``."""
    bag_folder = path.resolve() if path.is_dir() else path.resolve().parent
    for folder in folders:
        if folder is not None and folder.resolve() == bag_folder:
            raise BagError(f'{folder} is the folder of the input bag: choose another')


def read_overhead(path: Path) -> SampleArrays:
    """Return what "smart_tire overhead" has estimated; raise BagError if the bag has none."""
    with Bag(path) as bag:
        if not bag.match(OVERHEAD):
            raise BagError(f'{path}: neither {" nor ".join(OVERHEAD)} in the bag: expected the '
                           'output folder of "smart_tire overhead"')
        return bag.recording(OVERHEAD)


def _read(path: Path, params: EstimatorParams, names: TopicNames, checks: bool,
          radius_given: bool, overhead: Path | None) -> Iterator[StageBatch | BagContents]:
    """Yield the output of the film stage in batches, and finally the contents of the bag."""
    contents, films = BagContents(), FilmStage(params.friction, waveforms=False)
    cameras: tuple[str, ...] = OVERHEAD
    if overhead is not None:
        contents.camera, cameras = read_overhead(overhead), ()
    with Bag(path, names, params.robot.joints) as bag:
        batch: list[tuple[int, Measured]] = []
        receive_ns = bag.span_ns[1]
        for count, (receive_ns, topic, sample) in enumerate(
                bag.samples((*INPUTS, *TRUTHS, *cameras, PATH))):
            if topic in TRUTHS:
                contents.truth.add_sample(sample, receive_ns)
            elif topic in OVERHEAD:
                contents.camera.add_sample(sample, receive_ns)
            elif topic == PATH:
                contents.paths.add_message(receive_ns, sample)
            else:
                contents.inputs.add_sample(sample, receive_ns)
                found = measured(films, sample)
                if found.blocks or found.samples:
                    batch.append((receive_ns, found))
            if count % BATCH_SIZE == 0:
                start, end = bag.span_ns  # without the steps of its clock, by now
                yield StageBatch((receive_ns - start) / max(1, end - start), batch)
                batch = []
        batch.append((receive_ns, Measured(films.finish(), [])))
        yield StageBatch(1.0, batch)
        contents.late, contents.faults = films.feed.late, bag.faults
        start, end = bag.span_ns
        contents.start_ns, contents.duration_s = start, (end - start) / NS_PER_S
        contents.notes = bag.notes
        contents.skipped = _skipped(bag, contents, params.friction.robot.film.wheels)
        contents.topics, contents.losses = bag.topics, bag.losses.lines()
        contents.warnings = [*contents.losses, *bag.warnings]
        checked = CheckedRecording(params.robot, contents.inputs, bag.faults, problems_of(bag),
                                   tuple(bag.statuses()), radius_given=radius_given)
        contents.host = next((one.text for one in check_host(checked)), None)
        if checks:  # here the other stages, in other processes, do not wait for them
            contents.findings = [one for one in findings(checked) if one.level >= Level.WARNING]
    yield contents


def _with_friction(params: FrictionEstimatorParams, items: Iterator[StageBatch | BagContents]
                   ) -> Iterator[StageBatch | BagContents]:
    """Yield batches with the estimates of the friction stage, and the contents as they are."""
    friction = FrictionEstimator(params)
    for item in items:
        yield item if isinstance(item, BagContents) else item._replace(received=[
            (receive_ns, sample) for receive_ns, found in item.received
            for sample in (*friction.evaluate(found.blocks), *found.samples)])


def _remove_old_bag(folder: Path) -> None:
    """Delete the bag of an earlier analysis, but no other files."""
    old_files = [*folder.glob(f'{folder.name}_*.mcap'), *folder.glob('metadata.yaml')]
    try:
        for file in old_files:
            file.unlink()
        if old_files and not any(folder.iterdir()):
            folder.rmdir()
    except OSError as error:
        raise BagError(f'{folder}: cannot be replaced ({error.strerror})') from error


def _summary(path: Path | str, analysis: Analysis, slip: SlipEstimator | SmoothedSlip,
             source: Tree | None, wheel_radius: float) -> Tree:
    contents = analysis.contents
    fastest = wheel_radius * float(np.nanmax(np.abs(contents.inputs.speeds()[1]), initial=0.0))
    late = contents.late | slip.late  # the larger count if both stages use a topic
    rejected = contents.faults.rejected
    inputs = {topic: {**asdict(stats), 'late': late[topic], 'rejected': rejected[topic]}
              for topic, stats in input_stats(contents.inputs).items()}
    diverged = [text for one in (analysis.estimates, analysis.smoothed)
                if one is not None and (text := divergence(one, fastest))]
    if slip.restarts:
        diverged.append(f'the slip filter restarted from its priors {slip.restarts} times')
    filtered, *smoothed = map(evaluation, analysis.result.comparisons.values())
    tree = {'bag': str(path), 'duration_s': plain(contents.duration_s), 'host': contents.host,
            'parameters': plain(source), 'notes': contents.notes,
            'findings': [one.tree for one in contents.findings],
            'diverged': diverged[0] if diverged else None,
            'inputs': plain(inputs), 'left_out': contents.skipped,
            **filtered}
    if smoothed:
        tree['smoothed'], = smoothed
    return tree


def _skipped(bag: Bag, contents: BagContents, film_wheels: Sequence[str]) -> list[str]:
    """Return what was not read, used or estimated, with the reasons."""
    available = bag.match((*INPUTS, *TRUTHS, *OVERHEAD))
    lines = [f'{name} is not in the bag: no {LOST_WITHOUT[name]}' for name in INPUTS
             if name not in available]
    missing = int(np.isnan(contents.inputs.stream(WheelSample)['position']).all(axis=1).sum())
    if missing:
        lines.append(f'positions of wheel_states: missing in {missing} '
                     'messages, whose velocities are used instead')
    lines += [f'tire_samples of {wheel}: not in film.wheels'
              for wheel in contents.inputs.film_wheels() if wheel not in film_wheels]
    lines += _missing_references(available, contents)
    if np.isnan(contents.truth.poses().twist).any():
        lines.append('ground_truth/odom has no twist: no errors of speeds')
    return lines + _unread_topics(bag, available)


def _missing_references(available: Collection[str], contents: BagContents) -> Iterator[str]:
    """Yield which errors are not computed, and why."""
    known, wheels = set(available) & set(TRUTHS), contents.inputs.stream(WheelSample).stamp_ns
    seen = {name: stamps for name, kind in zip(OVERHEAD, (Odometry, WheelSlip))
            if len(stamps := contents.camera.stream(kind).stamp_ns)}
    topics: Sequence[str] = TRUTHS
    if not known:
        yield 'ground truth is not in the bag: ' + (
            'errors are against the overhead camera' if seen else 'no errors are computed')
        known, topics = set(seen), OVERHEAD if seen else ()
    yield from (f'{name} is missing: no errors of {COMPARED_VALUES[name]}'
                for name in topics if name not in known)
    for name, stamps in seen.items():
        if len(wheels) and not wheels.min() <= stamps.max() >= stamps.min() <= wheels.max():
            yield f'{name}: its timestamps do not overlap those of wheel_states'


def _unread_topics(bag: Bag, available: dict[str, str]) -> list[str]:
    """Return the standard topics of the bag that were not read, and rejected messages."""
    lines = [f'{mismatch}: not read' for mismatch in bag.type_mismatches()]
    for name in bag.topics:
        topic = find_topic(name)
        if topic is not None and topic.standard in ESTIMATES:
            lines.append(f'{name}: recorded estimate, not read')
        elif topic is not None and available.get(topic.standard, name) != name:
            lines.append(f'{name}: not read, {available[topic.standard]} is used')
    return lines + bag.faults.lines() + bag.losses.lines() + bag.warnings


def _write(path: Path, summary: Tree) -> None:
    try:
        path.write_text(json.dumps(summary, indent=2, allow_nan=False) + '\n', encoding='utf-8')
    except OSError as error:
        raise BagError(f'{path}: cannot be written ({error.strerror})') from error
