# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""YAML from outside: the values of each notation, and what is refused by each of its readers."""

from __future__ import annotations

import json
from math import inf, isnan
from pathlib import Path

import pytest
from smart_tire.bags.metadata import Metadata, metadata_in
from smart_tire.cli.main import main
from smart_tire.errors import (
    BagError, MAX_REASON, MAX_TEXT, MessageError, ParameterError, printable)
from smart_tire.estimation.film.calibration import read_params
from smart_tire.parameters import load_robot
from smart_tire.yaml_text import MAX_DEPTH, MAX_SIZE, parse_yaml
from support.yaml_attacks import ATTACKS
import yaml

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize('name', ATTACKS)
def test_a_parameter_file_that_attacks_is_refused_in_one_line_with_its_name(
        name, tmp_path, capsys):
    path, bag = tmp_path / 'robot.yaml', tmp_path / 'bag' / 'bag_0.mcap'
    path.write_bytes(ATTACKS[name])
    bag.parent.mkdir()
    bag.touch()
    words = ['analyze', str(bag.parent), '--params', str(path), '--out', str(tmp_path / 'out')]
    assert main(words) == 2
    printed = capsys.readouterr().err
    assert printed.startswith(f'smart_tire analyze: {path}: ')
    assert printed.endswith('\n')
    assert printed[:-1].isprintable()
    assert len(printed) < 2 * MAX_TEXT
    with pytest.raises(ParameterError):
        load_robot([path])


@pytest.mark.parametrize('name', ATTACKS)
def test_text_that_attacks_is_refused_by_other_readers_or_harmless(name, tmp_path):
    data = ATTACKS[name]
    (tmp_path / 'film.yaml').write_bytes(data)
    with pytest.raises(ParameterError, match='film.yaml: '):
        read_params(tmp_path / 'film.yaml')
    assert metadata_in(data.decode('utf-8', 'replace')) == Metadata()


@pytest.mark.parametrize(('text', 'value'), [
    ('', None), ('a', 'a'), ('~', None), ('null', None), ('Null', None), ('"null"', 'null'),
    ('true', True), ('Yes', True), ('ON', True), ('off', False), ('no', False), ("'no'", 'no'),
    ('0', 0), ('-12', -12), ('+7', 7), ('007', 7), ('0x1F', 31), ('0o17', 15), ('"7"', '7'),
    ('1_000', '1_000'), ('1e-3', 0.001), ('1E3', 1000.0), ('.5', 0.5), ('5.', 5.0),
    ('-1.5e+2', -150.0), ('.inf', inf), ('-.INF', -inf), ('1e999', inf), ('.', '.'), ('-', [None]),
    ('12:30:00', '12:30:00'), ('2001-01-31', '2001-01-31'), ('9' * 100, 10**100 - 1),
    ('9' * 101, '9' * 101), ('|\n a\n b\n', 'a\nb\n'), ('"\\e"', '\x1b'), ('=', '='),
    ('[1, a, [2.0, ]]', [1, 'a', [2.0]]), ('{a: 1, b: {c: [x]}}', {'a': 1, 'b': {'c': ['x']}}),
    ('{2: a, true: b, ~: c}', {2: 'a', True: 'b', None: 'c'}),
    ('{<<: {a: 1}}', {'<<': {'a': 1}}), ('&x a', 'a'), ('- a\n- b: c\n', ['a', {'b': 'c'}]),
    ('[! 7, ! "7", !<!> 7, ! [7]]', ['7', '7', '7', [7]]),
    (b'\xef\xbb\xbfa: \xc3\xa4', {'a': 'ä'}), ('{a, b: }', {'a': None, 'b': None})])
def test_each_notation_has_this_value(text, value):
    assert repr(parse_yaml(text)) == repr(value)


def test_equal_keys_of_different_mappings_and_values_like_keys_are_read():
    tree = {'a': {'a': 'a', 'b': ['a', 'a']}, 'b': [{'a': 1}, {'a': 2}]}
    assert parse_yaml('a: {a: a, b: [a, a]}\nb: [{a: 1}, {a: 2}]') == tree


def test_not_a_number_is_read():
    assert isnan(parse_yaml('.NaN'))


@pytest.mark.parametrize('path', sorted((ROOT / 'config').rglob('*.yaml')), ids=str)
def test_files_of_the_package_have_the_values_of_yaml_1_1(path):
    data = path.read_bytes()
    assert repr(parse_yaml(data)) == repr(yaml.safe_load(data))  # NaN differs from NaN


def test_json_is_yaml():
    tree = {'a': [1, 2.5, -1e-9, None, True], 'b': {'c': 'ä "quoted" \\ \n'}, 'd': [[], {}]}
    assert parse_yaml(json.dumps(tree)) == tree


def test_the_bounds_of_depth_and_size_are_exact():
    nested = '[' * MAX_DEPTH + ']' * MAX_DEPTH
    assert str(parse_yaml(nested)) == nested
    assert parse_yaml(f'[{nested[2:-2]}, {nested[2:-2]}]') is not None
    with pytest.raises(ValueError, match=f'^line 1: more than {MAX_DEPTH} nested levels$'):
        parse_yaml(f'[{nested}]')
    text = 'a'.ljust(MAX_SIZE)
    assert parse_yaml(text) == 'a'
    with pytest.raises(ValueError, match=f'^{MAX_SIZE + 1} bytes, expected at most {MAX_SIZE}$'):
        parse_yaml(text + ' ')


@pytest.mark.parametrize(('text', 'reason'), [
    ('a:\n- *b', 'line 2: aliases and tags are not read'),
    ('\n!!str a', 'line 2: aliases and tags are not read'),
    ('!a a', 'line 1: aliases and tags are not read'),
    ('!!map {}', 'line 1: aliases and tags are not read'),
    ('a: 1\n? [b]\n: 2', 'a list or mapping is a key'),
    # the first value would be lost in silence: two blocks for one node, a value that was pasted
    ('a: 1\nb: 2\na: 3', 'line 3: a is there twice, first in line 1'),
    ('x:\n  a: {b: [1, c]}\n  "a": 1', 'line 3: a is there twice, first in line 2'),
    ('{0x10: a, 16: b}', 'line 1: 16 is there twice, first in line 1'),
    ('a\n---\nb\n---\nc', '3 documents, expected one'),
    ('a: [\nb: c', 'line 3: did not find expected'), ('\x01', 'unacceptable character'),
    (b'\xff', "'utf-8' codec can't decode byte 0xff in position 0")])
def test_the_reason_of_a_refusal_has_its_line(text, reason):
    with pytest.raises(ValueError) as raised:
        parse_yaml(text)
    assert str(raised.value).startswith(reason)
    assert '\n' not in str(raised.value)


@pytest.mark.parametrize(('text', 'line'), [
    ('', ''), ('ä  b', 'ä  b'), ('  a\n b\r\nc\u2028d', '  a  b c d'),
    ('\x1b[2J\a', '\\x1b[2J\\x07'),
    ('\ud800\u202e', '\\ud800\\u202e'), ('x' * MAX_TEXT, 'x' * MAX_TEXT),
    ('x' * 300 + 'y' * 300, f'{"x" * 247} ... {"y" * 247}'),
    ('\a' * 500, f'{"BELL" * 61}\\x0 ... x07{"BELL" * 61}'.replace('BELL', '\\x07'))])
def test_texts_of_others_are_shown_in_one_line_without_control_characters(text, line):
    assert printable(text) == str(ParameterError(text)) == str(BagError(text)) == line
    assert len(str(MessageError(text))) <= MAX_REASON
    assert str(MessageError(text)).isprintable()
