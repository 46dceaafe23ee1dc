# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""All deframers: any split, corrupt neighbors, bounded memory and correct counters."""

from binascii import crc_hqx
from collections import Counter
from itertools import accumulate
import math

from hypothesis import assume, given, settings, strategies as st
import pytest
from smart_tire.protocol import film_charge, vectornav, vectornav_ascii, xbee, xsens
from smart_tire.protocol.deframer import HeaderDeframer
from support.frames import each_frame, frames

ASCII = st.text('ABCVNYMR0123456789.,+-', max_size=60).map(str.encode)

FILM_BODIES = st.binary(min_size=9, max_size=9).map(bytes((film_charge.KIND,)).__add__)


class Protocol:
    """A deframer, its encoder, a strategy for bodies, and the file with its frames."""

    def __init__(self, file, deframer, encode, bodies, start, limit):
        self.deframer, self.encode, self.bodies = deframer, encode, bodies
        self.start, self.limit = start, limit  # start byte, bytes that may stay in the buffer
        self.frames = [frame.data for frame in frames(file).values()
                       if not {'misprint', 'number', 'check'} & frame.values.keys()]

    def __repr__(self):
        return self.deframer.__name__


def vectornav_body(payload):
    """Return a body with rate (12), acceleration (12) and time (8), filled from ``payload``."""
    return b'\x01\x21\x01' + (payload + bytes(32))[:32]


PROTOCOLS = [
    Protocol('xbee', xbee.XBeeDeframer, xbee.encode_frame, st.binary(min_size=1, max_size=300),
             b'\x7e', 2 * xbee.MAX_BODY_LENGTH + 10),
    Protocol('vectornav_binary', vectornav.BinaryDeframer, vectornav.encode_frame,
             st.binary(max_size=32).map(vectornav_body), b'\xfa', 1500),
    Protocol('vectornav_ascii', vectornav_ascii.AsciiDeframer, vectornav_ascii.encode_sentence,
             ASCII, b'$', vectornav_ascii.MAX_SENTENCE_LENGTH),
    Protocol('xsens', xsens.XsensDeframer, xsens.encode_message,
             st.binary(min_size=1, max_size=300), b'\xfa', xsens.MAX_DATA_LENGTH + 8),
    Protocol('film_charge', film_charge.FilmDeframer, film_charge.encode_frame, FILM_BODIES,
             b'\xa5', film_charge.SIZE),
]
SIZED = {  # deframers whose frames have a size by their header -> a body
    vectornav.BinaryDeframer: vectornav_body(b''),
    film_charge.FilmDeframer: bytes((film_charge.KIND, *range(9)))}
each_protocol = pytest.mark.parametrize('protocol', PROTOCOLS, ids=repr)
few_examples = settings(max_examples=60, deadline=None, derandomize=True)


def with_changed_byte(frame, index, flip):
    """Return ``frame`` with one byte changed."""
    changed = bytearray(frame)
    changed[index % len(frame)] ^= flip
    return bytes(changed)


@each_protocol
def test_documented_frames_are_reproduced_and_survive_any_split(protocol):
    stream = b''.join(protocol.frames)
    expected = list(protocol.deframer().extract(stream))
    assert list(map(protocol.encode, expected)) == protocol.frames
    for cut in range(len(stream) + 1):
        deframer = protocol.deframer()
        assert [*deframer.extract(stream[:cut]), *deframer.extract(stream[cut:])] == expected
        assert (deframer.bad_frames, deframer.skipped_bytes) == (0, 0)


@each_protocol
def test_the_frame_behind_a_documented_frame_with_a_changed_byte_is_found(protocol):
    for frame in protocol.frames:
        (body,) = protocol.deframer().extract(frame)
        for index in range(len(frame)):
            stream = with_changed_byte(frame, index, 0x08) + frame
            assert list(protocol.deframer().extract(stream))[-1:] == [body]


@each_protocol
@few_examples
@given(data=st.data())
def test_a_body_is_yielded_with_the_last_byte_of_its_frame_whatever_the_split(protocol, data):
    bodies = data.draw(st.lists(protocol.bodies, min_size=1, max_size=5))
    frames = list(map(protocol.encode, bodies))
    stream, ends = b''.join(frames), list(accumulate(map(len, frames)))
    cuts = {*data.draw(st.lists(st.integers(0, len(stream)), max_size=12)), ends[0] - 1, *ends}
    deframer, found, start = protocol.deframer(), [], 0
    for cut in sorted(cuts):
        found += deframer.extract(stream[start:cut])
        assert found == bodies[:sum(end <= cut for end in ends)]
        start = cut
    assert (deframer.bad_frames, deframer.skipped_bytes) == (0, 0)


@each_protocol
@few_examples
@given(data=st.data())
def test_no_intact_frame_next_to_a_corrupt_one_is_lost(protocol, data):
    """One byte is changed, or the end or a middle part of the frame is missing."""
    bodies = data.draw(st.lists(protocol.bodies, min_size=3, max_size=3))
    before, damaged, after = map(protocol.encode, bodies)
    index = data.draw(st.integers(0, len(damaged) - 1))
    corrupt = data.draw(st.sampled_from([
        with_changed_byte(damaged, index, data.draw(st.integers(1, 255))), damaged[:index],
        damaged[:index // 2] + damaged[index:]]))
    size = data.draw(st.integers(1, 40))
    stream = before + corrupt + after + protocol.encode(bodies[0])
    deframer, found = protocol.deframer(), []
    for start in range(0, len(stream), size):
        found += deframer.extract(stream[start:start + size])
    assert found[0] == bodies[0]
    assert found[-2:] == [bodies[2], bodies[0]]
    assert len(found) <= 4


@each_protocol
@few_examples
@given(data=st.data())
def test_noise_between_frames_is_skipped_and_counted(protocol, data):
    body = data.draw(protocol.bodies)
    noise = data.draw(st.binary(max_size=80)).replace(protocol.start, b'')
    noise = noise.replace(b'\x7d', b'')
    deframer = protocol.deframer()
    frame = protocol.encode(body)
    assert list(deframer.extract(noise + frame + noise + frame)) == [body, body]
    assert deframer.skipped_bytes == 2 * len(noise)
    assert deframer.bad_frames == 0


@each_protocol
@few_examples
@given(data=st.data())
def test_a_corrupt_frame_is_counted_once(protocol, data):
    body = data.draw(protocol.bodies)
    frame = bytearray(protocol.encode(body))
    frame[-3 if protocol.deframer is vectornav_ascii.AsciiDeframer else -1] ^= 0x01
    assume(protocol.start not in bytes(frame[1:]))  # it may start another candidate
    deframer = protocol.deframer()
    good = protocol.encode(body)
    assert list(deframer.extract(good + bytes(frame) + good)) == [body, body]
    assert deframer.bad_frames == 1
    assert deframer.skipped_bytes == len(frame)


@each_protocol
@settings(max_examples=30, deadline=None, derandomize=True)
@given(chunks=st.lists(st.binary(max_size=400), max_size=30))
def test_noise_does_not_fill_the_buffer(protocol, chunks):
    deframer, fed = protocol.deframer(), 0
    for chunk in chunks:
        fed += len(chunk) + 1
        assert list(deframer.extract(chunk + protocol.start)) == []
        assert fed - deframer.skipped_bytes <= protocol.limit


@each_protocol
def test_a_frame_behind_many_start_bytes_is_found(protocol):
    deframer = protocol.deframer()
    assert list(deframer.extract(protocol.start * 3000)) == []
    body = SIZED.get(protocol.deframer, b'ABC')
    assert list(deframer.extract(protocol.encode(body))) == [body]


@pytest.mark.parametrize('protocol, header, counted', [
    (PROTOCOLS[0], '7e ffff', True), (PROTOCOLS[0], '7e 01ff', False),
    (PROTOCOLS[1], 'fa 7f' + 7 * 'ff07', False), (PROTOCOLS[1], 'fa 01 ff7f', False),
    (PROTOCOLS[1], 'fa 01 ffff', True), (PROTOCOLS[2], '24 56 4e 59', False),
    (PROTOCOLS[3], 'fa ff 36 fe', False), (PROTOCOLS[3], 'fa ff 36 ff 0800', False),
    (PROTOCOLS[3], 'fa ff 36 ff ffff', True)])
def test_a_corrupt_length_does_not_delay_the_next_frame(protocol, header, counted):
    """An impossible one is counted at once."""
    body = vectornav_body(b'') if protocol is PROTOCOLS[1] else b'ABC'
    deframer = protocol.deframer()
    assert list(deframer.extract(bytes.fromhex(header))) == []
    assert deframer.bad_frames == counted
    assert list(deframer.extract(protocol.encode(body))) == [body]
    assert deframer.bad_frames == 1
    assert deframer.skipped_bytes == len(bytes.fromhex(header))


def test_a_corrupt_frame_that_contains_another_is_counted_once():
    inner = bytes.fromhex('fa ff 36 00 00')  # its checksum is wrong
    outer = xsens.encode_message(b'\x36' + inner + bytes(4))
    deframer = xsens.XsensDeframer()
    assert list(deframer.extract(with_changed_byte(outer, -1, 0x01))) == []
    assert deframer.bad_frames == 1


@pytest.mark.parametrize('protocol, header', [
    (PROTOCOLS[1], 'fa 01 ffff'), (PROTOCOLS[1], 'fa 01 0080'), (PROTOCOLS[3], 'fa ff 36 ffffff'),
    (PROTOCOLS[3], 'fa ff 36 00 00')])
def test_an_invalid_header_inside_an_incomplete_frame_is_data(protocol, header):
    data = bytes.fromhex(header)
    body = vectornav_body(data) if protocol is PROTOCOLS[1] else b'\x36' + data + bytes(20)
    frame, deframer = protocol.encode(body), protocol.deframer()
    assert list(deframer.extract(frame[:-4])) == []
    assert list(deframer.extract(frame[-4:])) == [body]
    assert (deframer.bad_frames, deframer.skipped_bytes) == (0, 0)


@each_protocol
def test_bodies_that_were_not_consumed_are_yielded_by_the_next_feed(protocol):
    body = SIZED.get(protocol.deframer, b'ABC')
    deframer = protocol.deframer()
    deframer.extract(protocol.encode(body))
    assert list(deframer.extract(b'')) == [body]


@each_frame('crc16')
def test_the_crc_of_a_published_message_is_the_published_one(frame):
    assert crc_hqx(frame.data[:-2], 0) == frame['crc']


HOSTILE = [
    b'\xfa\xff\x36\xff\x08\x00',              # Xsens: every sixth byte claims 2048 bytes of data
    b'\xfa', b'\xfa\xff', b'\xfa\xff\x36\xfe', b'\xfa\x01\xff\x1f', b'\xfa' + 15 * b'\x7f',
    b'\x7e', b'\x7e\x02\x00' + 512 * b'\x7d\x5d', b'\x7e\x7d\x22\x00' + 1100 * b'\x7d',  # XBee
    b'$', b'$VNIMU,', b'*']


@each_protocol
@pytest.mark.parametrize('pattern', HOSTILE, ids=lambda pattern: pattern[:6].hex())
def test_the_work_per_byte_is_bounded(protocol, pattern, monkeypatch):
    stream, work = pattern * (6000 // len(pattern)), Counter()

    def count(owner, name, kind, size):
        work_of = getattr(owner, name)
        monkeypatch.setattr(owner, name, lambda *args: (
            work.update({kind: size(args[-1])}) or work_of(*args)))

    if issubclass(protocol.deframer, HeaderDeframer):
        count(protocol.deframer, '_size', 'headers', lambda start: 1)
        count(protocol.deframer, '_body', 'checksums', len)
    elif protocol.deframer is xbee.XBeeDeframer:
        count(xbee, 'unescape', 'escapes', len)
    deframer = protocol.deframer()
    for byte in stream:
        list(deframer.extract(bytes((byte,))))
    assert work['headers'] <= 20 * len(stream)  # again with each byte of the header
    # each time that at least half of the missing bytes have arrived
    assert work['escapes'] <= math.log2(2 * protocol.limit) * len(stream)
    assert work['checksums'] <= 0.5 * protocol.limit * len(stream)  # of every second byte
