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
Rauch-Tung-Striebel smoother: estimates of each state from the whole recording.

Each transition of the filter from ``x``, ``P`` by ``F`` to ``next_x``, ``next_P`` is kept as a
link, the affine map from the smoothed state after it to the one before it, with
``G = P F' next_P^-1``::

    x_s = c + G x_s_next         c = x - G next_x
    P_s = C + G P_s_next G'      C = (I - G F) P (I - G F)' + G Q G',  Q = next_P - F P F'

This Joseph form subtracts no covariances, so that ``P_s`` cannot become negative, errors of ``G``
enter only to second order, and all links of a block are computed at once. Links between which
there is no output are composed, so that the memory depends on the output rate alone: 4.6 kB for
each output with 19 states, 2.1 GB for an hour at 125 Hz.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import pickle
import tempfile
from typing import Any, IO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.estimation.slip.estimator import OutputContext

BLOCK_SIZE = 1024      # transitions that become links together
MAX_MEMORY = 1 << 26    # bytes before the file goes to disk; a few minutes of states fit
REGULARIZATION = 1e-13  # share of each variance: keeps nearly equal states solvable


class Links(NamedTuple):
    """Affine maps from smoothed states to the ones before them; see the module docstring."""

    G: Array  # (n, N, N)
    c: Array  # (n, N)
    C: Array  # (n, N, N)


@dataclass(frozen=True, slots=True)
class SmoothedState:
    """Smoothed state with the output context of the filter step."""

    segment: int    # counts the restarts
    context: OutputContext
    x: list[float]  # (N,)
    P: Array        # (N, N)


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive links in the spool; the backward pass overwrites them with states."""

    offset: int   # of the links in the spool
    links: int    # their number
    outputs: int  # offset of the pairs of a state's index and its output context
    end: tuple[Array, Array] | None  # x, P after the last link of a segment; None within one


class RtsSmoother:
    """
    An ``EstimatorRecorder``: record the transitions of the filter, then read ``states``.

    A few dozen megabytes stay in memory, the remaining data goes to a temporary file;
    EstimatorError is raised if the disk is full.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._upper = np.triu_indices(size)
        self._packed = size + len(self._upper[0])  # numbers of a state and its covariance
        self._spool = Spool()
        self._blocks: list[Block] = []
        self._smoothed_blocks = 0  # that hold states already
        self._x, self._next_x = np.empty((2, BLOCK_SIZE, size))
        self._P, self._F, self._next_P = np.empty((3, BLOCK_SIZE, size, size))
        self._link = np.empty(BLOCK_SIZE, np.intp)  # index of each transition's link
        self._begin()

    def _begin(self) -> None:
        self._transitions = 0
        self._state = 0     # index of the present state in its block
        self._left = False  # whether there was a transition from it
        self._outputs: list[tuple[int, OutputContext]] = []
        self._output_state: tuple[Array, Array] | None = None  # the present state, if output

    def close(self) -> None:
        """Delete the temporary file."""
        self._spool.close()

    def restart(self) -> None:
        """Start a new segment: the next state does not depend on the previous ones."""
        last = self._transitions - 1
        if self._output_state is not None:
            self._store_block(self._output_state)
        elif self._transitions:
            self._store_block((self._next_x[last].copy(), self._next_P[last].copy()))
        self._begin()

    def record_transition(self, x: Array, P: Array, F: Array, next_x: Array,
                          next_P: Array) -> None:
        """Record the transition of ``x`` (N,), ``P`` (N, N) by ``F`` to ``next_x``, ``next_P``."""
        if self._transitions == BLOCK_SIZE:
            self._store_block(None)
        i = self._transitions
        self._x[i], self._P[i], self._F[i] = x, P, F
        self._next_x[i], self._next_P[i], self._link[i] = next_x, next_P, self._state
        self._transitions, self._left, self._output_state = i + 1, True, None

    def record_output(self, context: OutputContext, x: Sequence[float], P: Array) -> None:
        """Record an output of the state after the last transition, by now ``x`` and ``P``."""
        if self._left:
            self._state, self._left = self._state + 1, False
        self._outputs.append((self._state, context))
        self._output_state = np.array(x), P.copy()

    def _store_block(self, end: tuple[Array, Array] | None) -> None:
        """Write the transitions as links; within a segment their last state opens a block."""
        used = slice(self._transitions)
        links = compose_links(
            backward_links(self._x[used], self._P[used], self._F[used], self._next_x[used],
                           self._next_P[used]), self._link[used])
        count = len(links.c)
        numbers = np.concatenate(
            [links.G.reshape(count, self._size ** 2), self._pack(links.c, links.C)], axis=1)
        offset = self._spool.append(
            numbers.tobytes(), reserve=(count + 1) * self._packed * numbers.itemsize)
        outputs = [item for item in self._outputs if item[0] < count or end is not None]
        self._blocks.append(Block(offset, count, self._spool.append_items(outputs), end))
        self._outputs = [(0, context) for _, context in self._outputs[len(outputs):]]
        self._transitions, self._state = 0, 0

    def states(self) -> Iterator[SmoothedState]:
        """Yield the smoothed state of each output, in the order of recording."""
        self.restart()
        self._smooth()
        segment = 0
        for block in self._blocks:
            x, P = self._unpack(self._read(block.offset, block.links + 1, self._packed))
            for index, context in self._spool.items(block.outputs):
                yield SmoothedState(segment, context, x[index].tolist(), P[index])
            segment += block.end is not None

    def _smooth(self) -> None:
        """Replace all links by smoothed states, from the last to the first."""
        x, P = np.empty(0), np.empty(0)
        for block in reversed(self._blocks[self._smoothed_blocks:]):
            if block.end is not None:
                x, P = block.end
            n = block.links
            G, c, C = self._links(block)
            xs, Ps = np.empty((n + 1, self._size)), np.empty((n + 1, self._size, self._size))
            xs[n], Ps[n] = x, P
            for k in reversed(range(n)):
                xs[k] = x = c[k] + G[k] @ x
                Ps[k] = P = C[k] + G[k] @ P @ G[k].T
            Ps = 0.5 * (Ps + Ps.transpose(0, 2, 1))
            P = Ps[0]
            self._spool.replace(block.offset, self._pack(xs, Ps).tobytes())
        self._smoothed_blocks = len(self._blocks)

    def _links(self, block: Block) -> Links:
        square = self._size ** 2
        numbers = self._read(block.offset, block.links, square + self._packed)
        G = numbers[:, :square].reshape(-1, self._size, self._size)
        return Links(G, *self._unpack(numbers[:, square:]))

    def _read(self, offset: int, rows: int, columns: int) -> Array:
        data = self._spool.read(offset, rows * columns * np.dtype(float).itemsize)
        return np.frombuffer(data).reshape(rows, columns)

    def _pack(self, x: Array, P: Array) -> Array:
        rows, columns = self._upper
        return np.concatenate([x, P[:, rows, columns]], axis=1)

    def _unpack(self, numbers: Array) -> tuple[Array, Array]:
        rows, columns = self._upper
        P = np.empty((len(numbers), self._size, self._size))
        P[:, rows, columns] = P[:, columns, rows] = numbers[:, self._size:]
        return numbers[:, :self._size], P


def backward_links(x: Array, P: Array, F: Array, next_x: Array, next_P: Array) -> Links:
    """
    Return the links of n transitions; all arrays have n rows.

    States are scaled to unit variance; a state without variance has zero gain.
    """
    sigma = np.sqrt(np.diagonal(next_P, axis1=1, axis2=2))
    scale = 1.0 / np.where(sigma > 0.0, sigma, 1.0)
    scaled = next_P * scale[:, :, None] * scale[:, None, :]
    scaled += REGULARIZATION * np.eye(x.shape[1])
    FP = F @ P
    G = (np.linalg.solve(scaled, FP * scale[:, :, None]) * scale[:, :, None]).transpose(0, 2, 1)
    keep = np.eye(x.shape[1]) - G @ F
    Q = next_P - FP @ F.transpose(0, 2, 1)
    C = keep @ P @ keep.transpose(0, 2, 1) + G @ Q @ G.transpose(0, 2, 1)
    return Links(G, x - (G @ next_x[:, :, None])[:, :, 0], 0.5 * (C + C.transpose(0, 2, 1)))


def compose_links(links: Links, group: NDArray[np.intp]) -> Links:
    """Return one link for each run of equal indices in ``group`` (n,), in ascending order."""
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    lengths = np.diff(starts, append=len(group))
    G, c, C = (part[starts] for part in links)
    for step in range(1, int(lengths.max(initial=0))):
        longer = np.flatnonzero(lengths > step)
        next_G, next_c, next_C = (part[starts[longer] + step] for part in links)
        first_G = G[longer]
        c[longer] += (first_G @ next_c[:, :, None])[:, :, 0]
        C[longer] += first_G @ next_C @ first_G.transpose(0, 2, 1)
        G[longer] = first_G @ next_G
    return Links(G, c, C)


class Spool:
    """A temporary file, in memory while it is small; EstimatorError if the disk is full."""

    def __init__(self) -> None:
        self._file = _new_file()
        self._end = 0

    def close(self) -> None:
        """Delete the file and its content."""
        self._file.close()

    def append(self, data: bytes, reserve: int = 0) -> int:
        """Append ``data``, reserving at least ``reserve`` [bytes]; return its offset."""
        offset = self._end
        self.replace(offset, data)
        self._end += max(len(data), reserve)
        return offset

    def append_items(self, items: Sequence[Any]) -> int:
        """Append any picklable items; return their offset."""
        return self.append(pickle.dumps(items, pickle.HIGHEST_PROTOCOL))

    def replace(self, offset: int, data: bytes) -> None:
        """Overwrite the block at ``offset`` with ``data``, which must fit what was reserved."""
        try:
            self._file.seek(offset)
            self._file.write(data)
        except OSError as error:
            raise EstimatorError(
                f'cannot write {offset + len(data)} bytes to {tempfile.gettempdir()} '
                f'({error.strerror}); set TMPDIR to a larger directory') from error

    def read(self, offset: int, size: int) -> bytes:
        """Return ``size`` bytes from ``offset``."""
        self._file.seek(offset)
        return self._file.read(size)

    def items(self, offset: int) -> Any:
        """Return the items at ``offset``, as written by ``append_items``."""
        self._file.seek(offset)
        return pickle.load(self._file)


def _new_file() -> IO[bytes]:
    return tempfile.SpooledTemporaryFile(max_size=MAX_MEMORY, prefix='smart_tire_')
