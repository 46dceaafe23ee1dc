"""What nodes estimated while they ran, read from the bag of the run and held against truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from smart_tire.analysis.figures import write_figures
from smart_tire.analysis.metrics import stamp_score
from smart_tire.analysis.pipeline import ESTIMATES, EstimatorParams, INPUTS, TRUTHS
from smart_tire.analysis.report import table_lines
from smart_tire.analysis.series import Series, Stamps
from smart_tire.analysis.summary import estimates_tree, plain, Tree, truth_tree
from smart_tire.bags import Bag

WANTED_STAMP_SIGMA = 0.5e-3  # s

Spans = dict[str, list[tuple[int, int]]]  # name -> stretches of time [ns]


def judge(bag_path: Path, params: Path, spans: Spans, expected: Sequence[str], conversions: Path,
          figures: Path) -> Tree:
    """
    Return the summary of a recorded run of the whole stack and draw its figures.

    ``spans`` are the stretches to be judged by themselves, ``expected`` the topics that must not
    be silent, ``conversions`` the simulator's log of the true conversion instants.
    """
    inputs, estimates, truth = Series(), Series(), Series()
    with Bag(bag_path) as bag:
        begin, end = bag.span_ns
        counts = {name.lstrip('/'): topic.messages for name, topic in bag.topics.items()}
        for _, topic, sample in bag.samples((*INPUTS, *ESTIMATES, *TRUTHS)):
            series = truth if topic in TRUTHS else estimates if topic in ESTIMATES else inputs
            series.add(sample)
    robot, batches = EstimatorParams.load([params]).robot, read_conversions(conversions)
    write_figures(figures, inputs, estimates, truth, robot, spans)
    return plain({
        'bag': str(bag_path), 'duration_s': (end - begin) * 1e-9,
        'messages': counts,
        'silent': [name for name in expected if not counts.get(name.lstrip('/'))],
        'radio': radio_counts(inputs, batches),
        'stamps': stamp_errors(inputs, batches),
        'estimates': estimates_tree(estimates),
        'against_truth': truth_tree(estimates, truth, spans)})


@dataclass(frozen=True)
class Batch:
    """What the simulator logs of a batch of conversions."""

    wheel: str
    dropped: bool      # by the simulated radio
    stamp_ns: Stamps   # true instants of the conversions


def read_conversions(path: Path) -> list[Batch]:
    """Return the batches of the simulator's log; the last line may be cut off."""
    with path.open(newline='', encoding='utf-8') as file:
        return [Batch(row['wheel'], row['dropped'] != '0',
                      np.array(row['stamps_ns'].split(), np.int64))
                for row in csv.DictReader(file) if row['stamps_ns']]


def stamp_errors(inputs: Series, batches: Sequence[Batch]) -> Tree:
    """Return wheel -> how far the stamps of its samples are from the true instants."""
    return {wheel: stamp_score(inputs.films(wheel)[0], np.sort(np.concatenate(
                [batch.stamp_ns for batch in batches if batch.wheel == wheel])),
                WANTED_STAMP_SIGMA)
            for wheel in inputs.film_wheels()}


def radio_counts(inputs: Series, batches: Sequence[Batch]) -> Tree:
    """
    Return how many batches were sent, dropped by the radio, and missing for other reasons.

    Only those between the first and the last that were received count.
    """
    counts = {'sent': 0, 'dropped': 0, 'missing': 0}
    for wheel in inputs.film_wheels():
        received = inputs.films(wheel)[0]
        for batch in batches:
            middle = batch.stamp_ns[len(batch.stamp_ns) // 2]
            if batch.wheel != wheel or not received[0] <= middle <= received[-1]:
                continue
            right = np.searchsorted(received, middle)
            near = np.min(np.abs(received[max(right - 1, 0):right + 1] - middle))
            counts['sent'] += 1
            counts['dropped'] += batch.dropped
            counts['missing'] += bool(near > batch.stamp_ns[1] - batch.stamp_ns[0]
                                      and not batch.dropped)
    return counts


def lines(tree: Tree) -> Iterator[str]:
    """Yield the summary of ``judge`` as lines to read."""
    truth: dict[str, Any] = tree['against_truth'] or {}
    yield f'recorded {tree["duration_s"]:.0f} s, {sum(tree["messages"].values())} messages'
    yield ('radio batches: {sent} sent, {dropped} dropped by the radio, {missing} lost on the way '
           'from there'.format(**tree['radio']))
    for wheel, score in tree['stamps'].items():
        yield (f'stamps of {wheel} samples: {1e3 * score["rms"]:.2f} ms rms from the true '
               f'conversions, mean {1e3 * score["mean"]:+.2f} ms')
    if 'pose' in truth:
        pose = truth['pose']
        yield (f'odom after {pose["distance_m"]:.1f} m: {pose["position_end_m"]:.2f} m, '
               f'{pose["yaw_end_rad"]:+.3f} rad off')
    yield from table_lines(truth)
