# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Byte frames of the devices, read from test/data/frames with the values that they carry."""

from __future__ import annotations

import ast
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).resolve().parents[1] / 'data' / 'frames'


@dataclass
class Frame:
    """One frame of a file in test/data/frames; see the README there."""

    name: str
    header: dict[str, str] = field(default_factory=dict)   # origin, device, source, computed
    values: dict[str, Any] = field(default_factory=dict)   # expected values
    data: bytes = b''                                      # as on the wire

    def __getitem__(self, key: str) -> Any:
        """Return the expected value ``key``."""
        return self.values[key]

    def __str__(self) -> str:
        return self.name


def frames(file: str) -> dict[str, Frame]:
    """Return name -> frame of test/data/frames/``file``.txt."""
    found: dict[str, Frame] = {}
    for line in (FOLDER / f'{file}.txt').read_text(encoding='utf-8').splitlines():
        text = line.strip()
        if text.startswith('['):
            frame = Frame(text.strip('[]'))
            if frame.name in found:
                raise ValueError(f'{file}.txt has two frames {frame.name}')
            found[frame.name] = frame
        elif text.startswith('"'):
            frame.data += ast.literal_eval('b' + text.rpartition('"')[0] + '"')
        elif text and not text.startswith('#'):
            key, colon, value = text.partition(': ')
            if key == 'values':
                frame.values |= _literals(value)
            elif colon and ' ' not in key:
                frame.header[key] = value
            else:
                frame.data += bytes.fromhex(text.partition('#')[0])
    return found


def each_frame(file: str, *keys: str) -> pytest.MarkDecorator:
    """Return the parametrization of ``frame`` by the frames of ``file`` that have all ``keys``."""
    chosen = [frame for frame in frames(file).values() if frame.values.keys() >= set(keys)]
    if not chosen:
        raise ValueError(f'{file}.txt has no frame with values {keys}')
    return pytest.mark.parametrize('frame', chosen, ids=str)


def _literals(text: str) -> dict[str, Any]:
    call = ast.parse(f'dict({text})', mode='eval').body
    assert isinstance(call, ast.Call)
    return {str(keyword.arg): ast.literal_eval(keyword.value) for keyword in call.keywords}
