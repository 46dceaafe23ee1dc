"""The smoother against the batch solution of linear systems, and its limits."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip import block_spool
from smart_tire.estimation.slip.rts_smoother import BLOCK, RtsSmoother

SIZE = 3


class Chain:
    """A linear system, its Kalman filter on a tape, and its state as a map of what is random."""

    def __init__(self, seed, size=SIZE):
        self.rng = np.random.default_rng(seed)
        self.tape = RtsSmoother(size)
        self.size = size
        self.begin()

    def begin(self):
        """Start a new stretch."""
        self.tape.start()
        size = self.size
        self.x, self.P = self.rng.normal(size=size), np.diag(10.0 ** self.rng.uniform(-4, 2, size))
        self.mean, self.map = self.x.copy(), [np.linalg.cholesky(self.P)]
        self.seen, self.rows, self.z, self.noise = [], [], [], []
        self.filtered = []

    def move(self, F, Q):
        """Move by ``F`` with noise of the variances ``Q``."""
        moved, spread = F @ self.x, F @ self.P @ F.T + np.diag(Q)
        self.tape.move(self.x, self.P, F, moved, spread)
        self.x, self.P = moved, spread
        self.mean = F @ self.mean
        self.map = [F @ part for part in self.map] + [np.diag(np.sqrt(Q))]

    def see(self, H, variance):
        """Correct with one number that is ``H`` times the state."""
        z = H @ self.x + self.rng.normal() * np.sqrt(H @ self.P @ H + variance)
        self.rows.append((H @ self.mean, [H @ part for part in self.map]))
        self.z.append(z)
        self.noise.append(variance)
        gain = self.P @ H / (H @ self.P @ H + variance)
        self.x = self.x + gain * (z - H @ self.x)
        keep = np.eye(self.size) - np.outer(gain, H)
        self.P = keep @ self.P @ keep.T + variance * np.outer(gain, gain)

    def mark(self, name):
        """Report the state."""
        self.tape.mark(name, self.x.tolist(), self.P)
        self.filtered.append((self.x, self.P))
        self.seen.append((self.mean, list(self.map)))

    def batch(self):
        """Return mean and covariance of each marked state, given all that was seen."""
        width = len(self.map) * self.size

        def wide(parts):
            return np.concatenate([np.hstack(parts), np.zeros((
                *np.hstack(parts).shape[:-1], width - len(parts) * self.size))], axis=-1)
        A = np.array([wide([np.asarray(p) for p in parts]) for _, parts in self.rows])
        residual = np.array(self.z) - np.array([mean for mean, _ in self.rows])
        S = A @ A.T + np.diag(self.noise)
        for mean, parts in self.seen:
            M = wide(parts)
            gain = np.linalg.solve(S, A @ M.T).T
            yield mean + gain @ residual, M @ M.T - gain @ A @ M.T

    def wander(self, moves, marks=0.5):
        """Move, forget, correct and report at random."""
        for i in range(moves):
            kind = self.rng.integers(4)
            F, Q = np.eye(self.size), np.zeros(self.size)
            if kind < 2:
                F += 0.2 * self.rng.normal(size=F.shape)
                Q = 10.0 ** self.rng.uniform(-8, -1, self.size)
            elif kind == 2:  # one state is forgotten altogether
                row = self.rng.integers(self.size)
                F[row, row], Q[row] = 0.0, 1.0
            else:  # one state becomes the other, without noise
                F[0, 0], F[0, 1] = 0.0, 1.0
                Q[1] = 1e-3
            self.move(F / max(1.0, np.linalg.norm(F, 2)), Q)
            for _ in range(self.rng.integers(3)):
                self.see(self.rng.normal(size=self.size), 10.0 ** self.rng.uniform(-4, 0))
            if self.rng.random() < marks or (marks and i == moves - 1):
                self.mark(i)


def states(tape):
    return list(tape.states())


def assert_alike(state, mean, covariance):
    """Assert that a state is what it should be, measured by its sigmas."""
    sigma = np.sqrt(np.diag(covariance))
    assert np.abs((state.x - mean) / sigma).max() < 1e-8
    assert np.abs((state.P - covariance) / np.outer(sigma, sigma)).max() < 1e-8


@pytest.mark.parametrize('marks', [0.2, 1.0])
@pytest.mark.parametrize('seed', range(10))
def test_it_equals_the_batch_solution(seed, marks):
    chain = Chain(seed)
    chain.mark('start')
    chain.wander(40, marks)
    smoothed = states(chain.tape)
    assert len(smoothed) == len(chain.seen)
    for state, (mean, covariance) in zip(smoothed, chain.batch()):
        assert_alike(state, mean, covariance)


def textbook(moves, marks, end):
    """Return what the printed recursion makes of ``moves``, one state for each of ``marks``."""
    x, P = end
    found = {len(moves): (x, P)}
    for i in reversed(range(len(moves))):
        x0, P0, F, x1, P1 = moves[i]
        G = P0 @ F.T @ np.linalg.inv(P1)
        x, P = x0 + G @ (x - x1), P0 + G @ (P - P1) @ G.T
        found[i] = x, P
    return [found[i] for i in marks]


@pytest.mark.parametrize('in_memory', [1, 1 << 30])
@pytest.mark.parametrize('every', [1, 3, 700])
def test_many_blocks_are_one_stretch_in_memory_as_on_disk(monkeypatch, every, in_memory):
    monkeypatch.setattr(block_spool, 'IN_MEMORY', in_memory)
    rng, tape = np.random.default_rng(every), RtsSmoother(2)
    x, P, F, Q = np.zeros(2), np.eye(2), np.array([[0.99, 0.1], [0.0, 0.98]]), 0.01 * np.eye(2)
    moves, marks = [], []
    for i in range(3 * BLOCK + 5):
        moved, spread = F @ x, F @ P @ F.T + Q
        moves.append((x, P, F, moved, spread))
        tape.move(*moves[-1])
        gain = spread[:, 0] / (spread[0, 0] + 1.0)
        x = moved + gain * (rng.normal() - moved[0])
        P = spread - np.outer(gain, spread[0])
        if i % every == 0:
            tape.mark(i, x.tolist(), P)
            marks.append(i + 1)
    tape.mark('end', x.tolist(), P)
    smoothed = states(tape)
    assert [state.seen for state in smoothed] == [i - 1 for i in marks] + ['end']
    for state, (mean, covariance) in zip(smoothed, textbook(moves, [*marks, len(moves)], (x, P))):
        assert_alike(state, mean, covariance)


@pytest.mark.parametrize('seed', range(5))
def test_covariances_never_exceed_the_filters_and_stay_positive(seed):
    chain = Chain(seed, size=4)
    chain.wander(300)
    for state, (_, P) in zip(states(chain.tape), chain.filtered, strict=True):
        sigma = np.sqrt(np.diag(P))
        scale = np.outer(sigma, sigma)
        assert np.array_equal(state.P, state.P.T)
        assert np.linalg.eigvalsh((P - state.P) / scale).min() > -1e-9
        assert np.linalg.eigvalsh(state.P / scale).min() > -1e-12


def test_states_that_are_nearly_one_and_states_without_variance_do_no_harm():
    tape = RtsSmoother(3)
    x, P = np.zeros(3), np.array([[1.0, 1.0, 0.0], [1.0, 1.0 + 1e-15, 0.0], [0.0, 0.0, 0.0]])
    tape.mark('first', x.tolist(), P)
    for _ in range(50):
        tape.move(x, P, np.eye(3), x, P)
        tape.mark('on', x.tolist(), P)
    tape.move(x, P, np.eye(3), x, P)
    tape.mark('last', [0.5, 0.5, 0.0], 1e-4 * P)  # both are seen
    for state in states(tape):
        assert state.x == pytest.approx([0.5, 0.5, 0.0], abs=1e-6)
        assert np.abs(state.P - 1e-4 * P).max() < 1e-9


def test_each_start_begins_a_stretch_that_knows_nothing_of_the_others():
    together, alone = Chain(1), []
    for _ in range(3):
        together.wander(30)
        alone.append(list(together.batch()))
        together.begin()
    smoothed = states(together.tape)
    expected = [(i, *state) for i, stretch in enumerate(alone) for state in stretch]
    for state, (stretch, mean, covariance) in zip(smoothed, expected, strict=True):
        assert state.stretch == stretch
        assert_alike(state, mean, covariance)


def test_a_tape_without_marks_tells_nothing():
    chain = Chain(2)
    assert states(chain.tape) == []
    chain.begin()
    chain.wander(10, marks=0.0)
    chain.begin()
    assert states(chain.tape) == []


def test_marks_of_one_state_are_smoothed_alike_and_without_moves_they_are_the_filters():
    chain = Chain(3)
    chain.mark('a')
    chain.mark('b')
    assert [state.seen for state in states(chain.tape)] == ['a', 'b']
    chain.begin()
    chain.mark('c')
    chain.see(np.ones(SIZE), 1e-3)  # between the two marks of one state
    chain.mark('d')
    smoothed = states(chain.tape)
    assert [state.seen for state in smoothed] == ['a', 'b', 'c', 'd']
    assert smoothed[2].x == smoothed[3].x == pytest.approx(chain.x)


def test_the_states_can_be_read_twice_and_the_tape_runs_on():
    chain = Chain(4)
    chain.wander(20, marks=1.0)
    first = states(chain.tape)
    assert [state.x for state in states(chain.tape)] == [state.x for state in first]
    chain.begin()
    chain.wander(20, marks=1.0)
    again = states(chain.tape)
    assert [state.x for state in again[:20]] == [state.x for state in first]
    assert len(again) == 40


def test_moves_after_the_last_mark_count_too():
    chain = Chain(5)
    chain.wander(5, marks=1.0)
    chain.wander(4, marks=0.0)
    chain.move(np.eye(SIZE), np.zeros(SIZE))  # what was seen before it is known by it
    for state, (mean, covariance) in zip(states(chain.tape), chain.batch(), strict=True):
        assert_alike(state, mean, covariance)
