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
Fuzz test: readers of bytes from outside get random changes of valid bytes.

``make fuzz SECONDS=600`` shares the time among the targets of ``support/fuzz_targets.py``. A
reader must end within ``MAX_CPU`` and ``MAX_MEMORY`` and raise nothing but its documented errors.
Inputs for which it does not are written to ``test/data/fuzz``; ``make test`` reads all of these,
and a few new ones of each target. Input ``i`` of a target depends on ``--seed`` and ``i`` only.
The second table has the share of the lines of functions that every ``MEASURED``-th input ran.
"""

from __future__ import annotations

import argparse
import ast
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
import gc
import gzip
import hashlib
import inspect
from itertools import count
import multiprocessing
import os
from pathlib import Path
from random import Random
import resource
import signal
import sys
import tempfile
import time
from typing import Literal

from coverage import Coverage, CoverageData
import smart_tire
from smart_tire.cli._stack import isolated_environment
from support.fuzz_targets import Target, TARGETS

CORPUS = Path(__file__).parent / 'data' / 'fuzz'
MAX_CPU = 5.0             # s of CPU time for one input
MAX_MEMORY = 2 << 30      # bytes beyond those at the start
MEASURED = 10             # of these inputs, the lines run by one are noted
TRACING = 4.0             # CPU time of such an input over that of others, at most
MIN_SHARE = 0.1           # of the lines of a room that is shown
MAX_FAILURES = 5          # of a target: then it ends
MAX_CHANGES = 6           # of one input
MAX_BLOCK = 64            # bytes that are copied, inserted or removed at once
NUMBERS = (0, 1, 0x7f, 0x80, 0xff, 0x7fff, 0x8000, 0xffff, 0x7fffffff, 0x80000000, 0xffffffff,
           0x7fffffffffffffff, 0x8000000000000000, 0xffffffffffffffff)
SIZES = (1, 2, 4, 8)      # bytes of a number
ORDERS: tuple[Literal['little', 'big'], ...] = 'little', 'big'
STDERR = 2
MAX_TEXT = 4000           # characters of a traceback
SIGNALS = {signal.SIGPROF: f'more than {MAX_CPU} s of CPU time'}

Inputs = Iterator[bytes]


def _flip(rng: Random, data: bytearray, at: int, size: int) -> None:
    if data:
        data[at % len(data)] ^= 1 << rng.randrange(8)


def _put_number(rng: Random, data: bytearray, at: int, size: int) -> None:
    width, order = rng.choice(SIZES), rng.choice(ORDERS)
    data[at:at + width] = (rng.choice(NUMBERS) & (1 << 8 * width) - 1).to_bytes(width, order)


def _remove(rng: Random, data: bytearray, at: int, size: int) -> None:
    del data[at:at + size]


def _insert(rng: Random, data: bytearray, at: int, size: int) -> None:
    data[at:at] = rng.randbytes(size)


def _zero(rng: Random, data: bytearray, at: int, size: int) -> None:
    data[at:at + size] = bytes(len(data[at:at + size]))


def _repeat(rng: Random, data: bytearray, at: int, size: int) -> None:
    data[at:at] = data[at:at + size] * rng.choice((1, 1, 1, 20))


def _cut(rng: Random, data: bytearray, at: int, size: int) -> None:
    if rng.random() < 0.3:  # less often: what is behind the cut is not tested
        del data[at:]


CHANGES = (_flip, _put_number, _remove, _insert, _zero, _repeat, _cut)


def changed(rng: Random, data: bytes, parts: Sequence[bytes]) -> bytes:
    """Return ``data`` with random changes, some of them pieces of ``parts``."""
    found = bytearray(data)
    for _ in range(rng.randint(1, MAX_CHANGES)):
        at, size = rng.randint(0, len(found)), rng.randint(1, MAX_BLOCK)
        change = rng.choice((*CHANGES, None))
        if change is None:
            part = rng.choice(parts)
            begin = rng.randrange(max(len(part) - size, 0) + 1)
            found[at:at + rng.choice((0, size))] = part[begin:begin + size]
        else:
            change(rng, found, at, size)
    return bytes(found)


def inputs(target: Target, name: str, seed: int, first: int = 0) -> Inputs:
    """Yield changed inputs of a target without end, from number ``first`` on."""
    seeds, bodies = list(target.seeds()), list(target.bodies())
    for number in count(first):
        rng = Random(f'{name} {seed} {number}')
        if target.seal is not None and rng.random() < 0.5:
            yield b''.join(target.seal(changed(rng, rng.choice(bodies), bodies))
                           for _ in range(rng.randint(1, 3)))
        else:
            yield changed(rng, rng.choice(seeds), [*seeds, *target.tokens])


@dataclass
class Result:
    """Of one target."""

    inputs: int = 0
    accepted: int = 0  # inputs of which the reader took anything
    failures: list[tuple[bytes, str]] = field(default_factory=list)  # input, what happened


def run(read: Callable[[bytes], bool], make: Callable[[int], Inputs], seconds: float,
        limit: int | None = None, lines: Path | None = None) -> Result:
    """
    Give the inputs of ``make(first)`` to ``read`` in a child process, after a failure in another.

    Ends after ``seconds``, ``limit`` inputs, the last input, or ``MAX_FAILURES``. The folder
    ``lines`` gets the lines run by one of ``MEASURED`` inputs.
    """
    result, end = Result(), time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as folder:
        while len(result.failures) < MAX_FAILURES:
            child = multiprocessing.get_context('fork').Process(
                target=_feed, args=(Path(folder), read, make(result.inputs), end,
                                    None if limit is None else limit - result.inputs, lines))
            child.start()
            child.join()
            fed, accepted = (int(word) for word in (Path(folder) / 'count').read_text().split())
            result.inputs += fed
            result.accepted += accepted
            if child.exitcode == 0:
                break
            result.failures.append(((Path(folder) / 'input').read_bytes(), _cause(
                child.exitcode, (Path(folder) / 'errors').read_text())))
    return result


def _feed(folder: Path, read: Callable[[bytes], bool], given: Inputs, end: float,
          limit: int | None, lines: Path | None) -> None:
    """Read inputs; on failure leave the last one, and how many there were, in ``folder``."""
    gc.freeze()  # objects of ROS from the parent, whose threads are not in this process
    (folder / 'count').write_text('0 0')
    sys.stderr = (folder / 'errors').open('w')
    os.dup2(sys.stderr.fileno(), STDERR)
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    used = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MAX_MEMORY, used + MAX_MEMORY))
    # coverage asks for the files of all modules; one that a test has replaced has another or none
    vars(inspect)['_filesbymodname'].clear()
    coverage = Coverage(data_file=str(lines and lines / str(os.getpid())), config_file=False,
                        source_pkgs=['smart_tire'])
    coverage.set_option('run:disable_warnings', ['module-not-measured', 'no-data-collected'])
    fed = accepted = 0
    with (folder / 'input').open('wb', buffering=0) as current, \
            (folder / 'count').open('r+b', buffering=0) as counts:
        for data in given:
            if fed == limit or time.monotonic() > end:
                return
            fed += 1
            current.seek(0)
            current.truncate()
            current.write(data)
            os.pwrite(counts.fileno(), b'%9d %9d' % (fed, accepted), 0)
            measured = lines is not None and fed % MEASURED == 1
            signal.setitimer(signal.ITIMER_PROF, MAX_CPU * (TRACING if measured else 1.0))
            with _run_lines(coverage) if measured else nullcontext():
                accepted += bool(read(data))
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            os.pwrite(counts.fileno(), b'%9d %9d' % (fed, accepted), 0)


@contextmanager
def _run_lines(coverage: Coverage) -> Iterator[None]:
    """Note the lines of the package run in this context."""
    coverage.start()
    try:
        yield
    finally:
        coverage.stop()
        coverage.save()


def shares(folder: Path) -> dict[str, tuple[int, int]]:
    """Return room -> number of lines of its functions that were run, and of all of them."""
    run_in = defaultdict[str, set[int]](set)
    found = defaultdict[str, tuple[int, int]](lambda: (0, 0))
    for path in folder.iterdir():
        data = CoverageData(str(path))
        data.read()
        for file in data.measured_files():
            run_in[file] |= set(data.lines(file) or ())
    package = Path(smart_tire.__file__).parent
    for file in package.rglob('*.py'):
        whole = {line for node in ast.walk(ast.parse(file.read_text(encoding='utf-8')))
                 if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
                 for inner in node.body for child in ast.walk(inner) if isinstance(child, ast.stmt)
                 and not (isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant))
                 for line in [child.lineno]}
        room = file.relative_to(package).parts[0].removesuffix('.py')
        done, total = found[room]
        found[room] = done + len(whole & run_in[str(file)]), total + len(whole)
    return found


def _from(known: Sequence[bytes], first: int) -> Inputs:
    return iter(known[first:])


def _cause(status: int | None, errors: str) -> str:
    number = -(status or 0)
    return (f'exit status {status}' if number <= 0 else
            SIGNALS.get(number) or signal.Signals(number).name) + f'\n{errors[-MAX_TEXT:]}'


def kept(name: str) -> list[bytes]:
    """Return the kept inputs of a target."""
    return [gzip.decompress(path.read_bytes()) for path in sorted((CORPUS / name).glob('*.gz'))]


def keep(name: str, data: bytes, corpus: Path = CORPUS) -> Path:
    """Write an input to the corpus; return its path."""
    path = corpus / name / f'{hashlib.sha256(data).hexdigest()[:12]}.gz'
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress(data, mtime=0))
    return path


def main(words: Sequence[str] | None = None) -> int:
    """Run the fuzz test; return 1 if a reader failed."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seconds', type=float, default=120.0,
                        help='of all targets (%(default)s)')
    parser.add_argument('--seed', type=int, default=int(time.time()),
                        help='of the changes (default: the time)')
    parser.add_argument('--target', action='append', choices=TARGETS, help='may be repeated')
    parser.add_argument('--corpus', type=Path, default=CORPUS, metavar='DIR',
                        help='where inputs are kept for which a reader failed')
    options = parser.parse_args(words)
    names, failed = options.target or list(TARGETS), False
    os.environ.update(isolated_environment())  # of the nodes
    print(f'seed {options.seed}\n{"target":20}{"inputs":>9}{"accepted":>10}{"failures":>10}')
    with tempfile.TemporaryDirectory() as lines:
        for name in names:
            failed |= _report(name, options, Path(lines), options.seconds / len(names))
        print(f'\n{"room":20}{"lines":>9}{"run":>10}')
        for room, (done, total) in sorted(shares(Path(lines)).items()):
            if done > MIN_SHARE * total:
                print(f'{room:20}{total:9}{done / total:10.0%}')
    return int(failed)


def _report(name: str, options: argparse.Namespace, lines: Path, seconds: float) -> bool:
    """Feed a target for ``seconds`` and print the result; return whether it failed."""
    TARGETS[name].seeds()  # what they keep is made once, for all child processes
    old = run(TARGETS[name].read, partial(_from, kept(name)), options.seconds)
    new = run(TARGETS[name].read, partial(inputs, TARGETS[name], name, options.seed), seconds,
              lines=lines)
    failures = old.failures + new.failures
    print(f'{name:20}{new.inputs:9}{new.accepted / max(new.inputs, 1):10.0%}'
          f'{len(failures):10}', flush=True)
    for data, cause in failures:
        print(f'  {keep(name, data, options.corpus)}: {len(data)} bytes\n{cause}', flush=True)
    return bool(failures)


if __name__ == '__main__':
    sys.exit(main())
