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
Rauch-Tung-Striebel smoother: estimates of each state from the whole recording.

Each transition of the filter from ``x``, ``P`` by ``F`` to ``next_x``, ``next_P`` is kept as a
link, the affine map from the smoothed state after it to the one before it, with
``G = P F' next_P^-1``::

    x_s = c + G x_s_next         c = x - G next_x
    P_s = C + G P_s_next G'      C = (I - G F) P (I - G F)' + G Q G',  Q = next_P - F P F'

This Joseph form subtracts no covariances, so that ``P_s`` cannot become negative, errors of ``G``
enter only to second order, and all links of a block are computed at once. Links between which
there is no output are composed, so that the disk space depends on the output rate alone: 6 kB for
each output with 19 states, 2.7 GB for an hour at 125 Hz.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import os
import pickle
import tempfile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.estimation.slip.output import OutputContext

BLOCK_SIZE = 1024      # transitions that become links together
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


class RtsSmoother:
    """
    An ``EstimatorRecorder``: record the transitions of the filter, then read ``states``.

    Blocks of links go to temporary files, which the backward pass overwrites with states;
    EstimatorError is raised if the disk is full.
    """

    def __init__(self, size: int) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix='smart_tire_')
        # of each block, x, P after the last link of a segment; None within one
        self._ends: list[tuple[Array, Array] | None] = []
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
        """Delete the temporary files."""
        self._folder.cleanup()

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
        outputs = [item for item in self._outputs if item[0] < count or end is not None]
        self._write(len(self._ends), (outputs, *links))
        self._ends.append(end)
        self._outputs = [(0, context) for _, context in self._outputs[len(outputs):]]
        self._transitions, self._state = 0, 0

    def states(self) -> Iterator[SmoothedState]:
        """Yield the smoothed state of each output, in the order of recording."""
        self.restart()
        self._smooth()
        segment = 0
        for block, end in enumerate(self._ends):
            outputs, x, P = self._read(block)
            for index, context in outputs:
                yield SmoothedState(segment, context, x[index].tolist(), P[index])
            segment += end is not None

    def _smooth(self) -> None:
        """Replace all links by smoothed states, from the last to the first."""
        x, P = np.empty(0), np.empty(0)
        for block in reversed(range(self._smoothed_blocks, len(self._ends))):
            x, P = self._ends[block] or (x, P)
            outputs, G, c, C = self._read(block)
            xs, Ps = np.concatenate([c, [x]]), np.concatenate([C, [P]])
            for k in reversed(range(len(c))):
                xs[k] = x = c[k] + G[k] @ x
                Ps[k] = P = C[k] + G[k] @ P @ G[k].T
            Ps = 0.5 * (Ps + Ps.transpose(0, 2, 1))
            P = Ps[0]
            self._write(block, (outputs, xs, Ps))
        self._smoothed_blocks = len(self._ends)

    def _write(self, block: int, content: tuple[Any, ...]) -> None:
        folder = self._folder.name
        try:
            with open(os.path.join(folder, str(block)), 'wb') as file:
                pickle.dump(content, file, pickle.HIGHEST_PROTOCOL)
        except OSError as error:
            raise EstimatorError(f'cannot write to {folder} ({error.strerror}); set TMPDIR to a '
                                 'larger directory') from error

    def _read(self, block: int) -> Any:
        with open(os.path.join(self._folder.name, str(block)), 'rb') as file:
            return pickle.load(file)


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
