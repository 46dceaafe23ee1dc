# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameter files and bags of tests that run nodes as processes."""

from __future__ import annotations

from pathlib import Path

from smart_tire.bags import Bag
from smart_tire.errors import BagError
import yaml


def parameter_file(path: Path, nodes) -> Path:
    """Write a ROS parameter file for ``nodes`` (name -> parameters) and return it."""
    path.write_text(yaml.safe_dump({name: {'ros__parameters': values}
                                    for name, values in nodes.items()}), encoding='utf-8')
    return path


def children(process: int) -> dict[str, int]:
    """Return the process id of each node that a process has started, by its module."""
    found = {}
    for path in Path('/proc').glob('[0-9]*'):
        try:
            parent = int((path / 'stat').read_text().rsplit(')', 1)[1].split()[1])
            words = (path / 'cmdline').read_text().split('\0')
        except OSError:
            continue
        if parent == process and '-m' in words:
            found[words[words.index('-m') + 1].rpartition('.')[2]] = int(path.name)
    return found


def count(bag: Path, topic: str) -> int:
    """Return the number of messages of ``topic`` in a bag, which may still be being written."""
    try:
        with Bag(bag) as reader:
            found = reader.topics.get(f'/{topic}')
            return 0 if found is None else found.messages
    except BagError:  # does not exist yet, or has no content yet
        return 0
