# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A recording in the viewer: what the bag contains, or estimates that are computed from it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack
import heapq
from operator import itemgetter
from pathlib import Path

from smart_tire.analysis.pipeline import ESTIMATES, EstimatorParams, INPUTS, OVERHEAD, Pipeline
from smart_tire.bags import Bag, STANDARD_NAMES, TopicNames
from smart_tire.messages import IMAGES, NodeStatus, topic_of
from smart_tire.paths import analyzed_bag
from smart_tire.samples import Friction, Sample
from smart_tire.view.scene import Scene

FLUSH_SAMPLES = 20_000  # between two transmissions to the viewer
ANALYZED = 'estimates', 'smoothed'  # folders that "smart_tire analyze" writes
REQUIRED = 'odom', 'wheel_slip'  # without these a bag has no estimates to show

Progress = Callable[[float], None]  # is called with the completed share, 0 to 1


def find_bags(path: Path) -> tuple[Path, Path | None]:
    """
    Return the bag at ``path``, or the input bag of an analysis and the bag of its estimates.

    ``smart_tire overhead`` is an analysis, too. The estimates of an analysis without its input bag
    are shown on their own.
    """
    source = analyzed_bag(path.parent) if path.name in ANALYZED else None
    return (path, None) if source is None else (source[0], path)


def show(path: Path, estimates: Path | None, scene: Scene, params: EstimatorParams, *,
         estimate: bool, describe: Callable[[str], None],
         progress: Progress = lambda share: None, names: TopicNames = STANDARD_NAMES) -> None:
    """
    Show the bag ``path`` and, if given, the bag of ``estimates`` from it.

    With ``estimate`` or without recorded estimates, the estimators are run on it.

    ``describe`` is called with one line that says which estimates are shown. ``names`` are the
    topics with other names in the bag. Raises BagError.
    """
    with ExitStack() as stack:
        bag = stack.enter_context(Bag(path, names, params.robot.joints))
        for stamp_ns, status in bag.statuses():
            scene.add_status(stamp_ns, status)
        if images := image_topic(bag):
            for receive_ns, _, data in bag.raw({images}):
                scene.add_image(receive_ns, bag.types[images], data)
        other = None if estimates is None else stack.enter_context(Bag(estimates))
        topics = scene.topics
        seen: Iterator[tuple[int, str, Sample]] = iter(())
        if other is not None and other.match(OVERHEAD):  # of "smart_tire overhead"
            topics, seen, other = without(topics, OVERHEAD), other.samples(OVERHEAD), None
        if estimate or (other is None and not set(REQUIRED) <= bag.match(REQUIRED).keys()):
            describe(f'{path}: estimates computed now with these parameters'
                     + ('' if estimate else ' (the bag has none)'))
            samples = _estimated(bag, without(topics, ESTIMATES), scene, params)
        elif other is not None:
            describe(f'{path}: estimates of {estimates}')
            samples, seen = bag.samples(without(topics, ESTIMATES)), other.samples(ESTIMATES)
        else:
            describe(f'{path}: recorded estimates')
            samples = bag.samples(topics)
        samples = heapq.merge(samples, seen, key=itemgetter(0))
        _feed(samples, scene, bag.span_ns, progress)


def image_topic(bag: Bag) -> str:
    """Return the topic of the images of the overhead camera; '' if the bag has none."""
    return next((name for standard, kind in IMAGES.items() for name, one in bag.types.items()
                 if one == kind and f'/{name}'.endswith(f'/{standard}')), '')


def _feed(samples: Iterator[tuple[int, str, Sample]], scene: Scene, span_ns: tuple[int, int],
          progress: Progress) -> None:
    start, end = span_ns
    for count, (receive_ns, topic, sample) in enumerate(samples):
        scene.add_sample(topic, sample)
        if count % FLUSH_SAMPLES == 0:
            scene.flush()
            progress(min((receive_ns - start) / max(1, end - start), 1.0))
    scene.finish()
    progress(1.0)


def _estimated(bag: Bag, topics: Iterable[str], scene: Scene,
               params: EstimatorParams) -> Iterator[tuple[int, str, Sample]]:
    """Yield the samples of ``topics`` in ``bag``, and the estimates computed from them."""
    pipeline, receive_ns = Pipeline(params), 0
    for receive_ns, topic, sample in bag.samples(topics):
        yield receive_ns, topic, sample
        if topic in INPUTS:
            for found in pipeline.update(sample):
                yield receive_ns, topic_of(found), found
                if isinstance(found, Friction):
                    scene.add_status(found.stamp_ns, NodeStatus(
                        'friction_estimator', 0, 'computed now', pipeline.status))
    for found in pipeline.finish():
        yield receive_ns, topic_of(found), found


def without(topics: Iterable[str], others: Collection[str]) -> tuple[str, ...]:
    """Return those of ``topics`` that are not in ``others``."""
    return tuple(topic for topic in topics if topic not in others)
