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

"""Mutants of a Python source: the same text except for one expression or statement."""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
import hashlib
from itertools import chain, count
import re
from types import CodeType
from typing import Any

MIN_PER_FILE = 5  # mutants of a file in a sample, if it has that many

SWAPS: dict[type[ast.AST], type[Any]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.FloorDiv, ast.And: ast.Or, ast.Or: ast.And,
    ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitOr,
}
EQUALITY = (ast.Eq, ast.NotEq, ast.Is, ast.IsNot, ast.In, ast.NotIn)
BITWISE = (ast.LShift, ast.RShift, ast.BitAnd, ast.BitOr, ast.BitXor)
FUNCTIONS = {'min': 'max', 'max': 'min', 'any': 'all', 'all': 'any', 'ceil': 'floor',
             'floor': 'ceil'}
UNARY: dict[type[ast.AST], str] = {
    ast.USub: 'arithmetic', ast.Invert: 'bitwise', ast.Not: 'boolean'}
ATOMS = (ast.Name, ast.Attribute, ast.Call, ast.Constant, ast.Subscript)
DELETABLE = (ast.AugAssign, ast.Delete, ast.Raise, ast.Break, ast.Continue, ast.Return)

# Parts without influence on the behavior: types, texts, and debug representations.
SKIPPED_FIELDS = {'annotation', 'returns', 'decorator_list', 'type_params'}
SKIPPED_NODES = (ast.Import, ast.ImportFrom, ast.JoinedStr)
SKIPPED_FUNCTIONS = {'__repr__', '__str__'}
SKIPPED_GUARD = re.compile(r"(typing\.)?TYPE_CHECKING|__name__ == '__main__'")
STRUCT = re.compile(r'[<>]\w*[hHiIlLqQefd]\w*')  # format whose byte order matters
COMMENT = re.compile(rb'\s{2,}# .*')
LOGGING = re.compile(r'.*log(ger|ging)?(\(\))?\.(debug|info|warning|error|critical|exception)')


@dataclass(frozen=True)
class Mutant:
    """One changed source; its identity does not depend on the line number."""

    file: str      # relative to the root of the checkout
    function: str  # qualified name, with #2, #3 for repetitions of the same change
    operator: str
    old: str       # the changed lines, joined to one
    new: str
    line: int = field(compare=False)
    source: str = field(compare=False, repr=False)

    @property
    def id(self) -> str:  # noqa: A003
        """Return a short name for reports."""
        return self.rank('')[:10]

    def rank(self, seed: object) -> str:
        """Return a pseudo-random sort key that does not depend on other mutants."""
        key = (str(seed), self.file, self.function, self.operator, self.old, self.new)
        return hashlib.sha256('\n'.join(key).encode()).hexdigest()


@dataclass(frozen=True)
class _Scope:
    """Scope of a node."""

    function: str = ''
    definition: bool = True              # evaluated once: constants and parameter defaults
    rebound: frozenset[str] = frozenset()  # local names with more than one assignment


Change = tuple[str, Any, str]  # operator, node, replacement text


def _operand(node: ast.expr) -> str:
    text = ast.unparse(node)
    return text if isinstance(node, ATOMS) else f'({text})'


def _with(node: ast.AST, **fields: object) -> str:
    """Return the text of ``node`` with other fields."""
    return ast.unparse(type(node)(**{**dict(ast.iter_fields(node)), **fields}))


def _operations(node: ast.AST, _: _Scope) -> Iterator[Change]:
    """Swap operators, remove unary ones."""
    if isinstance(node, ast.Compare):
        for index, op in enumerate(node.ops):
            ops = [*node.ops[:index], SWAPS[type(op)](), *node.ops[index + 1:]]
            yield 'comparison', node, _with(node, ops=ops)
    elif isinstance(node, ast.BoolOp):
        yield 'boolean', node, _with(node, op=SWAPS[type(node.op)]())
    elif isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in SWAPS:
        text = _with(node, op=SWAPS[type(node.op)]())
        if not isinstance(node.op, BITWISE):
            yield 'arithmetic', node, text
        else:  # of different precedence
            yield 'bitwise', node, f'({text})' if isinstance(node, ast.BinOp) else text
    elif isinstance(node, ast.UnaryOp) and type(node.op) in UNARY:
        yield UNARY[type(node.op)], node, _operand(node.operand)


def _conditions(node: ast.AST, _: _Scope) -> Iterator[Change]:
    """Negate conditions, unless another operator does the same."""
    tests = ([node.test] if isinstance(node, (ast.If, ast.While, ast.IfExp)) else
             node.ifs if isinstance(node, ast.comprehension) else [])
    for test in tests:
        if not (isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not)
                or isinstance(test, ast.Compare) and isinstance(test.ops[0], EQUALITY)):
            yield 'condition', test, f'not {_operand(test)}'


def _constants(node: ast.AST, scope: _Scope) -> Iterator[Change]:
    """Change values; scale constants and parameter defaults by a factor of 10."""
    if not isinstance(node, ast.Constant):
        return
    value: Any = node.value
    others: list[Any] = []
    bounds: list[Any] = []
    if isinstance(value, bool):
        others = [not value]
    elif isinstance(value, int):
        others, bounds = [value + 1, value - 1, 0], [value * 10, value // 10]
    elif isinstance(value, float):
        others, bounds = [value * 2 or 1.0, value / 2, 0.0], [value * 10, value / 10]
    elif isinstance(value, bytes) and value:
        others = [value[:-1] + bytes((value[-1] ^ 1,))]
    elif isinstance(value, str) and STRUCT.fullmatch(value):
        others = [{'<': '>', '>': '<'}[value[0]] + value[1:]]
    yield from (('bound', node, repr(other)) for other in bounds if scope.definition)
    yield from (('constant', node, repr(other)) for other in others)


def _is_needed(target: object, scope: _Scope) -> bool:
    """Return whether a name would be undefined without this assignment, which any test detects."""
    if isinstance(target, ast.Attribute) and scope.function.endswith('__init__'):
        return isinstance(target.value, ast.Name) and target.value.id == 'self'
    return isinstance(target, ast.Name) and target.id not in scope.rebound


def _statements(node: ast.AST, scope: _Scope) -> Iterator[Change]:
    """Delete statements with an effect; change return values."""
    if isinstance(node, ast.Return) and node.value is not None:
        yield 'return', node, 'return None'
        if isinstance(node.value, (ast.Compare, ast.BoolOp)):
            yield 'return', node, f'return not {_operand(node.value)}'
        return
    if isinstance(node, (ast.Assign, ast.AnnAssign)):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        deletable = not (scope.definition or all(_is_needed(target, scope) for target in targets))
    elif isinstance(node, ast.Expr):
        deletable = not isinstance(node.value, ast.Constant)  # a docstring
    else:
        deletable = isinstance(node, DELETABLE)
    if deletable:
        yield 'statement', node, 'pass'


def _calls(node: ast.AST, _: _Scope) -> Iterator[Change]:
    """Swap functions, remove ``abs``, omit keyword arguments that may have a default."""
    if not isinstance(node, ast.Call):
        return
    function = node.func
    if isinstance(function, ast.Name) and function.id == 'abs' and len(node.args) == 1:
        yield 'function', node, _operand(node.args[0])
    elif isinstance(function, ast.Name) and function.id in FUNCTIONS:
        yield 'function', function, FUNCTIONS[function.id]
    elif isinstance(function, ast.Attribute) and function.attr in FUNCTIONS:
        yield 'function', function, _with(function, attr=FUNCTIONS[function.attr])
    for keyword in node.keywords:
        if keyword.arg is not None:
            others = [other for other in node.keywords if other is not keyword]
            yield 'argument', node, _with(node, keywords=others)


OPERATORS = (_operations, _conditions, _constants, _statements, _calls)


def _skipped(node: ast.AST) -> bool:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        return LOGGING.fullmatch(ast.unparse(node.value.func)) is not None
    if isinstance(node, ast.If):
        return SKIPPED_GUARD.fullmatch(ast.unparse(node.test)) is not None
    return (isinstance(node, SKIPPED_NODES)
            or isinstance(node, ast.FunctionDef) and node.name in SKIPPED_FUNCTIONS)


def _rebound(function: ast.AST) -> frozenset[str]:
    names = Counter(
        node.arg if isinstance(node, ast.arg) else node.id for node in ast.walk(function)
        if isinstance(node, ast.arg)
        or isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store))
    return frozenset(name for name, times in names.items() if times > 1)


def _nodes(node: ast.AST, scope: _Scope) -> Iterator[tuple[ast.AST, _Scope]]:
    """Yield the nodes that may be mutated, outer ones first."""
    if _skipped(node):
        return
    yield node, scope
    inner = scope
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
        inner = replace(scope, function=f'{scope.function}.{node.name}'.lstrip('.'))
    for name, value in ast.iter_fields(node):
        if name not in SKIPPED_FIELDS:
            if name == 'body' and isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                inner = replace(inner, definition=False, rebound=_rebound(node))
            elif name == 'args' and isinstance(value, ast.arguments):
                inner = replace(inner, definition=True)
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _nodes(child, inner)


def _signature(code: CodeType) -> tuple[object, ...]:
    """Return the bytecode and names of ``code``, without line numbers."""
    constants = (_signature(value) if isinstance(value, CodeType) else (type(value), repr(value))
                 for value in code.co_consts)
    return (code.co_code, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars,
            code.co_argcount, code.co_kwonlyargcount, code.co_flags,
            getattr(code, 'co_exceptiontable', b''), *constants)


def _compiled(source: str) -> tuple[object, ...]:
    return _signature(compile(source, '', 'exec', dont_inherit=True))


def mutants(file: str, source: str) -> list[Mutant]:
    """
    Return all mutants of a source in the order of its lines.

    Mutants that compile to the same bytecode as the original or another mutant are left out.
    """
    text = source.encode()  # ast counts bytes
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found: dict[Mutant, None] = {}
    seen = {_compiled(source)}
    for node, scope in _nodes(ast.parse(source), _Scope()):
        for operator, target, new in chain.from_iterable(
                changes(node, scope) for changes in OPERATORS):
            above, below = starts[target.lineno - 1], starts[target.end_lineno]
            start, end = above + target.col_offset, starts[target.end_lineno - 1] + \
                target.end_col_offset
            changed = (text[:start] + new.encode() + text[end:]).decode()
            signature = _compiled(changed)
            if signature not in seen:
                seen.add(signature)
                old_line = _one_line(text[above:below])
                new_line = _one_line(text[above:start] + new.encode() + text[end:below])
                names = chain([scope.function],
                              (f'{scope.function} #{n}'.lstrip() for n in count(2)))
                named = (Mutant(file, name, operator, old_line, new_line, target.lineno, changed)
                         for name in names)
                found[next(mutant for mutant in named if mutant not in found)] = None
    return sorted(found, key=lambda mutant: mutant.line)


def _one_line(text: bytes) -> str:
    return ' '.join(COMMENT.sub(b'', text).decode().split())


def sample(found: Sequence[Mutant], limit: int, seed: int) -> list[Mutant]:
    """
    Return at most ``limit`` mutants, reproducible for the same sources and seed.

    The shares of the files are proportional to their numbers of mutants, at least
    ``MIN_PER_FILE``; within a file, operators alternate. A change of one function has little
    effect on the choice in others.
    """
    queues: dict[str, list[Mutant]] = {}
    by_file: defaultdict[str, Counter[str]] = defaultdict(Counter)
    turns = {}
    for mutant in sorted(found, key=lambda mutant: mutant.rank(seed)):
        turns[mutant] = by_file[mutant.file][mutant.operator]
        by_file[mutant.file][mutant.operator] += 1
        queues.setdefault(mutant.file, []).append(mutant)
    taken = dict.fromkeys(sorted(queues), 0)
    for _ in range(min(limit, len(found))):
        file = max((file for file in taken if taken[file] < len(queues[file])),
                   key=lambda file: (taken[file] < MIN_PER_FILE,
                                     len(queues[file]) / (2 * taken[file] + 1)))
        taken[file] += 1
    chosen = [mutant for file, queue in queues.items()
              for mutant in sorted(queue, key=lambda mutant: turns[mutant])[:taken[file]]]
    return sorted(chosen, key=lambda mutant: (mutant.file, mutant.line, mutant.rank(seed)))
