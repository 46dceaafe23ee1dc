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

from itertools import islice
import os
import signal
import sys
import time

import fuzz
import pytest
from support.fuzz_targets import TARGETS

pytestmark = [pytest.mark.slow, pytest.mark.processes]

SECONDS = 60.0  # at most, of one target
NEW = 60        # inputs of one target


def source(inputs):
    """Return a function that yields the rest of ``inputs`` from a number on."""
    return lambda first: islice(inputs, first, None)


@pytest.mark.parametrize('name', TARGETS)
def test_inputs_that_once_failed_are_read(name):
    result = fuzz.run(TARGETS[name].read, source(fuzz.kept(name)), SECONDS)
    assert not result.failures
    assert result.inputs == len(fuzz.kept(name))


@pytest.mark.parametrize('name', TARGETS)
def test_changed_inputs_are_read(name):
    result = fuzz.run(TARGETS[name].read, lambda first: fuzz.inputs(TARGETS[name], name, 1, first),
                      SECONDS, NEW)
    assert not result.failures
    assert result.inputs == NEW


@pytest.mark.parametrize('name', TARGETS)
def test_unchanged_inputs_are_accepted(name):
    seeds = list(TARGETS[name].seeds())
    assert seeds
    result = fuzz.run(TARGETS[name].read, source(seeds), SECONDS)
    assert result.accepted > 0
    assert not result.failures


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


def test_the_time_and_the_number_of_inputs_are_limits():
    begin = time.monotonic()
    result = fuzz.run(fails, lambda first: iter(lambda: b'', None), 0.5)
    assert 0.5 <= time.monotonic() - begin < 5.0
    assert result.inputs > 100
    assert fuzz.run(fails, source([b''] * 100), SECONDS, 7).inputs == 7


def test_inputs_are_reproducible_from_any_number_on():
    target = TARGETS['xsens']
    first = list(islice(fuzz.inputs(target, 'xsens', 1), 20))
    assert first[5:] == list(islice(fuzz.inputs(target, 'xsens', 1, 5), 15))
    assert first != list(islice(fuzz.inputs(target, 'xsens', 2), 20))
    assert len(set(first)) == 20


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
    assert fuzz.main([*words, '--seconds', '0.1']) == 1  # by the kept input
    assert sys.flags.optimize == 0  # readers assert
