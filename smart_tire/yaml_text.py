# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
YAML from outside: what ROS and YAML 1.2 have in common, in bounds.

Of the rest, which parameter files and bags do not need, aliases may multiply to more than any
memory has, and tags call constructors; rcl reads neither.
"""

from __future__ import annotations

from collections.abc import Iterable
import math
import re
from typing import Any

import yaml

MAX_SIZE = 1_000_000  # bytes: metadata of 4000 files of a bag
MAX_DEPTH = 50        # of nested collections
MAX_NUMBER = 100      # characters of a number; a longer one is a text
BASE: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)  # compiled, 10 times as fast
INTEGERS = {10: re.compile('[-+]?[0-9]+'), 16: re.compile('0x[0-9a-fA-F]+'),
            8: re.compile('0o[0-7]+')}  # by base
NUMBER_STARTS = '+-.0123456789'
FLOAT = re.compile(r'[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?')
WORDS: dict[str, Any] = {
    spelled: value for value, words in (
        (None, ('', '~', 'null')), (True, ('true', 'yes', 'on')), (False, ('false', 'no', 'off')),
        (math.inf, ('.inf', '+.inf')), (-math.inf, ('-.inf',)), (math.nan, ('.nan', '.NaN')))
    for word in words for spelled in (word, word.title(), word.upper())}


def load_own(text: str) -> Any:
    """Return the value of a YAML text of this package, which needs no checks."""
    return yaml.load(text, BASE)


def parse_yaml(data: bytes | str) -> Any:
    """
    Return the value of a YAML text: nested dict and list of str, float, int, bool and None.

    Dates and merge keys are texts. Raises ValueError with the reason in one line if ``data`` are
    no YAML in UTF-8, or have aliases, tags, several documents, collections as keys, a key twice,
    or more than ``MAX_SIZE`` and ``MAX_DEPTH``.
    """
    if len(data) > MAX_SIZE:
        raise ValueError(f'{len(data)} bytes, expected at most {MAX_SIZE}')
    text = data if isinstance(data, str) else data.decode('utf-8-sig')
    try:
        return _value(yaml.parse(text, BASE))
    except yaml.YAMLError as error:
        mark, problem = getattr(error, 'problem_mark', None), getattr(error, 'problem', None)
        raise ValueError(problem and mark and _at(mark, problem)
                         or str(error).splitlines()[0]) from error


def _value(events: Iterable[Any]) -> Any:
    """Return the value that the events of a YAML parser describe."""
    documents: list[Any] = []
    stack = [documents]  # of the items of nested collections, keys and values alternately
    marks = [list[yaml.Mark]()]  # where these items begin
    for event in events:
        if isinstance(event, yaml.NodeEvent):
            if isinstance(event, yaml.AliasEvent) or event.tag not in (None, '!'):
                raise ValueError(_at(event.start_mark, 'aliases and tags are not read'))
            marks[-1].append(event.start_mark)
            if isinstance(event, yaml.ScalarEvent):
                # yaml-cpp marks some texts with !
                plain = event.implicit[0] and event.tag is None
                stack[-1].append(_scalar(event.value) if plain else event.value)
                continue
            stack.append([])
            marks.append([])
            if len(stack) > MAX_DEPTH + 1:
                raise ValueError(_at(event.start_mark, f'more than {MAX_DEPTH} nested levels'))
        elif isinstance(event, yaml.SequenceEndEvent):
            marks.pop()
            stack[-2].append(stack.pop())
        elif isinstance(event, yaml.MappingEndEvent):
            items = stack.pop()
            stack[-1].append(_mapping(items[::2], items[1::2], marks.pop()[::2]))
    if len(documents) > 1:
        raise ValueError(f'{len(documents)} documents, expected one')
    return documents[0] if documents else None


def _mapping(keys: Iterable[Any], values: Iterable[Any], marks: Iterable[yaml.Mark]
             ) -> dict[Any, Any]:
    """Return a mapping; raise ValueError if a key is a collection, or if a value would be lost."""
    found: dict[Any, Any] = {}
    lines: dict[Any, int] = {}
    for key, value, mark in zip(keys, values, marks):
        if isinstance(key, (list, dict)):
            raise ValueError('a list or mapping is a key')
        if key in found:
            raise ValueError(_at(mark, f'{key} is there twice, first in line {lines[key]}'))
        found[key], lines[key] = value, mark.line + 1
    return found


def _scalar(text: str) -> Any:
    """Return the value of a scalar without quotes."""
    if text in WORDS:
        return WORDS[text]
    if len(text) <= MAX_NUMBER and text[0] in NUMBER_STARTS:
        for base, pattern in INTEGERS.items():
            if pattern.fullmatch(text):
                return int(text, base)
        if FLOAT.fullmatch(text):
            return float(text)
    return text


def _at(mark: yaml.Mark, problem: str) -> str:
    return f'line {mark.line + 1}: {problem}'
