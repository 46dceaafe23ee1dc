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
No test asserts an upper bound on real time: a machine may be busy, and time is an argument.

The rule follows values inside a module. A reading of a clock is an instant, an instant plus
something a deadline, something minus an instant a duration. A comparison in an assertion is an
upper bound if a duration is on its smaller side or a deadline on its larger one; so is a wait that
fails after a number of seconds. Order of instants, lower bounds, and ``PATIENCE``, which only a
hang exceeds, are allowed. What has to be real, at most ``MAX_REAL`` cases, has the verdict of
``support/verdict.py``. Tests marked ``long`` are not read.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from enum import Enum
import re

import pytest
from support.sources import assert_kept, read_sources, Source

TESTS = [source for source in read_sources('test')
         if source.name not in {'test/test_wall_clock.py', 'test/support/waiting.py'}]
MAX_REAL = 10  # calls of REAL in all tests
REAL, VERDICT = 'assert_within', {'test/support/verdict.py', 'test/test_verdict.py'}

CLOCKS = {f'{name}{unit}' for unit in ('', '_ns')
          for name in ('monotonic', 'perf_counter', 'process_time', 'thread_time', 'time')}
CLOCK_MODULES = {'time'}
PASSED_ON = {'abs', 'approx', 'float', 'fsum', 'int', 'list', 'max', 'mean', 'median', 'min',
             'percentile', 'quantile', 'round', 'sorted', 'sum', 'tuple'}  # functions of times
STORED = {'add', 'append', 'extend'}  # methods that make a container one of times
RUNS = {'call', 'check_call', 'check_output', 'communicate', 'run'}  # raise after a timeout


class Kind(Enum):
    """What a value is if it depends on a clock."""

    INSTANT = 'instant'
    DEADLINE = 'deadline'
    DURATION = 'duration'


# What functions return that are defined elsewhere: those of the motor rig and of robots with it.
FUNCTIONS = {'discovery_time': Kind.DURATION}
RIGS = {'support.motor_rig', 'support.robot_rig'}
METHODS = {**dict.fromkeys(('fail', 'first_duty', 'first_zero', 'plug_in', 'restart', 'times',
                            'unplug'), Kind.INSTANT),
           **dict.fromkeys(('silence', 'stopped', 'until_stopped'), Kind.DURATION)}


LEAVES = (ast.Name, ast.Constant, ast.expr_context, ast.operator, ast.cmpop, ast.boolop,
          ast.unaryop)  # which no method visits
LONG = re.compile(r'^pytestmark = .*\bmark\.long\b', re.MULTILINE)
WORD = re.compile(rf'\b({"|".join((*CLOCKS, *FUNCTIONS, *METHODS, "timeout", "wait"))})\b')


class Reader(ast.NodeVisitor):
    """Bounds in the assertions of a module, after it was visited a few times."""

    def __init__(self) -> None:
        self.bounds: set[int] = set()         # lines
        self._known: dict[str, Kind] = {}     # name or attribute as in the source
        self._stored: dict[str, Kind] = {}    # containers that a function fills
        self._returned = dict(FUNCTIONS)      # function or class.method -> what it returns
        self._methods: set[str] = set()       # class.method
        self._class = self._function = ''
        self._clocks: set[str] = set()        # imported functions
        self._has_patience = False            # imported, not defined

    def generic_visit(self, node: ast.AST) -> None:
        """Visit the parts of ``node``, but no names, constants and operators: two of three."""
        for name in node._fields:
            value = getattr(node, name, None)
            for part in value if isinstance(value, list) else (value,):
                if isinstance(part, ast.AST) and not isinstance(part, LEAVES):
                    self.visit(part)

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        if node.module in CLOCK_MODULES:
            self._clocks |= {alias.asname or alias.name for alias in node.names
                             if alias.name in CLOCKS}
        self._has_patience |= node.module == 'support.waiting'
        if node.module in RIGS:
            self._returned |= METHODS

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        if not is_long(node):
            outer, self._class = self._class, node.name
            self._methods |= {f'{node.name}.{part.name}' for part in node.body
                              if isinstance(part, ast.FunctionDef)}
            self.generic_visit(node)
            self._class = outer

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        if is_long(node):
            return
        known, outer, self._function = dict(self._known), self._function, node.name
        for argument in node.args.args:
            self._learn(argument.arg, self._returned.get(argument.arg))  # a fixture
        self.generic_visit(node)
        attributes = {name: kind for name, kind in self._known.items() if '.' in name}
        if not outer:
            self._stored.clear()
        self._known, self._function = {**known, **attributes, **self._stored}, outer

    def visit_Return(self, node: ast.Return | ast.Yield) -> None:
        self.generic_visit(node)
        kind = self._kind(node.value)
        if kind and self._function:
            self._returned[self._function] = kind
            self._returned[f'{self._class}.{self._function}'] = kind

    def visit_Yield(self, node: ast.Yield) -> None:
        self.visit_Return(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        self.generic_visit(node)
        for target in node.targets:
            self._assign(target, node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        self.generic_visit(node)
        if node.value:
            self._assign(node.target, node.value)

    def visit_For(self, node: ast.For) -> None:
        self._learn(self._name(node.target), self._kind(node.iter))
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        self.generic_visit(node)
        match node:
            case ast.Call(func=ast.Attribute(value=container, attr=name), args=[value]) \
                    if name in STORED and (kind := self._kind(value)):
                name = self._name(container)
                self._known[name] = self._stored[name] = kind
            case ast.Call(func=ast.Attribute(attr=name)) if name in RUNS and any(
                    option.arg == 'timeout' and isinstance(option.value, ast.Constant)
                    for option in node.keywords):
                self.bounds.add(node.lineno)

    def visit_Assert(self, node: ast.Assert) -> None:
        self.generic_visit(node)
        self._read(node.test, negated=False)
        for part in node.test.values if isinstance(node.test, ast.BoolOp) else [node.test]:
            match part:
                case ast.Call(func=ast.Attribute(attr='wait'), args=[ast.Constant()]):
                    self.bounds.add(node.lineno)

    def _read(self, node: ast.AST, negated: bool) -> None:
        """Read what is asserted, or the opposite of what is."""
        match node:
            case ast.UnaryOp(op=ast.Not()):
                self._read(node.operand, not negated)
                return
            case ast.comprehension():
                self._learn(self._name(node.target), self._kind(node.iter))
            case ast.Compare():
                sides = [node.left, *node.comparators]
                if any(self._is_bound(left, sign, right, negated)
                       for left, sign, right in zip(sides, node.ops, sides[1:])):
                    self.bounds.add(node.lineno)
                return
        for child in sorted(ast.iter_child_nodes(node),
                            key=lambda child: not isinstance(child, ast.comprehension)):
            self._read(child, negated)

    def _is_bound(self, left: ast.expr, sign: ast.cmpop, right: ast.expr, negated: bool) -> bool:
        if self._is_patient(left) or self._is_patient(right):
            return False
        if isinstance(sign, ast.Eq):
            return not negated and Kind.DURATION in (self._kind(left), self._kind(right))
        if isinstance(sign, ast.Gt | ast.GtE):
            left, right = right, left
        elif not isinstance(sign, ast.Lt | ast.LtE):
            return False
        if negated:
            left, right = right, left
        return self._kind(left) is Kind.DURATION or self._kind(right) is Kind.DEADLINE

    def _assign(self, target: ast.expr, value: ast.expr) -> None:
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            for one, its in zip(target.elts, value.elts):
                self._assign(one, its)
        else:
            self._learn(self._name(target), self._kind(value))

    def _name(self, node: ast.expr) -> str:
        """Return a name or attribute as in the source, but with the class instead of ``self``."""
        text = ast.unparse(node)
        return f'{self._class}.{text[5:]}' if text.startswith('self.') else text

    def _learn(self, name: str, kind: Kind | None) -> None:
        if kind:
            self._known[name] = kind

    def _kind(self, node: ast.AST | None) -> Kind | None:
        """Return what an expression is; None if it does not depend on a clock."""
        match node:
            case None:
                return None
            case ast.Name() | ast.Attribute() if self._name(node) in self._known:
                return self._known[self._name(node)]
            case ast.Call():
                return self._kind_of_call(node)
            case ast.BinOp(op=ast.Add() | ast.Sub()):
                return None if self._is_patient(node) else self._kind_of_sum(node)
            case ast.GeneratorExp() | ast.ListComp() | ast.SetComp():
                for generator in node.generators:
                    self._learn(self._name(generator.target), self._kind(generator.iter))
                return self._kind(node.elt)
            case ast.BinOp() | ast.UnaryOp() | ast.Subscript() | ast.IfExp() | ast.NamedExpr() \
                    | ast.List() | ast.Tuple() | ast.Set() | ast.Starred():
                kinds = map(self._kind, ast.iter_child_nodes(node))
                return next(filter(None, kinds), None)
        return None

    def _kind_of_call(self, node: ast.Call) -> Kind | None:
        match node.func:
            case ast.Attribute(value=ast.Name(id=module), attr=name) if module in CLOCK_MODULES:
                return Kind.INSTANT if name in CLOCKS else None
            case ast.Name(id=name) if name in self._clocks:
                return Kind.INSTANT
            case ast.Name(id=name) | ast.Attribute(attr=name) if name in PASSED_ON:
                return next(filter(None, map(self._kind, node.args)), None)
            case ast.Attribute(attr='diff'):
                return self._kind(node.args[0]) and Kind.DURATION
            case ast.Attribute() if (name := self._name(node.func)) in self._methods:
                return self._returned.get(name)
            case ast.Name(id=name) | ast.Attribute(attr=name):
                return self._returned.get(name)
        return None

    def _kind_of_sum(self, node: ast.BinOp) -> Kind | None:
        left, right = self._kind(node.left), self._kind(node.right)
        if isinstance(node.op, ast.Sub) and right is Kind.INSTANT:
            return Kind.DURATION
        if isinstance(node.op, ast.Sub) and left is Kind.INSTANT and right is None \
                and not isinstance(node.right, ast.Constant):
            return Kind.DURATION
        if {left, right} & {Kind.INSTANT, Kind.DEADLINE}:
            return Kind.DEADLINE
        return left or right

    def _is_patient(self, node: ast.AST) -> bool:
        """Return whether an expression contains the patience that only a hang exceeds."""
        return self._has_patience and any(
            isinstance(part, ast.Name) and part.id == 'PATIENCE' for part in ast.walk(node))


def is_long(node: ast.FunctionDef | ast.ClassDef) -> bool:
    """Return whether tests are marked ``long``."""
    return any(ast.unparse(one).endswith('mark.long') for one in node.decorator_list)


def wall_clock_bounds(source: Source) -> Iterator[str]:
    """Yield upper bounds on real time; a text without any ``WORD`` has none."""
    reader = Reader()
    if WORD.search(source.text) and not LONG.search(source.text):
        for _ in range(3):  # what functions return and attributes hold, also those further below
            reader.visit(source.tree)
    for line in sorted(reader.bounds):
        yield source.at(line, 'upper bound on real time')


def test_no_test_has_an_upper_bound_on_real_time():
    assert_kept(wall_clock_bounds, TESTS)


def test_few_cases_are_real():
    assert sum(len(re.findall(rf'\b{REAL}\(', source.text)) for source in TESTS
               if source.name not in VERDICT) <= MAX_REAL


HEADER = ('import time', 'from support.waiting import PATIENCE')
BEGIN = 'begin = time.monotonic()'
RIG = 'from support.motor_rig import MotorRig'


def found(*lines: str) -> list[int]:
    """Return the numbers of those of ``lines`` that have an upper bound."""
    source = Source('x.py', '\n'.join((*HEADER, *lines)))
    return [int(offense.split(':')[1]) - len(HEADER) for offense in wall_clock_bounds(source)]


@pytest.mark.parametrize('lines', [
    (BEGIN, 'assert time.monotonic() - begin < 0.5'),
    (BEGIN, 'assert 0.1 < time.monotonic() - begin <= 0.5'),
    (BEGIN, 'assert 0.5 >= abs(stamp - begin)'),
    (BEGIN, 'assert not time.monotonic() - begin > 0.5'),
    (BEGIN, 'assert time.monotonic() < begin + 1.0'),
    (BEGIN, 'assert (time.monotonic() - begin) * 1e3 == pytest.approx(3.0)'),
    (BEGIN, 'assert age == pytest.approx(time.monotonic() - begin, abs=0.2)'),
    (BEGIN, 'assert all(when - begin < 0.5 for when in stamps)'),
    (BEGIN, 'ages = [when - begin for when in stamps]', 'assert all(age < 0.5 for age in ages)'),
    (RIG, 'since = rig.unplug()', 'assert rig.record(since).first_zero() - since < 0.2'),
    (RIG, 'assert robot.until_stopped(since) < 0.3 + TOLERANCE'),
    (RIG, 'assert np.max(np.diff(record.times(command))) < 0.03'),
    ('from time import perf_counter as now', 'begin = now()', 'assert now() - begin < 1.0'),
    ('begin, x = time.time_ns(), 3', 'took = (time.time_ns() - begin) / 1e9', 'assert took < 1'),
    ('end = time.time() + 5', 'assert stamp <= end'),
    ('def took():', ' begin = time.time()', ' return time.time() - begin', 'assert took() < 2.0'),
    ('@fixture', 'def ended(): yield time.time()', 'def test(ended):',
     ' assert read() - ended < 1.0'),
    ('class A:', ' def b(self): self._t = time.time()', ' def c(self):',
     '  assert time.time() - self._t < 1'),
    ('def test():', ' late = []', ' def do(t): late.append(time.time() - t)', ' do(time.time())',
     ' assert max(late) < 0.1'),
    ('assert ready and event.wait(2.0)',),
    ('subprocess.run(words, timeout=60)',),
], ids=' / '.join)
def test_an_upper_bound_is_found(lines: tuple[str, ...]):
    assert found(*lines) == [len(lines)]


@pytest.mark.parametrize('lines', [
    (BEGIN, 'assert time.monotonic() - begin > 0.5'),
    (BEGIN, 'assert not time.monotonic() - begin < 0.5'),
    (BEGIN, 'assert time.monotonic() - begin < PATIENCE'),
    (BEGIN, 'assert time.monotonic() < begin + 2.0 * PATIENCE'),
    (BEGIN, 'assert begin <= sample.stamp <= time.monotonic()'),
    (BEGIN, 'assert begin - 0.1 < sample.stamp'),
    (BEGIN, 'took = later.stamp - sample.stamp', 'assert took < 0.5'),
    (BEGIN, 'assert len(record) < 5'),
    (BEGIN, 'while time.monotonic() - begin < 1.0: pass'),
    ('def a(): begin = time.time()', 'def b(begin): assert now - begin < 1.0'),
    ('@pytest.mark.long', 'def test():', f' {BEGIN}', ' assert time.monotonic() - begin < 0.5'),
    ('pytestmark = pytest.mark.long', BEGIN, 'assert time.monotonic() - begin < 0.5'),
    ('assert event.wait(PATIENCE) and not other.wait(0.1)',),
    ('assert hand.wait(0.5) == (0.0, 0.0) and all(hand.wait(0.5))',),
    ('subprocess.run(words, timeout=PATIENCE)',),
    ('assert virtual.until_stopped(since) < 0.3',),
    ('class Real:', ' def now(self): return time.monotonic()', 'class Virtual:',
     ' def now(self): return self._now', ' def wait(self):', '  end = self.now() + 1.0',
     '  assert self.now() < end'),
], ids=' / '.join)
def test_order_lower_bounds_and_patience_are_allowed(lines: tuple[str, ...]):
    assert found(*lines) == []


def test_a_patience_of_its_own_is_no_excuse():
    text = f'import time\nPATIENCE = 0.5\n{BEGIN}\nassert time.monotonic() - begin < PATIENCE'
    assert list(wall_clock_bounds(Source('x.py', text))) == ['x.py:4: upper bound on real time']
