# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""MCAP files have the bytes of the library's writer."""

from __future__ import annotations

from io import BytesIO
import random

from mcap.writer import Writer
import pytest
from smart_tire.bags import mcap_writer
from smart_tire.bags.mcap_writer import McapWriter

CHUNK_SIZE = 2000  # bytes


def written(steps):
    """Return the files that the library and our writer make of ``steps``, and their sizes then."""
    theirs, ours = BytesIO(), BytesIO()
    library, writer = Writer(theirs, chunk_size=CHUNK_SIZE), McapWriter(ours, 'ros2', 'smart_tire')
    library.start('ros2', 'smart_tire')
    sizes = []
    for kind, *values in steps:
        if kind == 'topic':
            name, text = values
            number = library.register_schema(name, 'ros2msg', text)
            assert writer.add_schema(name, 'ros2msg', text) == number
            metadata = {'offered_qos_profiles': '', 'topic_type_hash': name}
            channel = library.register_channel(f'/{name}', 'cdr', number, metadata)
            assert writer.add_channel(f'/{name}', 'cdr', number, metadata) == channel
        elif kind == 'message':
            channel, time_ns, data = values
            library.add_message(channel, time_ns, data, time_ns)
            writer.add_message(channel, time_ns, data)
        elif kind == 'metadata':
            for one in (library, writer):
                one.add_metadata('rosbag2', {'text': values[0], 'ä': ''})
        else:
            library.flush()
            writer.flush()
        sizes.append((len(theirs.getvalue()), len(ours.getvalue())))
    library.finish()
    writer.finish()
    return theirs.getvalue(), ours.getvalue(), sizes


@pytest.mark.parametrize('seed', range(20))
def test_the_file_is_that_of_the_library_after_each_step(seed, monkeypatch):
    monkeypatch.setattr(mcap_writer, 'CHUNK_SIZE', CHUNK_SIZE)
    rng, steps, channels = random.Random(seed), [], 0
    for step in range(rng.choice((3, 300))):
        kind = rng.choices(('topic', 'message', 'metadata', 'flush'), (1, 30, 1, 1))[0]
        if kind == 'topic' or not channels:
            channels += 1
            steps.append(('topic', f'type_{channels}', rng.randbytes(rng.randrange(1500))))
        elif kind == 'message':
            steps.append((kind, rng.randint(1, channels), 10**18 + rng.randrange(10**12),
                          rng.randbytes(rng.choice((0, 40, 900)))))
        else:
            steps.append((kind, f'{step}'))
    theirs, ours, sizes = written(steps)
    assert ours == theirs
    assert all(mine == other for mine, other in sizes)


def test_an_empty_file_is_that_of_the_library():
    theirs, ours, _ = written([])
    assert ours == theirs
