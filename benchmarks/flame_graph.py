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
Flame graph of the offline analysis: CPU time by call stack, of all processes.

The Python stack of the main thread is sampled by a timer of its CPU time. Compiled functions,
those of numpy and those of this package, have no frame of their own: their time is that of their
caller. With ``--source`` the same drive is analyzed by other checkouts, above, in the same scale.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
from typing import NamedTuple

from benchmarks.harness import machine, make_folder, run_benchmark
from benchmarks.offline import simulated, write_bag, write_params
from smart_tire.errors import SmartTireError

DESCRIPTION = 'draw where the offline analysis spends its CPU time'
PERIOD = 2e-3        # s of CPU time between samples; Linux may take one per tick, 4 ms at 250 Hz
LEAST_SHARE = 3e-3   # of the longest analysis: narrower boxes are not drawn
LEVELS = 18          # of the stack, from ``analyze`` or the function of another process on
LETTER = 0.0045      # width of a letter, share of that of the figure
# functions of each process, and what sends their results
ROOTS = 'offline.analyze', 'offline._read', 'offline._with_friction', 'processes._send'

# Writes the CPU time [s] of each process and its sampled stacks, with their counts, to a folder.
SAMPLED = """
import json, os, signal, sys, time
from collections import Counter
from multiprocessing import util
from pathlib import Path
from smart_tire.analysis.offline import analyze
from smart_tire.analysis.pipeline import EstimatorParams

bag, params, folder, period = sys.argv[1:]
stacks = Counter()

def sample(number, frame):
    names = []
    while frame is not None:
        code = frame.f_code
        module = frame.f_globals.get('__name__', '').rsplit('.', 1)[-1]
        names.append(module + '.' + getattr(code, 'co_qualname', code.co_name))
        frame = frame.f_back
    stacks[tuple(reversed(names))] += 1

def start(*_):
    global begin
    begin = time.process_time()
    stacks.clear()
    signal.signal(signal.SIGPROF, sample)
    signal.setitimer(signal.ITIMER_PROF, float(period), float(period))
    util.Finalize(None, write, exitpriority=0)

def write():
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    Path(folder, str(os.getpid()) + '.json').write_text(json.dumps(
        [time.process_time() - begin, list(stacks.items())]))

util.register_after_fork(stacks, start)
start()
analyze(Path(bag), Path(folder, 'out'), EstimatorParams.load([Path(params)]))
"""

Stacks = Mapping[tuple[str, ...], float]  # functions, the outermost first -> CPU time [s]


class Box(NamedTuple):
    """A function of the flame graph with all that it calls."""

    name: str
    level: int     # 0: outermost
    begin: float   # s of CPU time
    length: float


def main(argv: Sequence[str] | None = None) -> int:
    """Draw the flame graph; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.flame_graph',
                                     description=DESCRIPTION)
    parser.add_argument('--source', type=Path, nargs='*', default=[], metavar='DIR',
                        help='other checkouts, whose modules are compiled; drawn above')
    parser.add_argument('--out', type=Path, default=Path('bench_output', 'flame_graph'),
                        metavar='DIR', help='folder for the picture (default: %(default)s)')
    args = parser.parse_args(argv)

    def draw_all() -> None:
        print(machine())
        make_folder(args.out)
        with tempfile.TemporaryDirectory(prefix='smart_tire_bench_') as folder:
            bag, params = Path(folder, 'bag'), Path(folder, 'params.yaml')
            write_params(params, 1)
            write_bag(bag, simulated(1), 1)
            sources = [*args.source, Path(__file__).parents[1]]
            found = {source: sampled(source, bag, params, Path(folder, str(number)))
                     for number, source in enumerate(sources)}
        titled = {f'{source.resolve().name}: {sum(stacks.values()):.1f} s of CPU time': stacks
                  for source, stacks in found.items()}
        print(*titled, sep='\n')
        draw(titled, args.out / 'flame_graph.png')
    return run_benchmark('flame_graph', draw_all)


def sampled(source: Path, bag: Path, params: Path, folder: Path) -> Stacks:
    """Return the stacks of the checkout ``source`` at work; raise SmartTireError if it fails."""
    folder.mkdir()
    done = subprocess.run(
        [sys.executable, '-c', SAMPLED, *map(str, (bag, params, folder, PERIOD))], cwd=source,
        env={**os.environ, 'OPENBLAS_NUM_THREADS': '1', 'PYTHONPATH': str(source.resolve())},
        capture_output=True, text=True, check=False)
    if done.returncode:
        raise SmartTireError(f'{source}: the analysis has failed:\n{done.stderr}')
    found: dict[tuple[str, ...], float] = {}
    for file in folder.glob('*.json'):
        cpu, samples = json.loads(file.read_text(encoding='utf-8'))
        period = cpu / sum(count for _, count in samples)
        for names, count in samples:
            below = below_root(names)
            found[below] = found.get(below, 0.0) + period * count
    return found


def below_root(names: Sequence[str]) -> tuple[str, ...]:
    """Return a stack from the last of ``ROOTS`` on; of what is outside, only the innermost."""
    roots = [index for index, name in enumerate(names) if name in ROOTS]
    return tuple(names[roots[-1]:] if roots else names[-1:])


def boxes(stacks: Stacks) -> Iterator[Box]:
    """Yield the boxes of the flame graph, callers before what they call, in the order of names."""
    def below(level: int, begin: float, own: Stacks) -> Iterator[Box]:
        groups: dict[str, dict[tuple[str, ...], float]] = {}
        for names, seconds in sorted(own.items()):
            if len(names) > level:
                groups.setdefault(names[level], {})[names] = seconds
        for name, group in groups.items():
            length = sum(group.values())
            yield Box(name, level, begin, length)
            yield from below(level + 1, begin, group)
            begin += length
    yield from below(0, 0.0, stacks)


def draw(analyses: Mapping[str, Stacks], path: Path) -> None:
    """Draw the flame graphs of ``analyses``, by title, one above the other, in one scale."""
    from matplotlib.figure import Figure
    longest = max(sum(stacks.values()) for stacks in analyses.values())
    figure = Figure(figsize=(13.0, 4.2 * len(analyses)), layout='constrained')
    axes = figure.subplots(len(analyses), 1, squeeze=False, sharex=True)[:, 0]
    for axis, (title, stacks) in zip(axes, analyses.items()):
        for box in boxes(stacks):
            if box.level >= LEVELS or box.length < LEAST_SHARE * longest:
                continue
            shade = sum(map(ord, box.name)) % 7 / 7.0  # the same in each graph
            axis.barh(box.level, box.length, 0.94, box.begin,
                      color=(0.97, 0.52 + 0.33 * shade, 0.28 + 0.2 * shade))
            letters = int(box.length / longest / LETTER)
            text = box.name if len(box.name) <= letters else box.name.rsplit('.', 1)[-1]
            if len(text) <= letters:
                axis.text(box.begin + 0.5 * box.length, box.level, text, ha='center',
                          va='center', fontsize=6)
        axis.set(xlim=(0.0, longest), ylim=(-0.6, LEVELS - 0.4), yticks=[], title=title)
    axes[-1].set_xlabel('CPU time [s]')
    figure.savefig(path, dpi=90)


if __name__ == '__main__':
    sys.exit(main())
