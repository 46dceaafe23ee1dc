# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Corners of tags, poses and bags of an overhead camera for tests."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
from smart_tire.bags import BagWriter, channel_of
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.messages.header import set_header
from smart_tire.parameters.overhead import ImageParams
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample
from smart_tire.vision.camera import Camera, Intrinsics
from smart_tire.vision.localization import Fix, NOMINAL_INSET, PoseFit

START_NS = 1_700_000_000 * NS_PER_S
RADIUS = 0.087
PLACE, ANGLES = (0.2, -0.1, 2.6), (3.0, 0.1, 0.4)
PARAMS = OverheadParams(camera_position=PLACE, camera_rotation=ANGLES)
K = np.array([[900.0, 0.0, 640.0], [0.0, 905.0, 360.0], [0.0, 0.0, 1.0]])
SMALL = ImageParams(size=(320, 240), focal_length=300.0, position=(0.0, 0.0, 2.0), noise=1.0,
                    jpeg_quality=0)
SMALL_PLACE = {'camera_position': SMALL.position, 'camera_rotation': SMALL.rotation}


def camera(distortion=(), model='plumb_bob', place=PLACE, angles=ANGLES):
    """Return a camera of 1280 x 720 pixels that looks down."""
    return Camera(Intrinsics((1280, 720), K, np.array(distortion, dtype=float), model), place,
                  angles)


def corners(one, params, pose, inset=NOMINAL_INSET):
    """Return by id where the corners of the tags of a robot at ``pose`` are [pixels], (4, 2)."""
    fit = PoseFit(one, params, RADIUS)
    found = {}
    for tag, own in fit._corners.items():
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        flat = own[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
        exact = one.pixels(np.column_stack([flat, own[:, 2]]))
        middle = exact.mean(0)
        size = np.linalg.norm(np.roll(exact, -1, 0) - exact, axis=1).mean()
        found[tag] = middle + (exact - middle) * (1.0 - 2.0 * inset / size)
    return found


def fixes_of(motion, duration=6.0, rate=15.0, noise=1e-4, late=0.0, seed=0):
    """Return the fixes of ``motion``, which returns x, y, yaw at a time [s]; sigmas are right."""
    rng, found = np.random.default_rng(seed), []
    for k in range(round(duration * rate)):
        time = 1.0 + k / rate
        error = noise * rng.standard_normal(3) * (1.0, 1.0, 5.0)
        found.append(Fix(
            START_NS + round((time + late) * NS_PER_S), np.array(motion(time)) + error,
            np.diag([1.0, 1.0, 25.0]) * noise ** 2 * 100.0, 4 * 0.01, 4, NOMINAL_INSET,
            np.zeros((3, 3)), 'scatter'))
    return found


def imu_samples(yaw_rate, duration=8.0):
    """Return samples of a gyroscope at 100 Hz."""
    return [ImuSample(START_NS + k * 10_000_000, (0.0, 0.0, 9.81), (0.0, 0.0, yaw_rate(0.01 * k)))
            for k in range(round(100 * duration))]


def wheel_samples(speeds, duration=8.0, rate=16.0):
    """Return samples of wheels whose angles are integrals of ``speeds`` (time) -> four [rad/s]."""
    angle, found, step = np.zeros(4), [], 1.0 / rate
    for k in range(1, round(duration * rate)):
        fine = (k - 1 + (np.arange(20) + 0.5) / 20) * step
        moved = np.mean([speeds(one) for one in fine], axis=0) * step
        angle = angle + moved
        found.append(WheelSample(START_NS + round(k * step * NS_PER_S), tuple(moved / step),
                                 tuple(angle)))
    return found


def image_msg(image, stamp_ns, encoding='mono8'):
    """Return an Image with gray values."""
    msg = SimpleNamespace(header=SimpleNamespace(stamp=SimpleNamespace(), frame_id=''),
                          height=image.shape[0], width=image.shape[1], encoding=encoding,
                          step=image.strides[0], data=image.tobytes())
    set_header(msg, stamp_ns, 'overhead_camera_optical_frame')
    return msg


def info_msg(inner, **changes):
    """Return a CameraInfo with the intrinsics ``inner``."""
    msg = inner.fill(empty('sensor_msgs/msg/CameraInfo'))
    for name, value in changes.items():
        setattr(msg, name, value)
    return msg


def write_bag(folder, renderer, motion, times, samples=(), *, compressed=True, info=True):
    """Write rendered images at ``times`` [s] and ``samples`` into a bag; return its path."""
    kind = 'CompressedImage' if compressed else 'Image'
    topic = '/overhead_camera/image_raw' + ('/compressed' if compressed else '')
    encode, encode_info = (Encoder(f'sensor_msgs/msg/{one}') for one in (kind, 'CameraInfo'))
    with BagWriter(folder) as writer:
        writer.add_topic(channel_of(topic, f'sensor_msgs/msg/{kind}'))
        writer.add_topic(channel_of('/overhead_camera/camera_info', 'sensor_msgs/msg/CameraInfo'))
        for name, sample in samples:
            writer.write_sample(name, sample.stamp_ns, sample)
        for time in times:
            stamp_ns, image = START_NS + round(time * NS_PER_S), renderer.image(time, motion)
            msg = image_msg(image, stamp_ns)
            if compressed:
                msg = SimpleNamespace(header=msg.header, format='png',
                                      data=cv2.imencode('.png', image)[1].ravel())
            else:
                msg.is_bigendian, msg.data = 0, np.frombuffer(msg.data, np.uint8)
            if info:
                sent = info_msg(renderer.camera.intrinsics)
                set_header(sent, stamp_ns, 'overhead_camera_optical_frame')
                writer.write('/overhead_camera/camera_info', stamp_ns, encode_info(sent))
            writer.write(topic, stamp_ns, encode(msg))
    return folder
