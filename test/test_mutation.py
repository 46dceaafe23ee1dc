# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Mutation test: generated mutants, the sample of them, and their verdicts."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
import re
import textwrap

import mutation
import pytest
from support.mutant_runs import stages, Workplace
from support.mutants import mutants, sample

pytestmark = pytest.mark.slow

CHANGES = [  # body of a function, operator, expected replacements of the line
    ('return [a < b]', 'comparison', {'return [a <= b]'}),
    ('return [a >= b]', 'comparison', {'return [a > b]'}),
    ('return [a == b]', 'comparison', {'return [a != b]'}),
    ('return [a is b]', 'comparison', {'return [a is not b]'}),
    ('return [a not in b]', 'comparison', {'return [a in b]'}),
    ('return [a < b <= c]', 'comparison', {'return [a <= b <= c]', 'return [a < b < c]'}),
    ('return a + b', 'arithmetic', {'return a - b'}),
    ('return (a-b) * c', 'arithmetic', {'return (a + b) * c', 'return (a - b) / c'}),
    ('return a // b % c', 'arithmetic', {'return a * b % c', 'return a // b // c'}),
    ('a -= b', 'arithmetic', {'a += b'}),
    ('return -a', 'arithmetic', {'return a'}),
    ('return a * -(b - c)', 'arithmetic',
     {'return a / -(b - c)', 'return a * (b - c)', 'return a * -(b + c)'}),
    ('return a << b', 'bitwise', {'return (a >> b)'}),
    ('return a & b == c', 'bitwise', {'return (a | b) == c'}),
    ('return a ^ b & c', 'bitwise', {'return (a | b & c)', 'return a ^ (b | c)'}),
    ('return ~a', 'bitwise', {'return a'}),
    ('return [a and b or c]', 'boolean', {'return [(a and b) and c]', 'return [a or b or c]'}),
    ('return b and not (a or c)', 'boolean',
     {'return b or not (a or c)', 'return b and (a or c)', 'return b and not (a and c)'}),
    ('if a < b: c()', 'condition', {'if not (a < b): c()'}),
    ('while a: b()', 'condition', {'while not a: b()'}),
    ('return b if a else c', 'condition', {'return b if not a else c'}),
    ('return [b for b in a if b]', 'condition', {'return [b for b in a if not b]'}),
    ('if a == b: c()', 'condition', set()),  # same as the operator comparison
    ('if not a: c()', 'condition', set()),
    ('return [10]', 'constant', {'return [11]', 'return [9]', 'return [0]'}),
    ('return [1]', 'constant', {'return [2]', 'return [0]'}),
    ('return [0.25]', 'constant', {'return [0.5]', 'return [0.125]', 'return [0.0]'}),
    ('return [0.0]', 'constant', {'return [1.0]'}),
    ('return [True]', 'constant', {'return [False]'}),
    (r"return [b'\xff\x00']", 'constant', {r"return [b'\xff\x01']"}),
    ("return ['>hB', '>B', '> a']", 'constant', {"return ['<hB', '>B', '> a']"}),
    ('return [0.25]', 'bound', set()),
    ('a.b()', 'statement', {'pass'}),
    ('a.b = c', 'statement', {'pass'}),
    ('a[b]: int = c', 'statement', {'pass'}),
    ('e = c', 'statement', set()),  # the name would be undefined
    ('a = c', 'statement', {'pass'}),
    ('d = a; d = c', 'statement', {'pass; d = c', 'd = a; pass'}),
    ('del a[b]', 'statement', {'pass'}),
    ('raise a', 'statement', {'pass'}),
    ('for b in a: return', 'statement', {'for b in a: pass'}),
    ('for b in a: continue', 'statement', set()),  # last statement of the loop: equivalent
    ('return a', 'return', {'return None'}),
    ('return a < b', 'return', {'return None', 'return not (a < b)'}),
    ('return None', 'return', set()),
    ('return min(a, b)', 'function', {'return max(a, b)'}),
    ('return abs(a - b) < c', 'function', {'return (a - b) < c'}),
    ('return math.ceil(a)', 'function', {'return math.floor(a)'}),
    ('return all(a)', 'function', {'return any(a)'}),
    ('return a(b, timeout=c)', 'argument', {'return a(b)'}),
]


def of(source: str, operator: str = '') -> list:
    """Return the mutants of one operator, or of all."""
    return [mutant for mutant in mutants('some.py', source) if operator in ('', mutant.operator)]


@pytest.mark.parametrize('body, operator, expected', CHANGES)
def test_an_operator_yields_exactly_these_changes(body, operator, expected):
    source = f'# Maß\ndef f(a, b, c):\n    d = a\n    {body}  # why  \n\n'
    made = [mutant for mutant in of(source, operator) if mutant.line == 4]
    assert {mutant.source for mutant in made} \
        == {source.replace(f'    {body}', f'    {text}') for text in expected}
    assert {(mutant.old, mutant.new) for mutant in made} == {(body, text) for text in expected}


def test_constants_and_defaults_are_scaled_by_a_factor_of_ten():
    source = textwrap.dedent("""\
        TIMEOUT = 0.5

        class Limits:
            gap: int = field(20)

            def wait(self, seconds=2.0, *, cycles: int = 30):
                return cycles * 40
        """)
    assert {mutant.new for mutant in of(source, 'bound')} == {
        'TIMEOUT = 5.0', 'TIMEOUT = 0.05', 'gap: int = field(200)', 'gap: int = field(2)',
        'def wait(self, seconds=20.0, *, cycles: int = 30):',
        'def wait(self, seconds=0.2, *, cycles: int = 30):',
        'def wait(self, seconds=2.0, *, cycles: int = 300):',
        'def wait(self, seconds=2.0, *, cycles: int = 3):'}


def test_code_without_influence_on_behavior_is_not_mutated():
    assert of('''
"""Text of 3 words."""
from typing import TYPE_CHECKING, Literal
import sys
if TYPE_CHECKING:
    limit = 3

@dataclass(frozen=True)
class Thing:
    """Text."""
    size: Literal[3]

    def __init__(self, a: Literal[4]) -> Literal[5]:
        """Text."""
        self.size = a
        self.get_logger().warning(f'{a + 1}', 3)
        logging.error('%d', a + 1)
        logger.info(min(a, 7))

    def __repr__(self):
        return f'{self.size + 1}'

if __name__ == '__main__':
    sys.exit(1)
''') == []


def test_mutants_with_the_same_bytecode_are_left_out():
    assert of('def f(a):\n    return\n') == []
    assert {mutant.new for mutant in of('def f(a):\n    return [0]\n', 'constant')} \
        == {'return [1]', 'return [-1]'}


def test_the_identity_of_a_mutant_does_not_depend_on_its_line():
    source = 'class A:\n    def f(self, a):\n        if a: a.go()\n        else: a.go()\n'
    moved = f'import os\n\n\n{source}'.replace('if a: a.go()', 'if a: a.go()  # at once')
    assert [mutant.line + 3 for mutant in of(source)] == [mutant.line for mutant in of(moved)]
    assert of(source) == of(moved)
    assert [mutant.id for mutant in of(source)] == [mutant.id for mutant in of(moved)]
    twice = of('def f(a):\n    a.go()\n    a.go()\n')
    assert [mutant.function for mutant in twice] == ['f', 'f #2']


LARGE = ''.join(f'def f{number}(a):\n    return {number} + a.b < 3\n\n' for number in range(40))
SMALL = 'def g(a):\n    return not a and a.b(3)\n'


def test_a_sample_depends_on_seed_and_sources_only():
    found = [*mutants('large.py', LARGE), *mutants('small.py', SMALL)]
    chosen = sample(found, 30, seed=1)
    assert sample(found[::-1], 30, seed=1) == chosen
    assert sample(found, 30, seed=2) != chosen
    assert sample(found, 10_000, seed=1) == sorted(found, key=chosen_order)
    edited = mutants('large.py', LARGE.replace(' 7 + a.b', ' 7 + a.c'))
    again = sample([*edited, *mutants('small.py', SMALL)], 30, seed=1)
    assert len(set(chosen) & set(again)) >= 29


def chosen_order(mutant):
    """Return the sort key of a sample."""
    return mutant.file, mutant.line, mutant.rank(1)


def test_files_and_operators_have_proportional_shares_of_a_sample():
    chosen = sample([*mutants('large.py', LARGE), *mutants('small.py', SMALL)], 30, seed=1)
    assert len(chosen) == len(set(chosen)) == 30
    per_file = Counter(mutant.file for mutant in chosen)
    assert 5 <= per_file['small.py'] <= 6
    both = [*mutants('a.py', LARGE), *mutants('b.py', LARGE.partition('def f20')[0])]
    shares = Counter(mutant.file for mutant in sample(both, 30, seed=1))
    assert 19 <= shares['a.py'] <= 21
    operators = Counter(mutant.operator for mutant in chosen if mutant.file == 'large.py')
    assert operators.keys() == {'comparison', 'arithmetic', 'constant', 'return'}
    assert max(operators.values()) - min(operators.values()) <= 1


TOY = {
    'toy/__init__.py': '',
    'toy/clock.py': 'def late(age, limit):\n    return age > limit\n',
    'toy/main.py': 'import sys, toy.clock\nprint(toy.clock.late(*map(int, sys.argv[1:])))\n',
    'toy/loop.py': 'def drain(items):\n    while items: items.pop()\n    return [not items]\n',
    'test/test_clock.py': """
import subprocess
import sys

def test_in_another_process():
    subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'],
                     start_new_session=True)
    result = subprocess.run([sys.executable, '-m', 'toy.main', '3', '2'], capture_output=True,
                          cwd='/')
    assert result.stdout == b'True\\n'
""",
    'test/test_loop.py': """
from toy.loop import drain

def test_drain():
    assert drain([1, 2]) == [True]
""",
}
TABLE = {'toy/clock.py': ('test/test_clock.py',), 'toy/loop.py': ('test/test_loop.py -k drain',)}


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Return a checkout with a package and tests."""
    root = tmp_path / 'toy_checkout'
    for name, text in TOY.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    monkeypatch.setenv('TOY', str(root))  # inherited by all child processes
    return root


def remaining_processes(toy: Path) -> list[Path]:
    """Return the processes started by tests of ``toy`` that are still running."""
    found = []
    for path in Path('/proc').glob('[0-9]*/environ'):
        try:
            if f'TOY={toy}'.encode() in path.read_bytes().split(b'\0'):
                found.append(path)
        except OSError:
            pass  # ended, or another user's process
    return found


def test_child_processes_use_the_mutant_and_survivors_are_printed(toy, tmp_path, capsys):
    report = tmp_path / 'report.md'
    assert mutation.main(['--only', 'clock.py', '--report', str(report)], toy, TABLE) == 1
    output = capsys.readouterr().out
    assert '3 of 3 mutants in 1 files' in output
    assert 'survived: toy/clock.py:2\ntoy/clock.py late: comparison\n' \
        '- return age > limit\n+ return age >= limit\n' in output
    assert '2 killed (0 by time-out), 1 survived, 0 equivalent; score 66.7%' in output
    assert (toy / 'toy/clock.py').read_text() == TOY['toy/clock.py']
    assert not remaining_processes(toy)
    listed = re.search(r'toy/clock.py late: comparison\n- .*\n\+ .*\n', output)[0]
    (toy / 'test/equivalent_mutants.txt').write_text(
        f'# Reasons.\n\n{listed}= never called\n  at the limit\n')
    assert mutation.main(['--rerun', str(report)], toy, TABLE) == 0
    assert '0 killed (0 by time-out), 0 survived, 1 equivalent' in capsys.readouterr().out


def test_a_mutant_that_hangs_is_killed_by_the_time_out(toy, capsys):
    words = ['--only', 'toy/loop.py', '--grace', '2']
    assert mutation.main(words, toy, TABLE) == 0
    output = capsys.readouterr().out
    assert re.search(r'timed out .* toy/loop.py:2 statement', output)
    assert '(test/test_loop.py::test_drain)' in output
    assert ' 0 survived' in output
    assert not remaining_processes(toy)


def test_the_original_is_restored_after_a_mutant(toy, tmp_path):
    workplace = Workplace(toy, tmp_path / 'copy')
    mutant = mutants('toy/clock.py', TOY['toy/clock.py'])[0]
    verdict = workplace.evaluate(mutant, [(('test/test_loop.py',), 1.0)], 20.0)
    assert verdict.result == 'survived'  # that test does not import it
    assert (workplace.tree / 'toy/clock.py').read_text() == TOY['toy/clock.py']


def test_fast_files_run_first_and_together_then_tests_that_killed_others():
    times = {('b.py',): 1.0, ('slow.py',): 9.0, ('a.py',): 2.0, ('c.py', '-k', 'x'): 2.5}
    assert stages(times, ['slow.py::test_1', 'a.py::test_2']) == [
        (('a.py', 'b.py'), 3.0), (('slow.py::test_1',), 11.5), (('c.py', '-k', 'x'), 2.5),
        (('slow.py',), 9.0)]
    assert stages({('slow.py',): 9.0}) == [(('slow.py',), 9.0)]


def test_a_mutant_that_exhausts_memory_is_stopped(toy, tmp_path):
    run = Workplace(toy, tmp_path / 'copy').run(('-c', 'bytearray(4 << 30)'))
    assert run.status == 1
    assert 'MemoryError' in run.output


def test_failures_without_a_mutant_and_invalid_tables_are_errors(toy, capsys):
    (toy / 'test/test_loop.py').write_text('def test_drain():\n    assert False\n')
    assert mutation.main(['--only', 'loop.py', '--jobs', '1'], toy, TABLE) == 2
    assert 'fails without a mutant' in capsys.readouterr().err
    assert mutation.main([], toy, {'toy/clock.py': ('test/test_none.py',)}) == 2
    assert 'no file matches test/test_none.py' in capsys.readouterr().err


def test_a_run_is_stopped_after_the_time_limit_with_partial_results(toy, capsys):
    assert mutation.main(['--only', 'loop.py', '--minutes', '0'], toy, TABLE) == 2
    captured = capsys.readouterr()
    assert re.search(r'stopped: \d mutants without result', captured.err)
    assert 'score' in captured.out
    assert not remaining_processes(toy)


def test_equivalent_mutants_that_no_longer_exist_are_reported(toy, capsys):
    (toy / 'test/equivalent_mutants.txt').write_text(
        'toy/clock.py late: comparison\n- return age < limit\n+ return age <= limit\n= no\n')
    mutation.main(['--list'], toy, TABLE)
    assert 'mutant no longer exists: toy/clock.py late comparison' in capsys.readouterr().out
    (toy / 'test/equivalent_mutants.txt').write_text('toy/clock.py late: comparison\n')
    assert mutation.main(['--list'], toy, TABLE) == 2


def test_entries_need_no_blank_line_between_them_but_are_not_repeated(tmp_path):
    entry = 'toy/clock.py late: comparison\n- return age < limit\n+ return age <= limit\n= no\n'
    file = tmp_path / 'equivalent.txt'
    file.write_text(f'# Reasons.\n\n{entry}  reason\n{entry.replace("late", "early")}')
    known = mutation.read_equivalents(file)
    assert [(function, reason) for (_, function, *_), reason in known.items()] == [
        ('late', 'no reason'), ('early', 'no')]
    file.write_text(f'{entry}\n{entry}')
    with pytest.raises(mutation.MutationError, match='listed twice: toy/clock.py late'):
        mutation.read_equivalents(file)
    file.write_text(f'{entry}one line more\n')
    with pytest.raises(mutation.MutationError, match='one line more'):
        mutation.read_equivalents(file)


def test_every_equivalent_mutant_in_the_file_still_exists():
    known = mutation.read_equivalents(mutation.ROOT / mutation.EQUIVALENT)
    plan = mutation.test_plan(mutation.ROOT, mutation.SAFETY_PATH)
    assert known
    assert {file for file, *_ in known} <= plan.keys()
    keys = {mutation.key(mutant) for file in {file for file, *_ in known}
            for mutant in mutants(file, (mutation.ROOT / file).read_text(encoding='utf-8'))}
    assert mutation.stale(known, plan, keys) == []


def test_every_pattern_of_the_safety_path_matches_files():
    plan = mutation.test_plan(mutation.ROOT, mutation.SAFETY_PATH)
    assert {'smart_tire/protocol/roboclaw.py', 'smart_tire/control/wheel_servo.py'} <= plan.keys()
    assert all(plan.values())


def test_of_a_pattern_those_files_run_that_import_the_source():
    plan = mutation.test_plan(mutation.ROOT, mutation.SAFETY_PATH)
    assert plan['smart_tire/control/command_check.py'] == [('test/control/test_commands.py',)]
    chosen = plan['smart_tire/control/wheel_servo.py']
    assert ('test/control/test_wheel_servo.py',) in chosen
    assert ('test/control/test_wheel_control.py',) in chosen  # through other modules
    assert ('test/control/test_path_plan.py',) not in chosen
