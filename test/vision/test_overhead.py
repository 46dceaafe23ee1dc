# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Good and bad images of the camera, offline and live."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from smart_tire.bags.cdr import empty
from smart_tire.errors import ParameterError
from smart_tire.estimation import streams
from smart_tire.messages.describe import NODE_TABLE
from smart_tire.messages.header import set_header
from smart_tire.parameters import OverheadLocalizerParams
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import GRAVITY, NS_PER_S, Odometry, WheelSlip
from smart_tire.vision.overhead import LiveLocalizer, NO_TAG, OverheadLocalizer, SCALE, Scale
from smart_tire.vision.renderer import Renderer
from support.ideal_robot import odometry
from support.overhead import (
    fixes_of, image_msg, info_msg, RADIUS, SMALL, SMALL_PLACE, START_NS, wheel_samples)

PARAMS = OverheadLocalizerParams(overhead=OverheadParams(**SMALL_PLACE, time_offset=0.0))
VELOCITY = np.array([0.3, 0.0, 0.0])


def motion(times):
    """Return poses of a robot that drives along x."""
    return np.array([-0.3, 0.1, 0.0]) + np.outer(np.asarray(times), VELOCITY)


@pytest.fixture(scope='module')
def renderer():
    """Return a renderer of small images."""
    return Renderer(SMALL, PARAMS.overhead, RADIUS)


@pytest.fixture(scope='module')
def images(renderer):
    """Return rendered images and their stamps [ns], 15 per second."""
    return [(START_NS + round(k / 15 * NS_PER_S), renderer.image(k / 15, motion))
            for k in range(16)]


def localizer(renderer, params=PARAMS, **changes):
    """Return a localizer that has the camera_info of the renderer."""
    one = OverheadLocalizer(params)
    one.add_camera_info(info_msg(renderer.camera.intrinsics, **changes))
    return one


def fed(one, messages):
    """Return the result of a localizer after ``messages``."""
    for msg in messages:
        one.add_image(msg)
    return one.result(SampleArrays())


def messages(images):
    """Return the images as messages."""
    return [image_msg(image, stamp_ns) for stamp_ns, image in images]


def test_every_image_with_a_tag_gives_a_pose(renderer, images):
    found = fed(localizer(renderer), messages(images))
    assert found.published == found.detections == found.images == 16
    (part,) = found.motions
    assert np.abs(part.pose[:, :2] - motion(np.arange(16) / 15)[:, :2]).max() < 0.003
    assert np.abs(part.twist[:, 0] - 0.3).max() < 0.03
    assert not found.refused and not found.gaps and found.lost == 0
    assert found.line() == '16 of 16 images used'
    assert found.slips == []  # without wheel_states


def test_frames_out_of_order_doubled_and_lost_leave_the_others(renderer, images):
    sent = messages(images)
    shuffled = [*sent[:3], sent[5], sent[4], sent[3], sent[5], *sent[9:], sent[9]]
    found = fed(localizer(renderer), shuffled)
    assert found.published == 13
    assert found.refused == {'timestamp repeated': 2}
    assert found.lost == 3
    assert found.gaps == [(pytest.approx(5 / 15, abs=0.01), pytest.approx(4 / 15, abs=0.01))]
    stamps = found.motions[0].stamp_ns
    assert list(stamps) == sorted(stamps)
    assert found.line() == ('13 of 15 images used, 3 missing between timestamps: '
                            '2 timestamp repeated')


def test_a_later_image_is_not_refused_for_one_from_the_future(renderer, images):
    sent = messages(images)
    early = image_msg(images[2][1], START_NS + 3600 * NS_PER_S)
    found = fed(localizer(renderer), [early, *sent])
    assert found.published == 16
    assert found.refused == {'fewer than 5 images between gaps': 1}


def test_without_camera_info_nothing_is_estimated(renderer, images):
    found = fed(OverheadLocalizer(PARAMS), messages(images[:4]))
    assert found.published == 0 and found.refused == {'no camera_info': 4}


def test_a_camera_info_with_zeros_is_refused_until_a_valid_one_comes(renderer, images):
    one = localizer(renderer, k=np.zeros(9))
    sent = messages(images)
    for msg in sent[:4]:
        assert one.add_image(msg) is None
    one.add_camera_info(info_msg(renderer.camera.intrinsics))
    found = fed(one, sent[4:])
    assert found.published == 12
    assert [(reason[:30], count) for reason, count in found.refused.items()] == [
        ('camera_info: K is [0.0, 0.0, 0', 4)]


def test_images_of_another_size_are_refused_alone(renderer, images):
    halves = [image_msg(np.ascontiguousarray(image[::2, ::2]), stamp_ns + 1)
              for stamp_ns, image in images[:3]]
    found = fed(localizer(renderer), [*halves, *messages(images)])
    assert found.published == 16
    assert found.refused == {'size 160 x 120, camera_info has 320 x 240': 3}


def test_images_that_are_none_have_no_tag_or_no_time_are_counted_by_reason(renderer, images):
    stamp_ns, image = images[0]
    blank = image_msg(np.full_like(image, 128), stamp_ns + 1)
    header = SimpleNamespace(stamp=SimpleNamespace(), frame_id='')
    damaged = SimpleNamespace(header=header, format='jpeg', data=b'12345')
    set_header(damaged, stamp_ns + 2, '')
    found = fed(localizer(renderer), [blank, damaged, image_msg(image, 0), *messages(images)])
    assert found.published == 16
    assert found.refused == {
        NO_TAG: 1, "image: 5 bytes of format 'jpeg' are no image": 1, 'timestamp is zero': 1}


def test_two_tags_of_one_id_are_no_pose(renderer, images):
    stamp_ns, image = images[0]
    twin = np.hstack([image[:, :160], image[:, 10:170]])
    assert fed(localizer(renderer), [image_msg(twin, stamp_ns)]).refused == {
        'tag 0 more than once': 1}


@pytest.mark.parametrize(('changes', 'reason', 'hint'), [
    ({'tag_family': '25h9'}, NO_TAG, 'there are tags of 36h11, overhead.tag_family is 25h9'),
    ({'tag_ids': (5,)}, 'other tags only (0)', ''),
    ({'tag_size': 0.20}, 'size of the tag contradicts overhead.tag_size and the height of the '
                         'camera', '')])
def test_a_wrong_tag_is_named_and_never_used(renderer, images, changes, reason, hint):
    params = replace(PARAMS, overhead=replace(PARAMS.overhead, **changes))
    found = fed(localizer(renderer, params), messages(images[:6]))
    assert found.published == 0 and found.refused == {reason: 6}
    assert found.hints == [hint] * bool(hint)


@pytest.mark.parametrize('name', ['camera_position', 'camera_rotation'])
def test_the_place_of_the_camera_must_be_given(name):
    with pytest.raises(ParameterError, match=f'overhead.{name} is not given'):
        OverheadLocalizer(replace(PARAMS, overhead=replace(PARAMS.overhead, **{name: ()})))


def test_compressed_images_give_the_same_poses(renderer, images):
    one, other = localizer(renderer), localizer(renderer)
    for (stamp_ns, image), msg in zip(images[:3], messages(images)):
        packed = empty('sensor_msgs/msg/CompressedImage')
        set_header(packed, stamp_ns, '')
        packed.format, packed.data = 'png', cv2.imencode('.png', image)[1].ravel()
        assert np.array_equal(one.add_image(packed).pose, other.add_image(msg).pose)


def test_live_estimates_lag_behind_and_are_published_once(renderer, images):
    one = LiveLocalizer(PARAMS)
    one.add_camera_info(info_msg(renderer.camera.intrinsics))
    found = [(stamp_ns, sample) for (stamp_ns, _), msg in zip(images, messages(images))
             for sample in one.estimates(msg)]
    stamps = [sample.stamp_ns for _, sample in found]
    assert len(stamps) == len(set(stamps)) >= 4 and stamps == sorted(stamps)
    for stamp_ns, sample in found:
        assert isinstance(sample, Odometry)
        assert stamp_ns - sample.stamp_ns >= 0.5 * NS_PER_S
        time = (sample.stamp_ns - START_NS) / NS_PER_S
        assert sample.position[:2] == pytest.approx(motion([time])[0, :2], abs=0.004)
        assert sample.linear[0] == pytest.approx(0.3, abs=0.04)


def test_live_estimates_continue_after_the_clock_was_set_back(renderer, images):
    one = LiveLocalizer(PARAMS)
    one.add_camera_info(info_msg(renderer.camera.intrinsics))
    later = [image_msg(image, stamp_ns + 3600 * NS_PER_S) for stamp_ns, image in images]
    assert [sample for msg in later for sample in one.estimates(msg)]
    again = [sample for msg in messages(images) for sample in one.estimates(msg)]
    assert again and all(sample.stamp_ns < START_NS + 2 * NS_PER_S for sample in again)


def test_the_camera_is_no_input_of_an_estimator_or_controller():
    for stream in (streams.SLIP, streams.FRICTION):
        assert not any('overhead' in name for name in stream.inputs.values())
    readers = {name for name, node in NODE_TABLE.items()
               if any(topic.startswith('overhead') for topic in node.subscribes)}
    assert readers == {'overhead_localizer'}


def straight(scale, *, speed=0.4, rate=0.0, acceleration=0.0, step=0.1, count=30, slips=True):
    """Return estimates whose speed is ``scale`` times that of the wheels."""
    found = []
    for k in range(count):
        stamp_ns, wheels = START_NS + round(k * step * NS_PER_S), speed + acceleration * k * step
        found.append(odometry(stamp_ns, v_x=scale * wheels, yaw_rate=rate, variance=1e-12))
        if slips:
            found.append(WheelSlip(stamp_ns, (0.0,) * 4, ((1.0 - scale) * wheels,) * 4,
                                   (0.01,) * 4))
    return found


EXACT = replace(PARAMS, robot=replace(PARAMS.robot, wheel_radius_sigma=0.0))


def deviation(samples, params=EXACT):
    """Return the deviation of a scale by ``samples``."""
    one = Scale(params)
    one.add(samples)
    return one.deviation


SLOPE = 0.02 * 10.9 * GRAVITY / (4.0 * 52.7)  # slip of the wheels on a slope of 2 %


@pytest.mark.parametrize('speed', [0.4, -0.4])
def test_the_scale_deviates_by_slope_radius_and_height_together(speed):
    assert deviation(straight(1.0 + 2.0 * SLOPE, speed=speed)) == pytest.approx(2.0, rel=1e-3)
    assert deviation(straight(1.0 - 4.0 * SLOPE, speed=speed)) == pytest.approx(-4.0, rel=1e-3)
    both = replace(EXACT, robot=replace(EXACT.robot, wheel_radius_sigma=SLOPE))
    assert deviation(straight(1.0 + 2.0 * SLOPE), both) == pytest.approx(2.0 / 2 ** 0.5, rel=1e-3)
    height = SMALL.position[2] - RADIUS - 0.15
    high = replace(EXACT, overhead=replace(
        PARAMS.overhead, camera_position_sigma=(0.0, 0.0, SLOPE * height)))
    assert deviation(straight(1.0 + 2.0 * SLOPE), high) == pytest.approx(2.0 / 2 ** 0.5, rel=1e-3)


@pytest.mark.parametrize('changes', [
    {'rate': 0.11}, {'acceleration': 0.25}, {'step': 0.6, 'count': 10}, {'count': 12},
    {'slips': False}])
def test_turns_starts_gaps_and_short_ways_do_not_count_for_the_scale(changes):
    assert deviation(straight(1.2, **changes)) == 0.0
    assert deviation(straight(1.2)) > 3.0


@pytest.mark.parametrize(('share', 'published', 'said'), [
    (1.0, 90, ''), (1.1, 0, '1.31 m by the camera, 1.19 m by the wheels'),
    (0.8, 90, 'slip, or overhead')])
def test_a_scale_that_contradicts_the_wheels_is_refused_and_slip_is_not(
        renderer, share, published, said):
    one, way = localizer(renderer), 0.2  # m/s, by the wheels
    one.fixes = fixes_of(lambda time: np.array([share * way * time, 0.0, 0.0]))
    one._stamps = {fix.stamp_ns for fix in one.fixes}
    found = one.result(SampleArrays(wheel_samples(lambda time: np.full(4, way / RADIUS))))
    assert found.published == published
    assert len(found.slips) == published
    assert found.refused == ({} if published else {SCALE: 90})
    assert said in found.line() and bool(found.hints) == bool(said)
