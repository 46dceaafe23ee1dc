# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Fuzz test: inputs that failed before, a few new ones, and each kind of fault is found."""

from __future__ import annotations

import inspect
from itertools import count, islice
import os
import signal
import sys
from types import ModuleType, SimpleNamespace

import fuzz
import pytest
from support.fuzz_targets import NODE_TARGETS, TARGETS

pytestmark = [pytest.mark.slow, pytest.mark.processes]

SECONDS = 600.0  # reached by failures only


def source(inputs):
    """Return a function that yields the rest of ``inputs`` from a number on."""
    return lambda first: islice(inputs, first, None)


@pytest.mark.parametrize('name', [name for name in TARGETS if name not in NODE_TARGETS])
@pytest.mark.parametrize('new', [20, pytest.param(200, marks=pytest.mark.long)])
def test_inputs_that_once_failed_and_changed_ones_are_read_unchanged_ones_accepted(name, new):
    seeds, target = list(TARGETS[name].seeds()), TARGETS[name]
    given = [*fuzz.kept(name), *seeds, *islice(fuzz.inputs(target, name, 1), new)]
    result = fuzz.run(target.read, source(given), SECONDS)
    assert not result.failures
    assert result.inputs == len(given)
    assert fuzz.run(target.read, source(seeds), SECONDS).accepted > 0


@pytest.mark.parametrize('name', NODE_TARGETS)
@pytest.mark.parametrize('new', [1, pytest.param(20, marks=pytest.mark.long)])
def test_nodes_read_inputs_that_once_failed_and_changed_ones(name, new, isolated_ros):
    """In this process: a fork of one that has used DDS hangs."""
    target = TARGETS[name]
    for data in [*fuzz.kept(name), *islice(fuzz.inputs(target, name, 1), new)]:
        assert target.read(data)


def test_the_lines_of_functions_that_inputs_run_are_counted_by_room(tmp_path, monkeypatch):
    replaced = ModuleType('replaced')  # by a namespace package
    monkeypatch.setattr(replaced, '__file__', None, raising=False)
    monkeypatch.setitem(sys.modules, 'replaced', replaced)
    monkeypatch.setitem(vars(inspect)['_filesbymodname'], 'replaced', 'earlier.py')
    target = TARGETS['xsens']
    fuzz.run(target.read, source(list(target.seeds()) * 20), SECONDS, lines=tmp_path)
    shares = fuzz.shares(tmp_path)
    done, total = shares['protocol']
    assert 0.1 * total < done < 0.5 * total
    assert shares['bags'][0] == 0 < shares['bags'][1]


def fails(data):
    """Fail in the way that ``data`` names; accept anything else."""
    if data == b'raise':
        raise KeyError('a fault')
    if data == b'recurse':
        fails(data)
    if data == b'kill':
        os.kill(os.getpid(), signal.SIGKILL)
    if data == b'exit':
        os._exit(3)
    if data == b'allocate':
        return bool(bytearray(2 * fuzz.MAX_MEMORY))
    while data == b'loop':
        pass
    return data == b'accepted'


@pytest.mark.parametrize(('how', 'cause'), [
    (b'raise', "KeyError: 'a fault'"), (b'recurse', 'RecursionError'), (b'kill', 'SIGKILL'),
    (b'exit', 'exit status 3'), (b'allocate', 'MemoryError'), (b'loop', 's of CPU time')])
def test_each_kind_of_fault_is_found_and_the_rest_is_read(monkeypatch, how, cause):
    monkeypatch.setattr(fuzz, 'MAX_CPU', 0.2)
    given = [b'accepted', b'refused', how, b'accepted', b'accepted']
    result = fuzz.run(fails, source(given), SECONDS)
    (data, found), = result.failures
    assert data == how
    assert cause in found
    assert (result.inputs, result.accepted) == (5, 3)


def test_a_reader_that_always_fails_ends_early():
    result = fuzz.run(fails, source([b'exit'] * 100), SECONDS)
    assert len(result.failures) == result.inputs == fuzz.MAX_FAILURES


@pytest.fixture
def clock(monkeypatch):
    """Let the fuzz test find one second more whenever it looks at the time."""
    seconds = count()
    monkeypatch.setattr(fuzz, 'time', SimpleNamespace(monotonic=lambda: next(seconds), time=int))


@pytest.mark.usefixtures('clock')
def test_the_time_and_the_number_of_inputs_are_limits():
    assert fuzz.run(fails, lambda first: iter(lambda: b'', None), 50.0).inputs == 50
    assert fuzz.run(fails, source([b''] * 100), SECONDS, 7).inputs == 7


def test_inputs_are_reproducible_from_any_number_on():
    target = TARGETS['xsens']
    first = list(islice(fuzz.inputs(target, 'xsens', 1), 20))
    assert first[5:] == list(islice(fuzz.inputs(target, 'xsens', 1, 5), 15))
    assert first != list(islice(fuzz.inputs(target, 'xsens', 2), 20))
    assert len(set(first)) == 20


@pytest.mark.usefixtures('clock')
def test_a_failure_is_kept_and_the_exit_status_is_1(monkeypatch, tmp_path, capsys):
    target = fuzz.Target(lambda: [b'raise'], fails)
    monkeypatch.setattr(fuzz, 'TARGETS', {'toy': target})
    monkeypatch.setattr(fuzz, 'CORPUS', tmp_path)
    monkeypatch.setattr(fuzz, 'changed', lambda rng, data, parts: data)
    words = ['--seconds', '5', '--seed', '1', '--corpus', str(tmp_path)]
    assert fuzz.main(words) == 1
    assert "KeyError: 'a fault'" in capsys.readouterr().out
    assert fuzz.kept('toy') == [b'raise']
    monkeypatch.setattr(fuzz, 'changed', lambda rng, data, parts: b'')
    assert fuzz.main(words) == 1  # by the kept input
    assert sys.flags.optimize == 0  # readers assert
