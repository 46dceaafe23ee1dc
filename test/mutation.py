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

"""
Mutation test of the safety path: one change of its source at a time must make a test fail.

``make mutants`` runs it. Mutants known to be equivalent are listed with the reason in
``test/equivalent_mutants.txt``, in the format in which survivors are printed.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from concurrent import futures
from pathlib import Path
import queue
import re
import shlex
import signal
import sys
import tempfile
import time

from support.imported_files import reached
from support.mutant_runs import stages, Tests, Verdict, Workplace
from support.mutants import Mutant, mutants, sample

# Source files -> test files that must kill their mutants. Both are glob patterns; pytest options
# may follow a test file. A surviving mutant takes the time of all its tests: at most about one
# minute per source file, so that a run takes less than an hour.
SAFETY_PATH: Mapping[str, tuple[str, ...]] = {
    'smart_tire/protocol/deframer.py': ('test/protocol/test_*.py',),
    'smart_tire/protocol/roboclaw.py': (
        'test/protocol/test_roboclaw.py', 'test/simulation/test_device_emulators.py',
        'test/drivers/test_roboclaw_pair.py -k "duties or low or restarted"'),
    'smart_tire/control/*.py': ('test/control/*.py',),
    'smart_tire/drivers/roboclaw_line.py': ('test/drivers/test_roboclaw_line.py',),
    'smart_tire/drivers/wheel_encoder.py': ('test/drivers/test_wheel_encoder.py',),
    'smart_tire/drivers/roboclaw_pair.py': ('test/drivers/test_roboclaw_pair.py',),
    'smart_tire/nodes/command_input.py': (
        'test/safety/test_commands.py', 'test/safety/test_publishers.py -k "motor_commands"'),
    'smart_tire/nodes/motor_driver.py': (
        'test/nodes/test_drivers.py -k "motor or board"', 'test/safety/test_emergency_stop.py',
        'test/safety/test_publishers.py -k "motor_commands"'),
    'smart_tire/nodes/wheel_controller.py': (
        'test/nodes/test_wheel_controller.py',
        'test/safety/test_publishers.py -k "wheel_states or cmd_vel"'),
    'smart_tire/nodes/trajectory_controller.py': ('test/nodes/test_trajectory_controller.py',),
    'smart_tire/cli/_keyboard.py': ('test/cli/test_keyboard.py',),
    'smart_tire/cli/_drive_session.py': ('test/cli/test_drive_session.py',),
}
ROOT = Path(__file__).resolve().parents[1]
EQUIVALENT = 'test/equivalent_mutants.txt'
# location, original, mutant and reason; a reason may have further, indented lines
ENTRY = re.compile(r'(\S+?)(?: (.*))?: (\w+)\n- (.*)\n\+ (.*)\n= (.*(?:\n  .*)*)(?:\n|$)')
REQUIRED_SCORE = 0.9  # share of killed mutants, without equivalent ones

Key = tuple[str, str, str, str, str]


class MutationError(Exception):
    """The mutation test cannot be run."""


def main(words: Sequence[str] | None = None, root: Path = ROOT,
         table: Mapping[str, tuple[str, ...]] = SAFETY_PATH) -> int:
    """Run the mutation test; return 1 if too many mutants survive, 2 if it cannot be run."""
    options = arguments(words)
    begin = time.monotonic()
    try:
        plan = {file: tests for file, tests in test_plan(root, table).items()
                if not options.only or any(Path(file).match(name) for name in options.only)}
        found = [mutant for file in plan
                 for mutant in mutants(file, (root / file).read_text(encoding='utf-8'))]
        chosen = survivors_of(options.rerun, found) if options.rerun else \
            sample(found, options.sample, options.seed)
        known = read_equivalents(root / EQUIVALENT)
        for line in stale(known, plan, {key(mutant) for mutant in found}):
            print(line)
        print(f'{len(chosen)} of {len(found)} mutants in {len(plan)} files', flush=True)
        if options.list:
            print('\n'.join(f'{mutant.id} {block(mutant)}' for mutant in chosen))
            return 0
        todo = [mutant for mutant in chosen if key(mutant) not in known]
        verdicts = evaluate_all(root, todo, plan, options)
    except MutationError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    complete = len(verdicts) == len(todo)
    verdicts += [Verdict(mutant, 'equivalent', 0.0, known[key(mutant)])
                 for mutant in chosen if key(mutant) in known]
    score = conclude(verdicts, time.monotonic() - begin, options.report)
    return 2 if not complete else int(score < REQUIRED_SCORE)


def arguments(words: Sequence[str] | None) -> argparse.Namespace:
    """Return the options on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--sample', type=int, default=300, metavar='N',
                        help='number of mutants, a random choice of all (%(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='seed of the sample (%(default)s)')
    parser.add_argument('--jobs', type=int, default=2, help='parallel runs (%(default)s)')
    parser.add_argument('--only', metavar='FILE', action='append',
                        help='only mutants of this source file or pattern; may be repeated')
    parser.add_argument('--list', action='store_true', help='print the mutants and exit')
    parser.add_argument('--report', type=Path, metavar='FILE', help='write a table in Markdown')
    parser.add_argument('--rerun', type=Path, metavar='FILE',
                        help='run only the survivors of this report')
    parser.add_argument('--minutes', type=float, default=60.0,
                        help='time limit (%(default)s); exit status 2 if it is exceeded')
    parser.add_argument('--grace', type=float, default=20.0, metavar='SECONDS',
                        help='time-out beyond three times the time of the tests (%(default)s)')
    return parser.parse_args(words)


def test_plan(root: Path, table: Mapping[str, tuple[str, ...]]) -> dict[str, list[Tests]]:
    """
    Return source file -> pytest arguments of each of its test files.

    Of the test files that match a pattern, those that import the source file, themselves or
    through others: the others cannot distinguish a mutant from it.
    """
    plan: dict[str, list[Tests]] = {}
    for pattern, entries in table.items():
        for source in files(root, pattern):
            tests = [(file, *options) for name, *options in map(shlex.split, entries)
                     for file in files(root, name) if Path(file).name.startswith('test_')
                     and ('*' not in name or source in reached(root, file))]
            plan[source] = list(dict.fromkeys([*plan.get(source, []), *tests]))
    return plan


def files(root: Path, pattern: str) -> list[str]:
    """Return the files that match, relative to ``root``."""
    found = sorted(path.relative_to(root).as_posix() for path in root.glob(pattern))
    if not found:
        raise MutationError(f'no file matches {pattern}')
    return found


def key(mutant: Mutant) -> Key:
    """Return the key of a mutant in the list of equivalent ones."""
    return mutant.file, mutant.function, mutant.operator, mutant.old, mutant.new


def block(mutant: Mutant) -> str:
    """Return a mutant in the format of the list of equivalent ones."""
    location = ' '.join(filter(None, [mutant.file, mutant.function]))
    return f'{location}: {mutant.operator}\n- {mutant.old}\n+ {mutant.new}\n'


def read_equivalents(path: Path) -> dict[Key, str]:
    """Return the equivalent mutants with their reasons."""
    known: dict[Key, str] = {}
    text = path.read_text(encoding='utf-8') if path.exists() else ''
    rest = re.sub(r'(?m)^#.*\n', '', text).lstrip()
    while rest:
        match = ENTRY.match(rest)
        if match is None:
            raise MutationError(f'{path.name}: expected location, -, +, = reason:\n'
                                + '\n'.join(rest.splitlines()[:4]))
        file, function, operator, old, new, reason = match.groups('')
        if (found := (file, function, operator, old, new)) in known:
            raise MutationError(f'{path.name}: listed twice: {file} {function}: {operator}')
        known[found] = ' '.join(reason.split())
        rest = rest[match.end():].lstrip()
    return known


def stale(known: Iterable[Key], plan: Container[str], keys: Container[Key]) -> list[str]:
    """Return the listed mutants of the files of ``plan`` that no longer exist."""
    return [f'{EQUIVALENT}: mutant no longer exists: {" ".join(entry)}'
            for entry in known if entry[0] in plan and entry not in keys]


def evaluate_all(root: Path, todo: list[Mutant], plan: Mapping[str, list[Tests]],
                 options: argparse.Namespace) -> list[Verdict]:
    """Return the verdicts on the mutants; incomplete after the time limit."""
    verdicts: list[Verdict] = []
    killers: defaultdict[object, Counter[str]] = defaultdict(Counter)
    with tempfile.TemporaryDirectory(prefix='mutants-') as folder:
        workplaces = [Workplace(root, Path(folder, str(index))) for index in range(options.jobs)]
        free: queue.SimpleQueue[Workplace] = queue.SimpleQueue()
        pool = futures.ThreadPoolExecutor(options.jobs)
        try:
            sources = sorted({mutant.file for mutant in todo})
            times = baseline(pool, workplaces, sources,
                             sorted({tests for file in sources for tests in plan[file]}))
            for workplace in workplaces:
                free.put(workplace)

            def evaluate(mutant: Mutant) -> Verdict:
                workplace, function = free.get(), (mutant.file, mutant.function)
                likely = dict(killers[function].most_common(2)
                              + killers[mutant.file].most_common(2))
                try:
                    needed = {tests: times[tests] for tests in plan[mutant.file]}
                    verdict = workplace.evaluate(mutant, stages(needed, likely), options.grace)
                finally:
                    free.put(workplace)
                if '::' in verdict.killer:
                    killers[function][verdict.killer] += 1
                    killers[mutant.file][verdict.killer] += 1
                return verdict

            begin = time.monotonic()
            jobs = [pool.submit(evaluate, mutant) for mutant in todo]
            for done in futures.as_completed(jobs, options.minutes * 60.0):
                verdicts.append(done.result())
                print(progress(verdicts, len(todo), time.monotonic() - begin), flush=True)
        except (KeyboardInterrupt, futures.TimeoutError):
            print(f'stopped: {len(todo) - len(verdicts)} mutants without result', file=sys.stderr)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for workplace in workplaces:
                workplace.close()
            pool.shutdown()
    return verdicts


def baseline(pool: futures.ThreadPoolExecutor, workplaces: list[Workplace], sources: list[str],
             needed: list[Tests]) -> dict[Tests, float]:
    """Run the tests without a mutant in all copies in parallel; return their times [s]."""
    def run(workplace: Workplace) -> list[float]:
        for root in {source.split('/')[0] for source in sources}:
            script = f'import {root}; print({root}.__path__[0])'
            path = workplace.run(('-c', script)).output.strip()
            if Path(path) != workplace.tree / root:
                raise MutationError(f'tests import {root} from {path}')
        times = []
        for tests in needed:
            run = workplace.test(tests)
            if run.status != 0:
                raise MutationError(f'{shlex.join(tests)} fails without a mutant:\n{run.output}')
            times.append(run.seconds)
        return times

    times = dict(zip(needed, map(max, zip(*pool.map(run, workplaces)))))
    for tests, seconds in sorted(times.items(), key=lambda item: item[1]):
        print(f'{seconds:7.1f} s  {shlex.join(tests)}', flush=True)
    return times


def progress(verdicts: Sequence[Verdict], total: int, elapsed: float) -> str:
    """Return a line with the latest verdict and the remaining time."""
    latest, done = verdicts[-1], len(verdicts)
    left = elapsed / done * (total - done)
    killer = f' ({latest.killer})' if latest.killer else ''
    return (f'[{done:3}/{total}, {left / 60:4.1f} min left] {latest.result:9} '
            f'{latest.seconds:6.1f} s  {where(latest.mutant)} {latest.mutant.operator}{killer}')


def where(mutant: Mutant) -> str:
    """Return file and line."""
    return f'{mutant.file}:{mutant.line}'


def conclude(verdicts: list[Verdict], elapsed: float, report: Path | None) -> float:
    """Print survivors and totals and return the score."""
    verdicts.sort(key=lambda verdict: (verdict.mutant.file, verdict.mutant.line))
    for verdict in verdicts:
        if verdict.result == 'survived':
            print(f'\nsurvived: {where(verdict.mutant)}\n{block(verdict.mutant)}', end='')
    count = Counter(verdict.result for verdict in verdicts)
    killed = count['killed'] + count['timed out']
    score = killed / (killed + count['survived']) if killed + count['survived'] else 1.0
    totals = (f'{killed} killed ({count["timed out"]} by time-out), {count["survived"]} survived, '
              f'{count["equivalent"]} equivalent; score {score:.1%}, '
              f'required {REQUIRED_SCORE:.0%}; {elapsed / 60:.1f} min')
    print(f'\n{totals}')
    if report:
        survivors = [verdict for verdict in verdicts if verdict.result == 'survived']
        others = [verdict for verdict in verdicts if verdict.result != 'survived']
        report.write_text('\n'.join([
            totals, '\n## Survivors\n', *table_rows(survivors), '\n## Others\n',
            *table_rows(others), '']), encoding='utf-8')
    return score


def table_rows(verdicts: Iterable[Verdict]) -> Iterator[str]:
    """Yield the lines of a table in Markdown."""
    yield '| id | result | location | operator | original | mutant | killed by, or reason |'
    yield '|---|---|---|---|---|---|---|'
    for verdict in verdicts:
        mutant = verdict.mutant
        cells = (mutant.id, verdict.result, f'{where(mutant)} {mutant.function}', mutant.operator,
                 f'`{mutant.old}`', f'`{mutant.new}`', verdict.killer)
        yield '| ' + ' | '.join(cell.replace('|', '\\|') for cell in cells) + ' |'


def survivors_of(report: Path, found: Iterable[Mutant]) -> list[Mutant]:
    """Return the mutants that survived according to a report."""
    ids = set(re.findall(r'(?m)^\| (\w+) \| survived \|', report.read_text(encoding='utf-8')))
    chosen = [mutant for mutant in found if mutant.id in ids]
    for missing in sorted(ids - {mutant.id for mutant in chosen}):
        print(f'{report.name}: mutant no longer exists: {missing}')
    return chosen


if __name__ == '__main__':
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # clean up as after Ctrl-C
    signal.signal(signal.SIGINT, signal.default_int_handler)   # ignored in the background
    sys.exit(main())
