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
Mutation test: one change of the source at a time must make a test fail.

``make mutants`` runs it on the safety path, ``--room NAME`` on a folder of ``smart_tire``. The
test files of a source are those of the mirrored folder that have its name or import it, or of
other folders if there are none, and ``PROCESS_TESTS``. They run once unchanged, which shows the
tests that execute each line. Those of a changed line then run in a copy of the checkout, the
fastest first, until one fails.
"""

from __future__ import annotations

import argparse
import ast
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
import hashlib
import os
from pathlib import Path
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

from coverage import CoverageData
from support.imported_files import imported, reached

ROOT = Path(__file__).resolve().parents[1]
SAFETY = 'safety'  # name of the safety path among the rooms
SAFETY_PATH = (
    'smart_tire/protocol/deframer.py', 'smart_tire/protocol/roboclaw.py',
    'smart_tire/control/*.py', 'smart_tire/drivers/roboclaw_*.py',
    'smart_tire/drivers/motor_*.py', 'smart_tire/nodes/command_input.py',
    'smart_tire/nodes/motor_driver.py', 'smart_tire/nodes/*_controller.py',
    'smart_tire/cli/_keyboard.py', 'smart_tire/cli/_drive_session.py')
PROCESS_TESTS = {  # source file -> tests outside of its folder, or that run it in processes
    'smart_tire/nodes/command_input.py': ['test/safety/test_nodes.py'],
    'smart_tire/nodes/motor_driver.py': [
        'test/nodes/test_drivers.py', 'test/safety/test_nodes.py'],
    'smart_tire/nodes/recorder.py': ['test/cli/test_record.py'],
    'smart_tire/nodes/replayer.py': ['test/cli/test_replay.py'],
    'smart_tire/nodes/runner.py': ['test/nodes/test_start_and_stop.py'],
    'smart_tire/nodes/wheel_controller.py': ['test/safety/test_nodes.py']}
REQUIRED_SCORE = 0.9       # share of killed mutants of the safety path
NOT_COPIED = ('.*', '__pycache__', '*.egg-info', '*_output', 'build', 'install', 'log')
PYTEST = '-m', 'pytest', '-q', '-rfE', '--tb=no', '-p', 'no:cacheprovider'
MEASURE = ('--cov=smart_tire', '--cov-config=/dev/null', '--cov-context=test', '--cov-report=',
           '--durations=0', '--durations-min=0', '--continue-on-collection-errors')
MAX_TIME = 3600.0          # s, of all tests without a mutant
MAX_MUTANT_TIME = 100.0    # s, of the tests for a mutant, measured without it
MAX_FILES = 8              # test files for a line that no test runs in its own process
TIMEOUT_FACTOR, GRACE = 1.0, 10.0  # CPU time over the time without a mutant, and beyond it [s]
WAIT_FACTOR = 4.0          # time-out over that CPU time: other programs may use the cores
MAX_MEMORY = 2 << 30       # bytes per process; an endless loop may fill a list
FAILED = re.compile(r'^(?:FAILED|ERROR) (.*?)(?: - .*)?$', re.MULTILINE)
DURATION = re.compile(r'^([\d.]+)s (?:setup|call|teardown) +(.*)$', re.MULTILINE)

SWAPS: dict[type[ast.AST], type[Any]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.FloorDiv, ast.And: ast.Or, ast.Or: ast.And,
    ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitOr}
FUNCTIONS = {'min': 'max', 'max': 'min', 'any': 'all', 'all': 'any', 'ceil': 'floor',
             'floor': 'ceil'}
# Parts without influence on the behavior: types, texts, debug representations.
SKIPPED_FIELDS = {'annotation', 'returns', 'decorator_list', 'type_params'}
SKIPPED = re.compile(
    r'import |from |f[\'"]|def __(repr|str)__|if (typing\.)?TYPE_CHECKING|if __name__|'
    r'[\w.()]*log(ger|ging)?(\(\))?\.(debug|info|warning|error|critical|exception)\(')


@dataclass(frozen=True)
class Mutant:
    """One changed source."""

    file: str    # relative to the root of the checkout
    line: int
    begin: int   # of the changed expression or statement, in bytes
    old: str
    new: str
    number: int  # of the same change in the file, from 0

    def rank(self, seed: int) -> str:
        """Return a pseudo-random sort key that does not depend on other mutants or lines."""
        key = f'{seed} {self.file} {self.old} {self.new} {self.number}'
        return hashlib.sha256(key.encode()).hexdigest()

    def applied(self, source: bytes) -> bytes:
        """Return the source with the change."""
        end = self.begin + len(self.old.encode())
        return source[:self.begin] + self.new.encode() + source[end:]

    def __str__(self) -> str:
        return ' '.join(f'{self.file}:{self.line}: {self.old} -> {self.new}'.split())


def mutants(file: str, source: str) -> list[Mutant]:
    """Return all mutants of a source."""
    text, starts, same = source.encode(), [0], Counter[tuple[str, str]]()  # ast counts bytes
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    for node in nodes(ast.parse(source)):
        for target, new in changes(node):
            begin = starts[target.lineno - 1] + target.col_offset
            end = starts[target.end_lineno - 1] + target.end_col_offset
            if (old := text[begin:end].decode()) == new:
                continue
            found.append(Mutant(file, target.lineno, begin, old, new, same[old, new]))
            same[old, new] += 1
    return found


def nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that may be changed, outer ones first."""
    if isinstance(node, (ast.stmt, ast.JoinedStr)) and SKIPPED.match(ast.unparse(node)):
        return
    yield node
    for name, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and name not in SKIPPED_FIELDS:
                yield from nodes(child)


def changes(node: Any) -> Iterator[tuple[Any, str]]:
    """Yield node and new text of each change of ``node`` itself."""
    if isinstance(node, ast.Compare):
        for index, op in enumerate(node.ops):
            ops = [*node.ops[:index], SWAPS[type(op)](), *node.ops[index + 1:]]
            yield node, with_fields(node, ops=ops)
    elif isinstance(node, (ast.BoolOp, ast.BinOp, ast.AugAssign)) and type(node.op) in SWAPS:
        text = with_fields(node, op=SWAPS[type(node.op)]())
        yield node, f'({text})' if isinstance(node, ast.BinOp) else text
    elif isinstance(node, ast.UnaryOp) and not isinstance(node.op, ast.UAdd):
        yield node, f'({ast.unparse(node.operand)})'
    elif isinstance(node, ast.Constant):
        yield from ((node, repr(other)) for other in other_values(node.value))
    elif isinstance(node, ast.Call):
        yield from call_changes(node)
    elif isinstance(node, ast.Return) and node.value is not None:
        yield node, 'return None'
    elif is_deletable(node):
        yield node, 'pass'
    for test in ([node.test] if isinstance(node, (ast.If, ast.While, ast.IfExp)) else
                 node.ifs if isinstance(node, ast.comprehension) else []):
        yield test, f'not ({ast.unparse(test)})'


def other_values(value: object) -> list[object]:
    """Return values that may stand in place of a constant."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):  # a million and more are quantities, e.g. in ns
        return [value + 1 if value < 1_000_000 else value * 2, value * 10 or -1]
    if isinstance(value, float):
        return [value * 2.0 or 1.0, value / 10.0]
    return [value[:-1] + bytes((value[-1] ^ 1,))] if isinstance(value, bytes) and value else []


def call_changes(node: ast.Call) -> Iterator[tuple[ast.AST, str]]:
    """Swap functions, remove ``abs``, omit keyword arguments that may have a default."""
    name = getattr(node.func, 'id', getattr(node.func, 'attr', ''))
    if name == 'abs':
        yield node, f'({ast.unparse(node.args[0])})'
    elif name in FUNCTIONS:
        yield node.func, re.sub(rf'{name}$', FUNCTIONS[name], ast.unparse(node.func))
    for keyword in node.keywords:
        if keyword.arg is not None:
            yield node, with_fields(node, keywords=[
                other for other in node.keywords if other is not keyword])


def is_deletable(node: ast.AST) -> bool:
    """Return whether a statement can be omitted without an undefined name."""
    if isinstance(node, ast.Expr):
        return not isinstance(node.value, ast.Constant)  # a docstring
    if isinstance(node, ast.Assign):
        return all(isinstance(target, (ast.Attribute, ast.Subscript)) for target in node.targets)
    return isinstance(node, (ast.Delete, ast.Raise, ast.Break, ast.Continue))


def with_fields(node: ast.AST, **values: object) -> str:
    """Return the text of ``node`` with other fields."""
    return ast.unparse(type(node)(**{**dict(ast.iter_fields(node)), **values}))


def sources(root: Path, room: str) -> list[str]:
    """Return the files of a room that are not compiled."""
    patterns = SAFETY_PATH if room == SAFETY else (f'smart_tire/{room}/**/*.py',)
    found = {path for pattern in patterns for path in root.glob(pattern)
             if not any(path.parent.glob(f'{path.stem}.*.so'))}
    return sorted(path.relative_to(root).as_posix() for path in found)


def tests_of(root: Path, source: str) -> list[str]:
    """Return the test files of a source, the likely ones first."""
    folder = Path(source).parent.as_posix().replace('smart_tire', 'test', 1)
    own = f'test_{Path(source).stem.strip("_")}.py'

    def rank(test: str) -> tuple[bool, bool, str]:
        return Path(test).name != own, source not in imported(root, test), test
    found = [path.relative_to(root).as_posix() for path in root.glob('test/**/test_*.py')]
    reaching = [test for test in found
                if Path(test).name == own or source in reached(root, test)]
    mirrored = [test for test in reaching if test.startswith(f'{folder}/')]
    direct = [test for test in reaching if source in imported(root, test)]
    found = sorted(mirrored or direct or reaching, key=rank)
    return [*dict.fromkeys(found + PROCESS_TESTS.get(source, []))]


def uses(path: Path, line: int) -> list[int]:
    """Return the lines with the name of the constant that is defined in ``line``, if it is one."""
    lines = path.read_text(encoding='utf-8').splitlines()
    begin = next(one for one in range(line - 1, -1, -1) if not re.match(r'[\s)}\]]|$', lines[one]))
    found = re.match(r'(\w+)[^=(]*=', lines[begin])
    return [number for number, text in enumerate(lines, 1)
            if found and re.search(rf'\b{found[1]}\b', text)]


class Workplace:
    """A copy of the checkout ``root`` in ``folder``, for one test run at a time."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.tree = folder / 'tree'
        self._mark = f'MUTANT_TREE={self.tree}'
        self._seconds = defaultdict[str, float](float)  # of the tests that pass without a mutant
        self._lines: dict[str, dict[int, list[str]]] = {}  # source -> line -> test|phase
        shutil.copytree(root, self.tree, ignore=shutil.ignore_patterns(*NOT_COPIED))

    def run(self, arguments: Sequence[str], seconds: float) -> tuple[int | None, str]:
        """
        Return exit status and output; end all started processes.

        The status is None after ``seconds`` of CPU time, or ``WAIT_FACTOR`` times as many.
        """
        name, _, value = self._mark.partition('=')
        environment = {**os.environ, name: value, 'PYTHONPATH': str(self.tree),
                       'TEST_PATIENCE': '15', 'PYTHONDONTWRITEBYTECODE': '1'}
        with tempfile.TemporaryFile() as log:
            process = subprocess.Popen(
                [sys.executable, *arguments], cwd=self.tree, env=environment,
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)
            resource.prlimit(process.pid, resource.RLIMIT_DATA, (MAX_MEMORY, MAX_MEMORY))
            resource.prlimit(process.pid, resource.RLIMIT_CPU, (round(seconds), round(seconds)))
            try:
                status = process.wait(WAIT_FACTOR * seconds)
            except subprocess.TimeoutExpired:
                status = None
            finally:
                self._end_processes()
                process.wait()
            log.seek(0)
            ended = status in (-signal.SIGXCPU, -signal.SIGKILL)
            return None if ended else status, log.read().decode(errors='replace')

    def _end_processes(self) -> None:
        """End all processes started here, including those in their own session."""
        for path in Path('/proc').glob('[0-9]*/environ'):
            try:
                if self._mark.encode() in path.read_bytes().split(b'\0'):
                    os.kill(int(path.parent.name), signal.SIGKILL)
            except OSError:
                pass  # ended, or another user's process

    def measure(self, sources: Iterable[str]) -> None:
        """Run the tests of the sources unchanged: which pass, how long, and the lines they run."""
        tests = sorted({test for source in sources for test in tests_of(self.tree, source)})
        if not tests:
            return
        _, output = self.run([*PYTEST, *MEASURE, *tests], MAX_TIME)
        failed = set(FAILED.findall(output))
        for test in sorted(failed):
            print(f'fails without a mutant: {test}')
        for seconds, test in DURATION.findall(output):
            if not failed.intersection([test, test.partition('::')[0]]):
                self._seconds[test] += float(seconds)
        data = CoverageData(str(self.tree / '.coverage'))
        data.read()
        for source in sources:
            self._lines[source] = data.contexts_by_lineno(str(self.tree / source))

    def tests(self, mutant: Mutant) -> dict[str, float]:
        """Return the tests that may detect a mutant and their times [s], the fastest first."""
        files = tests_of(self.tree, mutant.file)
        lines = self._lines.get(mutant.file, {})
        changed = range(mutant.line, mutant.line + mutant.old.count('\n') + 1)
        ran = {one for line in changed for one in lines.get(line, []) if one} or {
            one for line in uses(self.tree / mutant.file, mutant.line)
            for one in lines.get(line, []) if one}
        # A fixture may be shared by the file, and processes are not seen.
        whole = {one.partition('::')[0] for one in ran if one.endswith('|setup')}
        unseen = PROCESS_TESTS.get(mutant.file, [])
        whole.update(unseen if ran else unseen or files[:MAX_FILES])
        chosen = {one.rpartition('|')[0] for one in ran}
        found, left = dict[str, float](), MAX_MUTANT_TIME
        for test, seconds in sorted(self._seconds.items(), key=lambda item: item[1]):
            if test in chosen or test.partition('::')[0] in whole:
                left -= seconds
                if found and left < 0.0:
                    break
                found[test] = seconds
        return found

    def evaluate(self, mutant: Mutant) -> str:
        """Return 'survived', 'untested', or what killed the mutant."""
        tests = self.tests(mutant)
        if not tests:
            return 'untested'
        path, chosen = self.tree / mutant.file, self.tree / 'chosen_tests'
        original = path.read_bytes()
        path.write_bytes(mutant.applied(original))
        chosen.write_text('\n'.join(tests))
        try:
            status, output = self.run([*PYTEST, '-x', f'@{chosen}'],
                                      TIMEOUT_FACTOR * sum(tests.values()) + GRACE)
        finally:
            path.write_bytes(original)
        if status == 0:
            return 'survived'
        failed = FAILED.search(output)
        return 'time-out' if status is None else failed[1] if failed else f'exit {status}'


def main(words: Sequence[str] | None = None) -> int:
    """Run the mutation test; return 1 if too many mutants of the safety path survive."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--room', action='append', metavar='NAME',
                        help='folder of smart_tire; may be repeated (default: the safety path)')
    parser.add_argument('--sample', type=int, default=100, metavar='N',
                        help='number of mutants of each room, chosen at random (%(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='seed of the sample (%(default)s)')
    parser.add_argument('--minutes', type=float, default=60.0, help='time limit (%(default)s)')
    parser.add_argument('--root', type=Path, default=ROOT, metavar='DIR',
                        help='checkout, e.g. of another version (default: this one)')
    options = parser.parse_args(words)
    root = options.root.resolve()
    end, verdicts = time.monotonic() + 60.0 * options.minutes, defaultdict[str, Counter[str]](
        Counter)
    with tempfile.TemporaryDirectory(prefix='mutants-') as folder:
        workplace = Workplace(root, Path(folder))
        for room in options.room or [SAFETY]:
            found = [mutant for file in sources(root, room)
                     for mutant in mutants(file, (root / file).read_text(encoding='utf-8'))]
            sample = sorted(found, key=lambda one: one.rank(options.seed))[:options.sample]
            workplace.measure({mutant.file for mutant in sample})
            for mutant in sample:
                if time.monotonic() > end:
                    print('stopped by the time limit')
                    break
                result = workplace.evaluate(mutant)
                kind = result if result in ('survived', 'untested') else 'killed'
                verdicts[room][kind] += 1
                print(f'{kind:8} {mutant}' + (f' ({result})' if kind == 'killed' else ''),
                      flush=True)
    for room, count in verdicts.items():
        print(f'{room}: {count["killed"]} of {count.total()} killed, {count["untested"]} untested')
    count = verdicts[SAFETY]
    return int(count['killed'] < REQUIRED_SCORE * count.total())


if __name__ == '__main__':
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # clean up as after Ctrl-C
    sys.exit(main())
