# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Estimates from the overhead camera in a bag: ``smart_tire overhead``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain, islice
import json
import math
from pathlib import Path
from typing import Any, cast, TYPE_CHECKING

import numpy as np

from smart_tire.analysis.figure import CAMERA, Curve, Figure, GAP, Mark, Panel, PICTURE
from smart_tire.analysis.summary import plain, Tree
from smart_tire.bags import Bag, BagWriter, Decoder, PARAMETERS_KEY
from smart_tire.errors import BagError, EstimatorError, MessageError
from smart_tire.messages import IMAGES, topic_of
from smart_tire.parameters import (
    build, known_names, load_files, NODE_PARAMS, OverheadLocalizerParams)
from smart_tire.parameters.files import blocks_in, snapshot_text, values_for
from smart_tire.parameters.spec import values_of
from smart_tire.paths import explained
from smart_tire.samples import NS_PER_S, Sample

if TYPE_CHECKING:
    from smart_tire.vision.overhead import CameraResult

NODE = 'overhead_localizer'
INFO_TYPE = 'sensor_msgs/msg/CameraInfo'
INFO_TOPIC = 'overhead_camera/camera_info'
INPUTS = ('imu/data', 'wheel_states')

Progress = Callable[[float], None]  # is called with the completed share, 0 to 1


def overhead_params(bag: Bag, files: Sequence[Path], **given: Any) -> OverheadLocalizerParams:
    """
    Return the parameters in the bag, in ``files`` and ``given``; later ones override.

    Raises ParameterError if one is invalid.
    """
    own = known_names([OverheadLocalizerParams])
    values = values_for(NODE, blocks_in(bag.parameters, f'{bag.path}: parameters in the bag'),
                        own) if bag.parameters else {}
    values |= load_files(files, NODE, known_names(NODE_PARAMS.values()), own, NODE_PARAMS)
    return build(OverheadLocalizerParams, values | given)


def camera_topics(bag: Bag) -> tuple[str, str]:
    """
    Return the topics of images and camera_info of the overhead camera in a bag; '' if it has none.

    They are recognized by their type if there is only one of it, which is added to the notes of
    the bag. Raises BagError if several may be meant.
    """
    def choose(standard: str, kind: str) -> str:
        found = [name for name, one in bag.types.items() if one == kind]
        named = [name for name in found if f'/{name}'.endswith(f'/{standard}')]
        if len(named or found) > 1:
            raise BagError(f'{len(named or found)} topics may be {standard}: '
                           + ', '.join(named or found))
        if found and not named:
            bag.notes.append(f'{standard}: using {found[0]}, the only topic of type {kind}')
        return (named or found or [''])[0]
    images = (choose(*one) for one in IMAGES.items())
    return next(filter(None, images), ''), choose(INFO_TOPIC, INFO_TYPE)


def locate(bag: Bag, params: OverheadLocalizerParams,
           progress: Progress = lambda share: None) -> CameraResult:
    """Return the estimates from the images of an open bag."""
    from smart_tire.vision.overhead import OverheadLocalizer
    (images, infos), localizer = camera_topics(bag), OverheadLocalizer(params)
    read = {name: Decoder(bag.types[name]) for name in (images, infos) if name}
    first = islice(bag.raw({infos}), 1)  # it may come after the first images
    start, end = bag.span_ns
    for receive_ns, channel, data in chain(first, bag.raw(set(read))) if images else ():
        is_image = channel.topic == images
        try:
            (localizer.add_image if is_image else localizer.add_camera_info)(
                read[channel.topic](data))
        except MessageError as error:
            localizer.refuse(error, is_image=is_image)
        if is_image:
            progress((receive_ns - start) / max(1, end - start))
    return localizer.result(bag.recording(INPUTS if images else ()))


def write(result: CameraResult, bag: Path, out: Path, params: OverheadLocalizerParams,
          notes: Sequence[str] = ()) -> Tree:
    """Write estimates and summary into the folder ``out``; return the summary."""
    values = values_of(params)
    samples = estimates_of(result, params.robot.wheel_radius)
    with explained(out, 'made'):
        out.mkdir(parents=True, exist_ok=True)
    if samples:
        with BagWriter(out / 'estimates', custom_data={
                PARAMETERS_KEY: snapshot_text({NODE: values})}) as writer:
            for sample in samples:
                writer.write_sample(f'overhead/{topic_of(sample)}', sample.stamp_ns, sample)
        from smart_tire.analysis.drawing import save
        save(frame_figure(result, params), out / PICTURE)
    summary = summary_of(result, bag, values, notes)
    (out / 'summary.json').write_text(
        json.dumps(summary, indent=2, allow_nan=False) + '\n', encoding='utf-8')
    return summary


def estimates_of(result: CameraResult, wheel_radius: float) -> list[Sample]:
    """Return poses and slips in the order of their timestamps."""
    return sorted((*(sample for motion in result.motions
                     for sample in motion.odometry(wheel_radius)), *result.slips),
                  key=lambda sample: sample.stamp_ns)


def frame_figure(result: CameraResult, params: OverheadLocalizerParams) -> Figure:
    """Return the first image with a pose, and the path in it, as in paper B, Fig. 9."""
    caption = ('First image of the overhead camera in which the robot was found. Line: path of '
               'base_link by the camera, at the height of the tag; interrupted in gaps.')
    return Figure('camera', 'Image of the overhead camera, with the path of the robot', caption,
                  [[frame_panel(result, params)]], (9.0, 5.2))


def frame_panel(result: CameraResult, params: OverheadLocalizerParams) -> Panel:
    """Return the panel of ``frame_figure``; raise EstimatorError without a pose."""
    if result.frame is None:
        raise EstimatorError('the robot is in no image')
    camera, image = result.frame
    height = params.robot.wheel_radius + params.overhead.tag_position[2]
    path = np.concatenate([rows for motion in result.motions for rows in (camera.pixels(
        np.column_stack([motion.pose[:, :2], np.full(len(motion.pose), height)])), GAP)])
    return Panel([Mark(Curve(*path.T), f'path, {CAMERA}', 'orange', width=2.4),
                  Mark(Curve(*path[:1].T), 'start', 'vermillion', 'points', 7.0)],
                 'column [pixels]', 'row [pixels]', image=image)


def summary_of(result: CameraResult, bag: Path, values: Mapping[str, Any],
               notes: Sequence[str]) -> Tree:
    """Return what ``summary.json`` contains."""
    stamps = [stamp for motion in result.motions for stamp in motion.stamp_ns]
    return cast(Tree, plain({
        'bag': str(bag),
        'parameters': {name: value for name, value in values.items()
                       if name.startswith('overhead.')},
        'notes': [*notes, *result.hints],
        'duration_s': (max(stamps) - min(stamps)) / NS_PER_S if stamps else 0.0,
        'frames': result.images, 'detections': result.detections, 'used': result.published,
        'missing': result.lost,
        'refused': dict(result.refused.most_common()),
        'gaps': [{'begin_s': begin, 'duration_s': duration} for begin, duration in result.gaps],
        'time_offset': {'value_s': result.offset.value, 'sigma_s': result.offset.sigma,
                        'source': result.offset_source} if result.motions else None,
        'row_time': {'value_s': result.row_time.value, 'sigma_s': result.row_time.sigma},
        'pixel_noise': result.noise, 'inset': result.inset,
        'pose_noise_factor': math.nan if not result.motions else max(
            motion.noise for motion in result.motions),
        'estimates': {'overhead/odom': result.published, 'overhead/wheel_slip': len(result.slips)},
    }))
