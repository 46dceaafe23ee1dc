# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Mutation test: changes of a source, their sample, and verdicts on a small checkout."""

from __future__ import annotations

from pathlib import Path

import mutation
import pytest

pytestmark = pytest.mark.processes

CHANGES = [  # statement, its changes
    ('x = a < b <= c', {'x = a <= b <= c', 'x = a < b < c'}),
    ('x = a not in b', {'x = a in b'}),
    ('x = (a-b) * c', {'x = ((a - b) / c)', 'x = ((a + b)) * c'}),
    ('x = -a', {'x = (a)'}),
    ('x = a and not b', {'x = a or not b', 'x = a and (b)'}),
    ('if a: b()', {'if not (a): b()', 'if a: pass'}),
    ('x = [b for b in a if b]', {'x = [b for b in a if not (b)]'}),
    ('x = b if a else c', {'x = b if not (a) else c'}),
    ('x = 10', {'x = 11', 'x = 100'}),
    ('x = 2_000_000', {'x = 4000000', 'x = 20000000'}),
    ('x = 0.5', {'x = 1.0', 'x = 0.05'}),
    ('x = True', {'x = False'}),
    (r"x = b'\xff\x00'", {r"x = b'\xff\x01'"}),
    ('a.b(c=d)', {'pass', 'a.b()'}),
    ('a.b = c', {'pass'}),
    ('a -= b', {'a += b'}),
    ('raise a', {'pass'}),
    ('return a', {'return None'}),
    ('x = min(abs(a), b)', {'x = max(abs(a), b)', 'x = min((a), b)'}),
    ('x = math.ceil(a)', {'x = math.floor(a)'}),
    ('"""Text of 3 words."""', set()),
    ('from a import b', set()),
    ("logger.warning('%d', a + 1)", set()),
    ("x = f'{a + 1}'", set()),
    ('x: Literal[3] = a', set())]


def applied(source):
    return [mutant.applied(source.encode()).decode()
            for mutant in mutation.mutants('some.py', source)]


@pytest.mark.parametrize('statement, expected', CHANGES)
def test_a_statement_has_exactly_these_changes(statement, expected):
    source = f'# Maß\ndef f(a, b, c):\n    {statement}  # why\n'
    assert set(applied(source)) == {source.replace(statement, text) for text in expected}


TOY = {
    'smart_tire/__init__.py': '',
    'smart_tire/clock/late.py': 'def late(age, limit):\n    return age > limit\n',
    'smart_tire/clock/main.py': 'import sys\nfrom smart_tire.clock.late import late\n'
                                'print(late(*map(int, sys.argv[1:])))\n',
    'smart_tire/clock/drain.py': 'def drain(items):\n    while items:\n        items.pop()\n',
    'test/clock/test_late.py': """
import subprocess
import sys
import smart_tire.clock.late

def test_in_another_process():
    subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'],
                     start_new_session=True)
    result = subprocess.run([sys.executable, '-m', 'smart_tire.clock.main', '3', '2'],
                            capture_output=True)
    assert result.stdout == b'True\\n'
""",
    'test/clock/test_drain.py': 'from smart_tire.clock.drain import drain\n\n'
                                'def test_drain():\n    drain([1, 2])\n',
    'test/clock/test_broken.py': 'from smart_tire.clock.drain import drain\n\n'
                                 'def test_broken():\n    assert False\n'}


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Return a checkout with a package and tests."""
    for name, text in TOY.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setenv('TOY', str(tmp_path))  # inherited by all child processes
    return tmp_path


def remaining_processes(toy):
    """Return the processes started by tests of ``toy`` that are still running."""
    found = []
    for path in Path('/proc').glob('[0-9]*/environ'):
        try:
            if f'TOY={toy}'.encode() in path.read_bytes().split(b'\0'):
                found.append(path)
        except OSError:
            pass  # ended, or another user's process
    return found


def test_tests_are_those_of_the_mirrored_folder_that_import_the_file(toy):
    assert mutation.tests_of(toy, 'smart_tire/clock/drain.py') == [
        'test/clock/test_drain.py', 'test/clock/test_broken.py']
    assert mutation.tests_of(toy, 'smart_tire/clock/main.py') == []
    (toy / 'smart_tire/clock/late.cpython.so').write_text('')  # compiled: not mutated
    assert mutation.sources(toy, 'clock') == ['smart_tire/clock/drain.py',
                                              'smart_tire/clock/main.py']


@pytest.mark.parametrize('line, name', [
    (1, 'AGE'), (3, 'TABLE'), (4, 'TABLE'), (6, None), (7, None)])
def test_a_constant_is_tested_where_it_is_used(tmp_path, line, name):
    text = ('AGE = 2\nTABLE = {\n    1: 2,\n}\n\nclass A:\n    age: int = 3\n\n'
            'def f(x):\n    return x > AGE and TABLE\n')
    (tmp_path / 'some.py').write_text(text)
    assert mutation.uses(tmp_path / 'some.py', line) == [
        number for number, one in enumerate(text.splitlines(), 1) if name and name in one]


@pytest.mark.parametrize('status, output, verdict', [
    (0, '', 'survived'), (None, '', 'time-out'), (2, '', 'exit 2'),
    (1, 'FAILED test/clock/test_a.py::test_b - why\n', 'test/clock/test_a.py::test_b')])
def test_the_verdict_is_what_the_tests_of_the_changed_source_say(
        toy, tmp_path, monkeypatch, status, output, verdict):
    source, seen = 'smart_tire/clock/late.py', []
    workplace = mutation.Workplace(toy, tmp_path / 'copy')

    def run(arguments, seconds):
        seen.append((workplace.tree / source).read_text())
        return status, output
    monkeypatch.setattr(workplace, 'run', run)
    monkeypatch.setattr(workplace, 'tests', lambda mutant: {'a test': 0.1})
    [mutant] = (one for one in mutation.mutants(source, TOY[source]) if '>=' in one.new)
    assert workplace.evaluate(mutant) == verdict
    assert seen == [TOY[source].replace('>', '>=')]
    assert (workplace.tree / source).read_text() == TOY[source]


@pytest.mark.long
def test_mutants_reach_processes_hang_or_survive_and_broken_tests_are_left_out(
        toy, capsys, monkeypatch):
    monkeypatch.setattr(mutation, 'GRACE', 3.0)
    assert mutation.main(['--room', 'clock', '--root', str(toy)]) == 0
    output = capsys.readouterr().out
    for line in ('survived smart_tire/clock/late.py:2: age > limit -> age >= limit',
                 'killed   smart_tire/clock/late.py:2: return age > limit -> return None '
                 '(test/clock/test_late.py::test_in_another_process)',
                 'killed   smart_tire/clock/drain.py:3: items.pop() -> pass (time-out)',
                 'survived smart_tire/clock/drain.py:2: items -> not (items)',
                 'untested smart_tire/clock/main.py'):
        assert line in output
    assert 'clock: 2 of 7 killed, 3 untested' in output
    assert (toy / 'smart_tire/clock/late.py').read_text() == TOY['smart_tire/clock/late.py']
    assert not remaining_processes(toy)


@pytest.mark.parametrize('kind, status', [('killed', 0), ('survived', 1)])
def test_the_safety_path_requires_a_share_of_killed_mutants(toy, monkeypatch, kind, status):
    monkeypatch.setattr(mutation, 'SAFETY_PATH', ('smart_tire/clock/late.py',))
    monkeypatch.setattr(mutation.Workplace, 'evaluate', lambda self, mutant: kind)
    assert mutation.main(['--root', str(toy)]) == status


@pytest.mark.long
def test_every_source_of_the_safety_path_has_tests():
    for source in mutation.sources(mutation.ROOT, mutation.SAFETY):
        assert mutation.tests_of(mutation.ROOT, source), source
    assert all((mutation.ROOT / test).exists()
               for tests in mutation.PROCESS_TESTS.values() for test in tests)
    assert all(list(mutation.ROOT.glob(pattern)) for pattern in mutation.SAFETY_PATH)
