# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Images of the overhead camera in the viewer: rate, tags, references, images not shown."""

from __future__ import annotations

import json
import math
import sys

import numpy as np
import pytest

from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.bags import BagWriter
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.cli.main import main
from smart_tire.messages.header import set_header
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.samples import NS_PER_S, WheelSlip
from smart_tire.view.bag import find_bags, show
from smart_tire.view.scene import IMAGE_PERIOD_NS
from smart_tire.view.writer import CAMERA
from smart_tire.vision.detection import TagDetector
from smart_tire.vision.renderer import Renderer
from support import ideal_robot
from support.overhead import RADIUS, SMALL, SMALL_PLACE, START_NS, write_bag
from support.rerun_file import RerunFile

IMAGE = 'sensor_msgs/msg/Image'
RATE = 10.0  # Hz


def motion(times):
    """Return poses of a robot that drives along x."""
    return np.array([-0.3, 0.1, 0.0]) + np.outer(times, [0.3, 0.0, 0.0])


@pytest.fixture(scope='module')
def renderer():
    """Return a renderer of small images."""
    return Renderer(SMALL, OverheadParams(**SMALL_PLACE), RADIUS)


def cdr(image, stamp_ns, encoding='mono8'):
    """Return an Image in CDR."""
    msg = empty(IMAGE)
    set_header(msg, stamp_ns, 'overhead_camera_optical_frame')
    msg.height, msg.width = image.shape
    msg.step, msg.encoding, msg.data = msg.width, encoding, image.ravel()
    return Encoder(IMAGE)(msg)


def at(seconds):
    """Return the stamp [ns] of a time."""
    return START_NS + round(seconds * NS_PER_S)


def test_images_are_shown_twice_a_second_with_the_tags_in_them(recorded, renderer):
    pictures = {k: renderer.image(k / RATE, motion) for k in range(12)}

    def feed(scene):
        for k, picture in pictures.items():
            scene.add_image(at(k / RATE), IMAGE, cdr(picture, at(k / RATE)))

    found = recorded(feed)
    shown = found.rows('camera/image', 'EncodedImage:blob')
    assert [time for time, _ in shown] == [0, IMAGE_PERIOD_NS, 2 * IMAGE_PERIOD_NS]
    assert all(bytes(blob[0]).startswith(b'\xff\xd8') for _, blob in shown)  # JPEG
    tags = found.rows('camera/tags', 'LineStrips2D:strips')
    for (time, (strip,)), k in zip(tags, (0, 5, 10)):
        corners = TagDetector('36h11').tags(pictures[k])[0][0]
        assert time == round(k / RATE * NS_PER_S)
        assert np.array(strip) == pytest.approx(np.vstack([corners, corners[:1]]), abs=1e-3)
    assert [labels for _, labels in found.rows('camera/tags', 'LineStrips2D:labels')] == [
        ['tag 0']] * 3


def test_an_image_without_tag_clears_the_outline_and_a_clock_may_be_set_back(recorded, renderer):
    picture = renderer.image(0.0, motion)

    def feed(scene):
        scene.add_image(0, IMAGE, cdr(picture, at(10.0)))
        scene.add_image(0, IMAGE, cdr(np.full((240, 320), 90, np.uint8), at(11.0)))
        scene.add_image(0, IMAGE, cdr(picture, at(2.0)))

    tags = recorded(feed).rows('camera/tags', 'LineStrips2D:strips')
    assert [(time / NS_PER_S, len(strips)) for time, strips in tags] == [
        (-8.0, 1), (0.0, 1), (1.0, 0)]


def events(found):
    """Return the texts of all events."""
    return [text[0] for _, text in found.rows('links/events', 'TextLog:text')]


def test_why_an_image_is_not_shown_is_said_once(recorded, renderer):
    picture = renderer.image(0.0, motion)

    def feed(scene):
        for k in range(3):
            scene.add_image(at(k), IMAGE, cdr(picture, at(k), 'mono16'))
        scene.add_image(at(3), IMAGE, b'')
        scene.add_image(at(4), IMAGE, cdr(picture, at(4)))

    found = recorded(feed)
    said = events(found)
    assert len(said) == 2 and said[0].startswith("image not shown: image: encoding 'mono16'")
    assert [time for time, _ in found.rows('camera/image', 'EncodedImage:blob')] == [4 * NS_PER_S]


def test_without_opencv_everything_else_is_shown(recorded, renderer, monkeypatch):
    picture = renderer.image(0.0, motion)
    monkeypatch.setitem(sys.modules, 'smart_tire.vision.detection', None)
    monkeypatch.setitem(sys.modules, 'cv2', None)

    def feed(scene):
        for k in range(3):
            scene.add_image(at(k), IMAGE, cdr(picture, at(k)))
        scene.add_sample('odom', ideal_robot.odometry(at(1.0), 1.0))

    found = recorded(feed)
    (said,) = events(found)
    assert said.endswith('is missing: pip install smart_tire[camera]')
    assert found.scalars('body/velocity/estimate')


def camera_slip(ratio, sigma):
    """Return the slip by the camera."""
    return WheelSlip(START_NS, ratio, (0.0,) * 4, sigma)


def test_the_camera_is_a_reference_of_its_own(recorded):
    def feed(scene):
        scene.add_sample('overhead/wheel_slip', camera_slip(
            (0.1, 0.2, 0.3, math.nan), (0.01, 0.6, 0.02, 1.0)))
        scene.add_sample('ground_truth/wheel_slip', camera_slip((0.11,) * 4, (0.0,) * 4))
        scene.add_sample('odom', ideal_robot.odometry(at(0.0), 1.0, 2.0))
        for k in range(20):
            scene.add_sample('overhead/odom', ideal_robot.odometry(
                at(0.1 * k), 7.0, 7.0 + 0.1 * k, math.pi / 2, variance=0.01))
            scene.add_sample('ground_truth/odom', ideal_robot.odometry(at(0.1 * k), 0.1 * k))

    found = recorded(feed)
    assert found.scalars('slip/front_left/camera')[0][1] == pytest.approx([0.1, 0.08, 0.12])
    for wheel in ('front_right', 'rear_right'):  # not observable, standstill
        assert np.isnan(found.scalars(f'slip/{wheel}/camera')[0][1]).all()
    assert found.scalars('slip/front_right/truth')[0][1] == pytest.approx([0.11])
    for name in ('camera', 'truth'):
        strips = found.rows(f'path/{name}', 'LineStrips2D:strips')
        assert strips[0][1][0][0] == pytest.approx((1.0, -2.0))
        assert strips[-1][1][-1][-1] == pytest.approx((2.9, -2.0), abs=1e-6)
    color = found.static('body/velocity/camera', 'SeriesLines:colors')[0]
    assert (color >> 24 & 255, color >> 16 & 255, color >> 8 & 255) == CAMERA


class FakeScene:
    """Keeps what it is given."""

    topics = ('imu/data', 'odom', 'wheel_slip', 'overhead/odom')

    def __init__(self):
        self.samples, self.images = [], []

    def add_sample(self, topic, sample):
        self.samples.append((topic, sample))

    def add_image(self, stamp_ns, kind, data):
        self.images.append(kind)

    def flush(self):
        pass

    def finish(self):
        pass


def places(scene, topic):
    """Return the x of the poses of a topic."""
    return [sample.position[0] for name, sample in scene.samples if name == topic]


def test_the_output_of_overhead_is_shown_with_the_bag_that_it_is_from(tmp_path, renderer):
    own = [('odom', ideal_robot.odometry(at(0.0), 1.0)),
           ('wheel_slip', camera_slip((0.1,) * 4, (0.1,) * 4)),
           ('overhead/odom', ideal_robot.odometry(at(0.0), 5.0))]
    bag = write_bag(tmp_path / 'drive', renderer, motion, [0.0, 0.1], own)
    out = tmp_path / 'out'
    with BagWriter(out / 'estimates') as writer:
        writer.write_sample('overhead/odom', at(0.05), ideal_robot.odometry(at(0.05), 6.0))
    (out / 'summary.json').write_text(json.dumps({'bag': str(bag)}), encoding='utf-8')
    for path, expected in ((bag, [5.0]), (out / 'estimates', [6.0])):
        scene, said = FakeScene(), []
        show(*find_bags(path), scene, EstimatorParams(), estimate=False, describe=said.append)
        assert said == [f'{bag}: recorded estimates']
        assert places(scene, 'odom') == [1.0]
        assert places(scene, 'overhead/odom') == expected
        assert scene.images == ['sensor_msgs/msg/CompressedImage'] * 2


def test_a_bag_with_images_has_a_page_of_them(tmp_path, renderer):
    slip = [('wheel_slip', camera_slip((0.1,) * 4, (0.1,) * 4)),
            ('odom', ideal_robot.odometry(at(0.0), 1.0))]
    with_images = write_bag(tmp_path / 'seen', renderer, motion, [0.0, 0.6], slip)
    with BagWriter(tmp_path / 'blind') as writer:
        for topic, sample in slip:
            writer.write_sample(topic, sample.stamp_ns, sample)
    for bag, count in ((with_images, 2), (tmp_path / 'blind', 0)):
        file = bag.with_suffix('.rrd')
        assert main(['view', str(bag), '--save', str(file), '--no-checks']) == 0
        found = RerunFile(file)
        assert len(found.rows('camera/image', 'EncodedImage:blob')) == count
        names = [parts['ContainerBlueprint:display_name'][0]
                 for parts in found.blueprint().values()
                 if parts.get('ContainerBlueprint:display_name')]
        assert ('Camera' in names) == bool(count)
