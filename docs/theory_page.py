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
Numbers in ``docs/theory.md`` that are constants or default parameters of the package.

``theory_numbers.yaml`` has the words around each number. Run this after a change of a constant: it
writes the numbers; a test checks that they are current.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
import re

import yaml

DOCUMENT = Path(__file__).with_name('theory.md')
NUMBERS = Path(__file__).with_name('theory_numbers.yaml')
PLACE = '#'  # of a number, in the words around it
NUMBER = re.compile(r'[\d.]*\d')
CONSTANT = re.compile(r'([\w.]+)\.(\w+)(?:\[(\d)\])?(?: \* ([\d.e-]+))?')


def value_of(constant: str) -> float:
    """Return the value of ``module.NAME``, ``NAME[index]`` of a tuple, with ``* factor`` after."""
    module, name, index, factor = CONSTANT.fullmatch(constant).groups()
    found: object
    try:
        found = import_module(f'smart_tire.{module}')
    except ModuleNotFoundError:  # a parameter, of a class
        path, _, class_name = module.rpartition('.')
        found = getattr(import_module(f'smart_tire.{path}'), class_name)
    found = getattr(found, name)
    return float(found[int(index)] if index else found) * float(factor or 1.0)


def written(text: str, numbers: dict[str, str | Sequence[str]]) -> str:
    """
    Return ``text`` with the present values of ``numbers``: words -> constants.

    A value is rounded to the decimal places of the number that it replaces, unless that would
    make it zero. Raises ValueError if the words are not in the text.
    """
    for words, constants in numbers.items():
        names = [constants] if isinstance(constants, str) else constants
        values = list(map(value_of, names))
        # any white space between words, since lines are wrapped
        pattern = r'\s+'.join(map(re.escape, words.split())).replace(
            re.escape(PLACE), rf'({NUMBER.pattern})')
        text, count = re.subn(pattern, partial(_replaced, values), text)
        if not count:
            raise ValueError(f'theory.md has no "{words}"')
    return text


def _replaced(values: Sequence[float], found: re.Match[str]) -> str:
    whole, begin, parts, end = found[0], found.start(), [], 0
    for group, value in enumerate(values, 1):
        first, last = (place - begin for place in found.span(group))
        places = len(whole[first:last].partition('.')[2])
        rounded = f'{value:.{places}f}' if round(value, places) else f'{value:g}'
        parts += [whole[end:first], rounded]
        end = last
    return ''.join((*parts, whole[end:]))


def current(text: str) -> str:
    """Return the text of ``theory.md`` with all numbers as they are in the package."""
    return written(text, yaml.safe_load(NUMBERS.read_text(encoding='utf-8')))


if __name__ == '__main__':
    DOCUMENT.write_text(current(DOCUMENT.read_text(encoding='utf-8')), encoding='utf-8')
