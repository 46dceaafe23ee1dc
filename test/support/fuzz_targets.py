# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the fuzz test feeds: readers of bytes from outside, with valid bytes to begin with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
import logging
import math
from pathlib import Path
from random import Random
import shutil
import struct
import tempfile
from unittest.mock import patch
import zlib

from mcap.writer import CompressionType, Writer as McapWriter
import numpy as np
from smart_tire.bags import Bag, recover
from smart_tire.bags.cdr import Decoder, SampleDecoder, SampleEncoder
from smart_tire.cli._path_file import read_path
from smart_tire.drivers.roboclaw_line import RoboclawLine
from smart_tire.drivers.sample_stream import FILM_CHARGE, IMU_PROTOCOLS, SampleStream
from smart_tire.drivers.serial_port import open_port
from smart_tire.drivers.tire_receiver import TireStream
from smart_tire.errors import BagError, FrameError, LinkError, MessageError, ParameterError
from smart_tire.estimation.film.calibration import read_params
from smart_tire.mapping.raster import png_bytes, read_raster
from smart_tire.messages import TOPICS
from smart_tire.nodes.friction_estimator import FrictionEstimatorNode
from smart_tire.nodes.slip_estimator import SlipEstimatorNode
from smart_tire.nodes.trajectory_controller import TrajectoryController
from smart_tire.nodes.wheel_controller import WheelController
from smart_tire.papers.film_files import COLUMNS, read_recording
from smart_tire.parameters import load_node, NODE_PARAMS
from smart_tire.paths import BAG_METADATA, port_url
from smart_tire.protocol import film_charge, roboclaw, vectornav, vectornav_ascii, xbee, xsens
from smart_tire.recording import Faults
from smart_tire.samples import NS_PER_S
from support.frames import frames
from support.hostile_messages import (
    changed_message, drive, EPOCH_NS, part_of, places, SECONDS as DRIVE_TIME)
from support.recordings import stream, write_bag, write_with_rosbags
from support.virtual_node import virtual

ROOT = Path(__file__).resolve().parents[2]
ADDRESS = 0x0013A20040A1B2C3  # of a sensor node
ARRIVAL_NS = 1_700_000_000_000_000_000
CHUNK = 7  # bytes; no frame is that short
SECONDS = 0.1  # of the bags
ATTACKED = 1.0  # s, of a node
CHANGED = 0.2   # share of the messages with a changed one before them
YAML_TOKENS = (b'&a ', b'*a', b'<<: ', b'? ', b'!!binary ', b'!!timestamp ', b'!!python/tuple ',
               b'2001-99-99', b'1e999', b'.nan', b'[' * 50, b'{a: ' * 50, b'\xef\xbb\xbf', b'\t')
URL_TOKENS = (b'simulated:', b'socket://', b'rfc2217://', b'spy://', b'loop://', b'alt://',
              b'hwgrep://', b'/dev/', b'../', b'?', b'&', b'=', b':', b'%00', b'\0', b'//', b'@',
              b'[::1]', b'99999999', b'-1')
CSV_TOKENS = (b'nan', b'inf', b'1e999', b'"', b';', b',,', b'\r', b'\0', b'\xef\xbb\xbf')


@dataclass(frozen=True)
class Target:
    """
    One reader of bytes.

    ``read`` takes any bytes; it raises nothing but the documented errors, which it catches
    itself, and returns whether it accepted anything. ``seal`` puts the checksum of a protocol
    around a body; with it, half the inputs are changed bodies that are sealed again.
    """

    seeds: Callable[[], Sequence[bytes]]
    read: Callable[[bytes], bool]
    tokens: tuple[bytes, ...] = ()
    bodies: Callable[[], Sequence[bytes]] = tuple
    seal: Callable[[bytes], bytes] | None = None


def _receiver_target(make: Callable[[], SampleStream | TireStream],
                     seal: Callable[[bytes], bytes], seeds: Callable[[], Sequence[bytes]],
                     delimited: bool) -> Target:
    """
    Return the target of a device; ``seeds`` are its streams.

    ``delimited``: no frame contains its start byte. Otherwise a frame inside an incomplete one is
    yielded if the rest of that has not arrived yet.
    """
    def bodies() -> list[bytes]:
        deframer = make()._deframer
        return [body for data in seeds() for body in deframer.extract(data)]

    def read(data: bytes) -> bool:
        whole, parts = make(), make()
        found = list(whole.receive(data, ARRIVAL_NS))
        split = [item for begin in range(0, len(data), CHUNK)
                 for item in parts.receive(data[begin:begin + CHUNK], ARRIVAL_NS)]
        if delimited:
            assert repr(split) == repr(found), 'the samples depend on how the stream is split'
            assert parts.frames_bad == whole.frames_bad, 'bad frames depend on how it is split'
        return bool(found)
    return Target(seeds, read, bodies=bodies, seal=seal)


class ReplyPort:
    """Serial port on which ``data`` arrives, whatever is asked; some of it unasked."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.timeout = self.write_timeout = 0.0

    @property
    def in_waiting(self) -> int:
        return min(len(self._data) % 23, len(self._data))

    def read(self, size: int) -> bytes:
        found, self._data = self._data[:size], self._data[size:]
        return found

    def write(self, data: bytes) -> int:
        return len(data)

    def reset_input_buffer(self) -> None:
        self._data = self._data[self.in_waiting:]


def _read_replies(data: bytes) -> bool:
    line = RoboclawLine()
    line.use(ReplyPort(data))
    for address in (0x80, 0x81):
        for command in (roboclaw.READ_ENCODERS, roboclaw.READ_CURRENTS, roboclaw.READ_TIMEOUT):
            with suppress(FrameError), patch('time.sleep'):
                line.exchange(address, command)
            with suppress(FrameError):
                roboclaw.decode_reply(address, command, data)
    with suppress(FrameError):
        roboclaw.decode_text_reply(0x80, roboclaw.READ_VERSION, data)
    return line.frames_ok > 0


def _read_requests(data: bytes) -> bool:
    return bool([roboclaw.decode_request(packet)
                 for packet in roboclaw.RequestDeframer().extract(data)])


def _read_bag(path: Path) -> bool:
    """Read all that a bag has, in each way, and recover it."""
    logging.getLogger('smart_tire').setLevel(logging.CRITICAL)
    try:
        with Bag(path) as bag:
            listed = bag.topics, bag.span_ns, bag.custom_data, bag.ros_distro, bag.warnings
            assert len(listed[0]) >= 0
            samples = sum(1 for _ in bag.samples(TOPICS))
            messages = sum(1 for _ in bag.raw())
            bag.losses.lines()
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            recovered = recover(path, Path(folder) / 'bag')
            assert sum(recovered.counts.values()) == messages
    except BagError:
        return False
    return samples > 0


def _bag_target(suffix: str, seeds: Callable[[Path], Sequence[bytes]]) -> Target:
    def read(data: bytes) -> bool:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f'bag{suffix}'
            path.write_bytes(data)
            return _read_bag(path)
    return Target(lambda: _in_folder(seeds), read)


def _in_folder(make: Callable[[Path], Sequence[bytes]]) -> Sequence[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        return make(Path(folder))


def _mcap_files(folder: Path) -> list[bytes]:
    write_bag(folder / 'bag', stream(SECONDS))
    plain = folder / 'plain.mcap'
    with plain.open('wb') as file:  # no CRC: changed bytes reach the readers of the records
        writer = McapWriter(file, compression=CompressionType.NONE, enable_crcs=False,
                            chunk_size=2000)
        writer.start('ros2')
        with Bag(folder / 'bag') as bag:
            numbers = {name: writer.register_channel(name, 'cdr', writer.register_schema(
                topic.channel.type, 'ros2msg', b'')) for name, topic in bag.topics.items()}
            for receive_ns, channel, data in bag.raw():
                writer.add_message(numbers[channel.topic], receive_ns, data, receive_ns)
        writer.finish()
    return [(folder / 'bag' / 'bag_0.mcap').read_bytes(), plain.read_bytes()]


def _databases(folder: Path) -> list[bytes]:
    write_with_rosbags(folder / 'bag', stream(SECONDS))
    return [path.read_bytes() for path in (folder / 'bag').glob('*.db3')]


def _metadata_files(folder: Path) -> list[bytes]:
    write_bag(folder / 'bag', stream(SECONDS))
    return [(folder / 'bag' / BAG_METADATA).read_bytes()]


def _read_metadata(data: bytes) -> bool:
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / 'bag'
        bag.mkdir()
        (bag / BAG_METADATA).write_bytes(data)
        shutil.copy(_one_bag(), bag / 'bag_0.mcap')
        return _read_bag(bag)


def _one_bag() -> Path:
    path = Path(tempfile.gettempdir()) / f'fuzz_{SECONDS}.mcap'
    if not path.exists():
        path.write_bytes(_in_folder(_mcap_files)[0])
    return path


def _messages() -> list[bytes]:
    """Return one message of each kind of sample, preceded by the number of its topic."""
    first = {topic: sample for _, topic, sample in reversed(stream(SECONDS))}
    names = list(TOPICS)
    return [bytes((names.index(name),)) + SampleEncoder(TOPICS[name])(sample)
            for name, sample in first.items()]


def _read_message(data: bytes) -> bool:
    name = list(TOPICS)[data[0] % len(TOPICS) if data else 0]
    with suppress(MessageError):
        Decoder(TOPICS[name].type)(data[1:])
    return bool(TOPICS[name].sample is not None and SampleDecoder(name, Faults())(data[1:]))


def _file_target(read_file: Callable[[Path], object], seeds: Callable[[], Sequence[bytes]],
                 tokens: tuple[bytes, ...]) -> Target:
    def read(data: bytes) -> bool:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / 'file'
            path.write_bytes(data)
            try:
                read_file(path)
            except ParameterError:
                return False
            return True
    return Target(seeds, read, tokens)


def _map_files() -> list[bytes]:
    """Return a YAML file, which names one image twice, and this image."""
    return [b'image: i.png\nsigma_image: i.png\nmode: raw\nresolution: 0.1\n'
            b'origin: [0.0, 1.0, 0.0]\nframe_id: map\n',
            png_bytes(np.arange(90, dtype=np.uint8).reshape(9, 10))]


def _map_image(lines: bytes) -> bytes:
    """Return this image with other ``lines``, of which each begins with a filter."""
    plain, data = _map_files()[1], zlib.compress(lines)
    chunk = struct.pack('>I', len(data)) + b'IDAT' + data
    begin, end = plain.index(b'IDAT') - 4, plain.index(b'IEND') - 4
    return plain[:begin] + chunk + struct.pack('>I', zlib.crc32(b'IDAT' + data)) + plain[end:]


def _read_map(path: Path) -> None:
    """Read a map whose YAML file is ``path``, or whose images are."""
    files, data = _map_files()[:2], path.read_bytes()
    files[data[1:4] == b'PNG'] = data
    text, image = files
    path.with_name('m.yaml').write_bytes(text)
    path.with_name('i.png').write_bytes(image)
    read_raster(path.with_name('m.yaml'))


def _parameter_files() -> list[bytes]:
    return [path.read_bytes() for path in sorted((ROOT / 'config').glob('*.yaml'))
            if path.name != 'rosbag2_qos.yaml']


def _read_parameters(path: Path) -> None:
    node = list(NODE_PARAMS)[path.stat().st_size % len(NODE_PARAMS)]
    load_node([path], node)


FILM = b"""\
film: {length_m: 0.03, width_m: 0.012, thickness_m: 2.8e-5, convention: exact}
products: {alpha_gain: {value: 200.0, sigma: 2.0, determined: true}, a_gain: {value: 3.0e-7,
  sigma: 1.0e-9, determined: true}, b_gain: {value: 2.0e-7, sigma: 1.0e-9, determined: true}}
covariance: [[4, 0, 0, 0, 0], [0, 1e-18, 0, 0, 0], [0, 0, 1e-18, 0, 0], [0, 0, 0, 1e-6, 0],
  [0, 0, 0, 0, 1e-22]]
amplifier: {low_corner: {value: 0.05, sigma: 0.001, determined: true}, drift: {value: 0.0,
  sigma: 1.0e-11, determined: true}}
span: 0.012
noise: 1.0e-10
model_error: 2.0e-10
notes: []
"""
PATH = b'x,y,yaw\n' + b''.join(b'%.2f,%.2f,0.1\n' % (0.1 * k, 0.01 * k * k) for k in range(9))
CSV = (','.join(COLUMNS) + '\n' + ''.join(
    f'{0.002 * k},{1e-4 * k},{2e-9 * k}\n' for k in range(40))).encode()


def _imu_target(name: str, seal: Callable[[bytes], bytes], delimited: bool = False) -> Target:
    return _receiver_target(
        lambda: SampleStream(IMU_PROTOCOLS[name]), seal, lambda: _frames(name), delimited)


def _frames(file: str) -> list[bytes]:
    return [frame.data for frame in frames(file).values()]


def _radio_frames() -> list[bytes]:
    return _frames('xbee') + [
        xbee.encode_frame(xbee.encode_receive_packet(xbee.ReceivePacket(ADDRESS, 0, 0, payload)))
        for payload in _frames('tire_payload')]


def _read_url(data: bytes) -> bool:
    """Open the port of a URL, on a machine that has no port, network or other file."""
    url = data.decode(errors='surrogateescape')
    absent = FileNotFoundError(2, 'no such file')
    with patch('os.open', side_effect=absent), patch('builtins.open', side_effect=absent), \
            patch('socket.create_connection', side_effect=absent), suppress(LinkError):
        open_port(port_url(url, '/robot'), 115200).close()
        return True
    return False


OUTPUTS: Mapping[type, tuple[str, ...]] = {  # node -> topics whose numbers must be finite
    SlipEstimatorNode: ('odom',), FrictionEstimatorNode: (), TrajectoryController: ('cmd_vel',),
    WheelController: ('motor_commands', 'wheel_commands')}


def _node_target(node_class: type) -> Target:
    """
    Return the target of a node that gets messages with changed fields among those of a drive.

    The bytes seed the changes.
    """
    def seeds() -> list[bytes]:
        drive()  # for all child processes
        return [bytes(range(32))]

    def read(data: bytes) -> bool:
        rng = Random(data)
        begin = rng.uniform(0.0, DRIVE_TIME - ATTACKED)
        with virtual(node_class) as node:
            for stamp_ns, topic, msg in drive():
                at = (stamp_ns - EPOCH_NS) / NS_PER_S
                if node.receives(topic) and begin <= at <= begin + ATTACKED:
                    node.run(max(at - node.elapsed_ns / NS_PER_S, 0.0))
                    if rng.random() < CHANGED:
                        node.publish(topic, changed_message(rng, msg))
                    node.publish(topic, msg)
            lines = '\n'.join(node.log.lines)
            assert 'please report' not in lines, lines
            for name in OUTPUTS[node_class]:
                for msg in node.received[name]:
                    assert all(math.isfinite(part_of(msg, place)) for place in places(msg)), msg
            return any(counter.ok for counter in node.inputs.values())
    return Target(seeds, read)


NODE_TARGETS: Mapping[str, Target] = {
    'node_slip': _node_target(SlipEstimatorNode),
    'node_friction': _node_target(FrictionEstimatorNode),
    'node_trajectory': _node_target(TrajectoryController),
    'node_wheels': _node_target(WheelController),
}

TARGETS: Mapping[str, Target] = {
    'tire_radio': _receiver_target(
        lambda: TireStream({ADDRESS: 'front_left'}), lambda body: xbee.encode_frame(
            body[:xbee.MAX_BODY_LENGTH] or b'\0'), _radio_frames, delimited=True),
    'vectornav_binary': _imu_target('vectornav_binary', vectornav.encode_frame),
    'vectornav_ascii': _imu_target(
        'vectornav_ascii', vectornav_ascii.encode_sentence, delimited=True),
    'xsens': _imu_target(
        'xsens', lambda body: xsens.encode_message(body[:1 + xsens.MAX_DATA_LENGTH] or b'\0')),
    'film_charge': _receiver_target(
        lambda: SampleStream(FILM_CHARGE), film_charge.encode_frame,
        lambda: _frames('film_charge'), delimited=False),
    'roboclaw_replies': Target(
        lambda: [roboclaw.encode_reply(0x80, roboclaw.READ_ENCODERS, 7, 8).ljust(23),
                 roboclaw.encode_text_reply(0x80, roboclaw.READ_VERSION, 'USB Roboclaw 2x15a')],
        _read_replies),
    'roboclaw_requests': Target(
        lambda: _frames('roboclaw'), _read_requests),
    'mcap': _bag_target('.mcap', _mcap_files),
    'db3': _bag_target('.db3', _databases),
    'metadata': Target(lambda: _in_folder(_metadata_files), _read_metadata, YAML_TOKENS),
    'messages': Target(_messages, _read_message),
    'parameters': _file_target(_read_parameters, _parameter_files, YAML_TOKENS),
    'film_params': _file_target(read_params, lambda: [FILM], YAML_TOKENS),
    'film_csv': _file_target(read_recording, lambda: [CSV], CSV_TOKENS),
    'path_csv': _file_target(read_path, lambda: [PATH], CSV_TOKENS),
    'friction_map': replace(
        _file_target(_read_map, _map_files, YAML_TOKENS), seal=_map_image,
        bodies=lambda: [(bytes([kind]) + b'0123456789') * 9 for kind in range(5)]),
    'urls': Target(lambda: [b'simulated:imu', b'/dev/ttyUSB0', b'loop://?logging=error',
                            b'socket://10.0.0.1:4000', b'rfc2217://10.0.0.1:2217?ign_set_control',
                            b'spy:///dev/ttyUSB0?file=log.txt&raw', b'hwgrep://0403:6001&n=1',
                            b'alt://loop://?class=PosixPollSerial'], _read_url, URL_TOKENS),
    **NODE_TARGETS,
}
