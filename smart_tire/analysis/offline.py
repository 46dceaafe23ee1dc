"""One bag through the estimators: estimates to a bag, what they tell to a summary."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, ExitStack
from dataclasses import asdict, dataclass, field
from functools import partial
import heapq
import json
from operator import itemgetter
from pathlib import Path

import numpy as np

from smart_tire.analysis.pipeline import (
    ESTIMATES, EstimatorParams, FrictionStage, INPUTS, SlipStage, TRUTHS)
from smart_tire.analysis.prefetch import ahead
from smart_tire.analysis.series import Series
from smart_tire.analysis.smoothing import SmoothedSlip
from smart_tire.analysis.stream_statistics import StampLog
from smart_tire.analysis.summary import estimates_tree, plain, Tree, truth_tree
from smart_tire.bags import Bag, BagWriter
from smart_tire.errors import BagError
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.messages import find_topic, topic_of
from smart_tire.samples import NS_PER_S, Odometry, Sample, WheelSample

BATCH = 500  # messages that go from one stage to the next together
NEEDED_FOR = {'imu/data': 'no odom, wheel_slip and icr', 'tire_samples': 'no tire_friction',
              'wheel_states': 'no odom, wheel_slip, icr and tire_friction'}
COMPARED = dict(zip(TRUTHS, ('poses', 'slips', 'friction values')))

Progress = Callable[[float], None]  # takes the share that is done, 0 to 1
Received = tuple[int, Sample]       # at [ns]


@dataclass
class BagContents:
    """What the bag held."""

    inputs: Series = field(default_factory=Series)
    truth: Series = field(default_factory=Series)
    stamps: StampLog = field(default_factory=StampLog)
    without_positions: int = 0  # wheel samples
    late: Counter[str] = field(default_factory=Counter)
    rejected: Counter[str] = field(default_factory=Counter)
    left_out: list[str] = field(default_factory=list)
    duration_s: float = 0.0

    def take(self, topic: str, sample: Sample) -> None:
        """Note an input."""
        self.stamps.add(topic, sample)
        self.inputs.add(sample)
        if isinstance(sample, WheelSample) and sample.position is None:
            self.without_positions += 1


@dataclass
class StageBatch:
    """What the slip stage made of some messages, for the friction stage."""

    share: float            # of the bag that is done
    passed: list[Received]
    smoothed: bool = False  # in the light of the whole bag


@dataclass
class Run:
    """What went into the estimators and what came out."""

    intake: BagContents = field(default_factory=BagContents)
    estimates: Series = field(default_factory=Series)
    smoothed: Series | None = None  # None where it was not asked for
    summary: Tree | None = None     # None where nothing could be estimated


class EstimateWriter:
    """The friction stage behind slip estimates: into a bag and a series, what both tell."""

    def __init__(self, folder: Path, params: EstimatorParams, bags: ExitStack) -> None:
        self.estimates = Series()
        self.stage = FrictionStage(params)
        self._folder, self._bags = folder, bags
        self._writer: BagWriter | None = None

    def take(self, passed: Iterable[Received]) -> None:
        """Estimate from what the slip stage passes; the first estimate opens the bag."""
        for receive_ns, sample in passed:
            for estimate in self.stage.update(sample):
                if self._writer is None:
                    self._writer = self._bags.enter_context(BagWriter(_cleared(self._folder)))
                self._writer.write_sample(topic_of(estimate), receive_ns, estimate)
                self.estimates.add(estimate)

    @property
    def empty(self) -> bool:
        """Return whether nothing could be estimated."""
        return self._writer is None


def analyze(path: Path, out: Path, params: EstimatorParams,
            progress: Progress = lambda share: None, *, smooth: bool = False) -> Run:
    """
    Write what the bag at ``path`` tells: a bag ``out``/estimates and ``out``/summary.json.

    With ``smooth`` there is a bag ``out``/smoothed, too, of what the whole of the bag tells of
    each instant. Nothing is written where nothing can be estimated; estimates of a former run
    are replaced. Raises BagError if the bag can not be read or ``out`` not be written.
    """
    folders = [out / 'estimates', out / 'smoothed'][:1 + smooth]
    bag_folder = path.resolve() if path.is_dir() else path.resolve().parent
    for folder in (out, *folders):
        if folder.resolve() == bag_folder:
            raise BagError(f'{folder}: is the folder of the bag that is read; choose another')
    run = Run()
    with ExitStack() as stack:
        outlets = [EstimateWriter(folder, params, stack) for folder in folders]
        for item in stack.enter_context(closing(ahead(partial(_read, path, params, smooth)))):
            if isinstance(item, BagContents):
                run.intake = item
                continue
            progress(item.share)
            outlets[item.smoothed].take(item.passed)
    run.estimates = outlets[0].estimates
    run.smoothed = outlets[1].estimates if smooth else None
    if not outlets[0].empty:
        run.summary = _summary(path, run, outlets[0].stage)
        _write(out / 'summary.json', run.summary)
    return run


def _read(path: Path, params: EstimatorParams, smooth: bool) -> Iterator[StageBatch | BagContents]:
    """Yield the bag's messages, through the slip stage, and at last what the bag held."""
    intake, received = BagContents(), array('q')
    slip = SmoothedSlip(params.slip) if smooth else SlipEstimator(params.slip)
    stage = SlipStage.of(params, slip)
    with Bag(path) as bag:
        start, end = bag.span_ns
        work = (1 + smooth) * max(1, end - start)
        passed: list[Received] = []
        for count, (receive_ns, topic, sample) in enumerate(bag.samples((*INPUTS, *TRUTHS))):
            if topic in TRUTHS:
                intake.truth.add(sample)
            else:
                intake.take(topic, sample)
                made = stage.update(sample)
                passed += [(receive_ns, item) for item in made]
                received.extend(receive_ns for item in made if isinstance(item, Odometry))
            if count % BATCH == 0:
                yield StageBatch((receive_ns - start) / work, passed)
                passed = []
        yield StageBatch(1.0 / (1 + smooth), passed)
        intake.late, intake.rejected = stage.late, bag.rejected
        intake.duration_s = (end - start) / NS_PER_S
        intake.left_out = _left_out(bag, intake, params.friction.robot.film.wheels)
    if isinstance(slip, SmoothedSlip):
        yield from _read_again(path, slip, received)
    yield intake


def _read_again(path: Path, slip: SmoothedSlip, received: Sequence[int]) -> Iterator[StageBatch]:
    """Yield what the friction stage needs, with smoothed slip where there was filtered slip."""
    with Bag(path) as bag, closing(slip):
        start, end = bag.span_ns
        smoothed = ((receive_ns, estimate) for receive_ns, estimates
                    in zip(received, slip.smoothed()) for estimate in estimates)
        inputs = ((receive_ns, sample) for receive_ns, _, sample
                  in bag.samples(('wheel_states', 'tire_samples')))
        passed: list[Received] = []
        for item in heapq.merge(smoothed, inputs, key=itemgetter(0)):
            passed.append(item)
            if len(passed) == BATCH:
                yield StageBatch(0.5 + 0.5 * (item[0] - start) / max(1, end - start), passed, True)
                passed = []
        yield StageBatch(1.0, passed, True)


def _cleared(folder: Path) -> Path:
    """Return ``folder`` without the bag of a former run; what else is in it stays."""
    former = [*folder.glob(f'{folder.name}_*.mcap'), *folder.glob('metadata.yaml')]
    try:
        for file in former:
            file.unlink()
        if former and not any(folder.iterdir()):
            folder.rmdir()
    except OSError as error:
        raise BagError(f'{folder}: cannot be replaced ({error.strerror})') from error
    return folder


def _summary(path: Path, run: Run, stage: FrictionStage) -> Tree:
    intake = run.intake
    late = intake.late | stage.late  # the greater one where both stages take a topic
    inputs = {topic: {**asdict(stats), 'late': late[topic], 'rejected': intake.rejected[topic]}
              for topic, stats in intake.stamps.stats().items()}
    tree = {'bag': str(path), 'duration_s': plain(intake.duration_s),
            'inputs': plain(inputs), 'left_out': intake.left_out, **_told(run.estimates, intake)}
    if run.smoothed is not None:
        tree['smoothed'] = _told(run.smoothed, intake)
    return tree


def _told(estimates: Series, intake: BagContents) -> Tree:
    return {'estimates': estimates_tree(estimates),
            'against_truth': truth_tree(estimates, intake.truth)}


def _left_out(bag: Bag, intake: BagContents, film_wheels: Sequence[str]) -> list[str]:
    """Return what was not read, not used or not estimated, each with the reason."""
    there = bag.match((*INPUTS, *TRUTHS))
    lines = [f'{name} is not in the bag: {lost}' for name, lost in NEEDED_FOR.items()
             if name not in there]
    if intake.without_positions:
        lines.append(f'positions of wheel_states: {intake.without_positions} messages have none, '
                     'their velocities are used')
    lines += [f'tire_samples of {wheel}: it is not among film.wheels'
              for wheel in intake.inputs.film_wheels() if wheel not in film_wheels]
    if not there.keys() & set(TRUTHS):
        lines.append('ground truth is not in the bag: nothing is compared')
    else:
        lines += [f'{name} is not in the bag: {what} are not compared'
                  for name, what in COMPARED.items() if name not in there]
    if np.isnan(intake.truth.poses().twist).any():
        lines.append('twist of ground_truth/odom is not given: speeds are not compared')
    return lines + _unread(bag, there)


def _unread(bag: Bag, there: dict[str, str]) -> list[str]:
    """Return what of the bag was passed over though its name is known, or was refused."""
    lines = [f'{misfit}: is not read' for misfit in bag.misfits()]
    for name in bag.topics:
        topic = find_topic(name)
        if topic is not None and topic.name in ESTIMATES:
            lines.append(f'{name}: a former estimate, is not read')
        elif topic is not None and there.get(topic.name, name) != name:
            lines.append(f'{name}: is not read beside {there[topic.name]}')
    lines += [f'{count} messages of {topic}: refused, the first because {bag.reasons[topic]}'
              for topic, count in bag.rejected.items()]
    return lines + bag.losses


def _write(path: Path, summary: Tree) -> None:
    try:
        path.write_text(json.dumps(summary, indent=2, allow_nan=False) + '\n', encoding='utf-8')
    except OSError as error:
        raise BagError(f'{path}: cannot be written ({error.strerror})') from error
