# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Images of messages, and tags in them."""

from __future__ import annotations

from array import array
import math
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from smart_tire.errors import MessageError, ParameterError
from smart_tire.vision.detection import (
    dictionary_of, ENCODINGS, gray_image, other_families, refined, TagDetector)
from support.overhead import image_msg

RNG = np.random.default_rng(3)
COLORS = np.repeat(np.repeat(RNG.integers(40, 220, (6, 8, 3), np.uint8), 10, 0), 10, 1)  # r, g, b
GRAY = cv2.cvtColor(COLORS, cv2.COLOR_RGB2GRAY)


def encoded(encoding):
    """Return the pixels of COLORS in an encoding of ROS."""
    red, green, blue = (COLORS[..., i] for i in range(3))
    opaque = np.full_like(red, 255)
    if encoding.startswith('bayer'):
        plane = np.empty_like(red)
        for number, letter in enumerate(encoding[6:10]):
            part = np.s_[number // 2::2, number % 2::2]
            plane[part] = {'r': red, 'g': green, 'b': blue}[letter][part]
        return plane
    planes = {'mono8': GRAY, '8UC1': GRAY, 'rgb8': (red, green, blue), 'bgr8': (blue, green, red),
              '8UC3': (blue, green, red), 'rgba8': (red, green, blue, opaque),
              'bgra8': (blue, green, red, opaque)}[encoding]
    return planes if encoding in ('mono8', '8UC1') else np.stack(planes, -1)


@pytest.mark.parametrize('encoding', ENCODINGS)
def test_every_encoding_becomes_the_same_gray(encoding):
    found = gray_image(image_msg(np.ascontiguousarray(encoded(encoding)), 1, encoding))
    assert found.shape == GRAY.shape and found.dtype == np.uint8
    inner = np.s_[4::10, 4::10]  # in the middle of the patches, where colors do not mix
    middle = np.abs(found[inner].astype(int) - GRAY[inner])
    assert middle.max() <= (3 if encoding.startswith('bayer') else 1)


@pytest.mark.parametrize('as_data', [bytes, lambda data: array('B', data),
                                     lambda data: np.frombuffer(data, np.uint8)])
def test_rows_may_be_padded_and_data_of_any_buffer(as_data):
    padded = np.hstack([GRAY, np.full((len(GRAY), 5), 7, np.uint8)])
    msg = image_msg(padded, 1)
    msg.width, msg.step, msg.data = GRAY.shape[1], padded.shape[1], as_data(msg.data)
    assert np.array_equal(gray_image(msg), GRAY)


@pytest.mark.parametrize(('changes', 'said'), [
    ({'encoding': 'mono16'}, 'mono16'), ({'data': b'\0' * 10}, '10 bytes'),
    ({'step': 3}, 'rows of 3'), ({'width': 0}, '0 x'), ({'height': 0}, 'x 0')])
def test_an_incomplete_image_is_refused(changes, said):
    msg = image_msg(GRAY, 1)
    for name, value in changes.items():
        setattr(msg, name, value)
    with pytest.raises(MessageError, match=said):
        gray_image(msg)


@pytest.mark.parametrize(('suffix', 'error'), [('.png', 0), ('.jpg', 12)])
def test_compressed_images_are_decoded(suffix, error):
    data = cv2.imencode(suffix, cv2.cvtColor(GRAY, cv2.COLOR_GRAY2BGR))[1].ravel()
    found = gray_image(SimpleNamespace(format=suffix[1:], data=data))
    assert np.abs(found.astype(int) - GRAY).max() <= error


@pytest.mark.parametrize('data', [b'', b'\xff\xd8\xff', b'no image at all' * 9])
def test_damaged_compressed_images_are_refused(data):
    with pytest.raises(MessageError, match=f'{len(data)} bytes'):
        gray_image(SimpleNamespace(format='jpeg', data=data))


@pytest.mark.parametrize(('name', 'count'), [
    ('36h11', 587), ('tag36h11', 587), ('25h9', 35), ('DICT_4X4_50', 50), ('4X4_50', 50),
    ('ARUCO_ORIGINAL', 1024)])
def test_families_have_the_names_of_apriltag_and_opencv(name, count):
    assert len(dictionary_of(name).bytesList) == count


def test_an_unknown_family_is_a_parameter_error_that_lists_the_known_ones():
    with pytest.raises(ParameterError, match="'36h12', expected one of .*4X4_50"):
        dictionary_of('36h12')


def sheet(*tags, family='36h11'):
    """Return an image with tags (id, column, row) of 60 pixels."""
    image = np.full((200, 400), 230, np.uint8)
    for tag, column, row in tags:
        image[row:row + 60, column:column + 60] = cv2.aruco.generateImageMarker(
            dictionary_of(family), tag, 60)
    return image


def test_corners_begin_at_the_upper_left_of_the_upright_tag_clockwise():
    tags, repeated = TagDetector('36h11').tags(sheet((3, 40, 50), (9, 200, 90)))
    assert sorted(tags) == [3, 9] and repeated == []
    expected = np.array([[39.5, 49.5], [99.5, 49.5], [99.5, 109.5], [39.5, 109.5]])
    assert np.abs(tags[3] - expected).max() < 0.02


@pytest.mark.parametrize('angle', [0.02, 0.4, 0.785, 2.5])
def test_corners_are_where_the_edges_meet_whatever_the_light(angle):
    """Blurred, noisy, a part in the shadow, and a part of an edge hidden."""
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    exact = 100.3 + 30.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ turn.T
    y, x = np.mgrid[0:1600, 0:1600] / 8.0 - 0.5 + 1.0 / 16.0  # eight samples to a pixel
    inner = np.abs(np.stack([x - 100.3, y - 100.3], axis=-1) @ turn).max(axis=-1)
    fine = np.where(inner < 30.0, 20.0, 220.0) * np.where(x > 108.0, 0.4, 1.0)
    image = fine.reshape(200, 8, 200, 8).mean(axis=(1, 3))
    image = cv2.GaussianBlur(image, (0, 0), 1.2) + RNG.normal(0.0, 2.0, image.shape)
    middle = (0.7 * exact[0] + 0.3 * exact[1]).round().astype(int)
    image[middle[1] - 2:middle[1] + 3, middle[0] - 2:middle[0] + 3] = 220.0
    start = exact + np.array([[0.8, -0.6], [-0.7, 0.9], [0.5, 0.8], [-0.9, -0.4]])
    found = refined(np.clip(image, 0, 255).astype(np.uint8), start)
    assert np.abs(found - exact).max() < 0.15
    assert abs(turned(found) - turned(exact)) < 0.002


def turned(corners):
    """Return the direction [rad] of the upper edge and, against it, the lower one."""
    along = (corners[1] - corners[0]) + (corners[2] - corners[3])
    return math.atan2(along[1], along[0])


def test_a_tag_that_is_there_twice_is_not_found_but_reported():
    tags, repeated = TagDetector('36h11').tags(sheet((3, 40, 50), (3, 200, 90), (4, 300, 20)))
    assert list(tags) == [4] and repeated == [3]


def test_tags_of_another_family_are_recognized():
    image = sheet((3, 40, 50), family='25h9')
    assert TagDetector('36h11').tags(image) == ({}, [])
    assert other_families('36h11', [image]) == [
        'there are tags of 25h9, overhead.tag_family is 36h11']
    assert other_families('36h11', [sheet()]) == []
