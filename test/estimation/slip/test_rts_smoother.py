# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""RTS smoother against the batch solution of linear systems, and its limiting cases."""

import numpy as np
import pytest

from smart_tire.errors import EstimatorError
from smart_tire.estimation.slip import rts_smoother
from smart_tire.estimation.slip.rts_smoother import RtsSmoother

SIZE = 3


class Chain:
    """A linear system, its recorded Kalman filter, and its state as a map of all noise."""

    def __init__(self, seed, size=SIZE):
        self.rng = np.random.default_rng(seed)
        self.recorder = RtsSmoother(size)
        self.size = size
        self.begin()

    def begin(self):
        """Start a new segment."""
        self.recorder.restart()
        size = self.size
        self.x, self.P = self.rng.normal(size=size), np.diag(10.0 ** self.rng.uniform(-4, 2, size))
        self.mean, self.map = self.x.copy(), [np.linalg.cholesky(self.P)]
        self.output_states, self.rows, self.z, self.noise = [], [], [], []
        self.filtered = []

    def predict(self, F, Q):
        """Predict by ``F`` with noise of the variances ``Q``."""
        moved, spread = F @ self.x, F @ self.P @ F.T + np.diag(Q)
        self.recorder.record_transition(self.x, self.P, F, moved, spread)
        self.x, self.P = moved, spread
        self.mean = F @ self.mean
        self.map = [F @ part for part in self.map] + [np.diag(np.sqrt(Q))]

    def correct(self, H, variance):
        """Correct with a scalar measurement of ``H`` times the state."""
        z = H @ self.x + self.rng.normal() * np.sqrt(H @ self.P @ H + variance)
        self.rows.append((H @ self.mean, [H @ part for part in self.map]))
        self.z.append(z)
        self.noise.append(variance)
        gain = self.P @ H / (H @ self.P @ H + variance)
        self.x = self.x + gain * (z - H @ self.x)
        keep = np.eye(self.size) - np.outer(gain, H)
        self.P = keep @ self.P @ keep.T + variance * np.outer(gain, gain)

    def output(self, name):
        """Record an output."""
        self.recorder.record_output(name, self.x.tolist(), self.P)
        self.filtered.append((self.x, self.P))
        self.output_states.append((self.mean, list(self.map)))

    def batch(self):
        """Yield mean and covariance of each output state, given all measurements."""
        width = len(self.map) * self.size

        def wide(parts):
            return np.concatenate([np.hstack(parts), np.zeros((
                *np.hstack(parts).shape[:-1], width - len(parts) * self.size))], axis=-1)
        A = np.array([wide([np.asarray(p) for p in parts]) for _, parts in self.rows])
        residual = np.array(self.z) - np.array([mean for mean, _ in self.rows])
        S = A @ A.T + np.diag(self.noise)
        for mean, parts in self.output_states:
            M = wide(parts)
            gain = np.linalg.solve(S, A @ M.T).T
            yield mean + gain @ residual, M @ M.T - gain @ A @ M.T

    def drive_randomly(self, steps, outputs=0.5):
        """Predict, correct and output at random, with singular transitions among them."""
        for i in range(steps):
            kind = self.rng.integers(4)
            F, Q = np.eye(self.size), np.zeros(self.size)
            if kind < 2:
                F += 0.2 * self.rng.normal(size=F.shape)
                Q = 10.0 ** self.rng.uniform(-8, -1, self.size)
            elif kind == 2:  # one state loses all information
                row = self.rng.integers(self.size)
                F[row, row], Q[row] = 0.0, 1.0
            else:  # one state is copied to another, without noise
                F[0, 0], F[0, 1] = 0.0, 1.0
                Q[1] = 1e-3
            self.predict(F / max(1.0, np.linalg.norm(F, 2)), Q)
            for _ in range(self.rng.integers(3)):
                self.correct(self.rng.normal(size=self.size), 10.0 ** self.rng.uniform(-4, 0))
            if self.rng.random() < outputs or (outputs and i == steps - 1):
                self.output(i)


def states(smoother):
    return list(smoother.states())


def assert_equal(state, mean, covariance):
    """Assert that a smoothed state is as expected, relative to its sigmas."""
    sigma = np.sqrt(np.diag(covariance))
    assert np.abs((state.x - mean) / sigma).max() < 1e-8
    assert np.abs((state.P - covariance) / np.outer(sigma, sigma)).max() < 1e-8


@pytest.mark.parametrize('block', [3, 16, rts_smoother.BLOCK_SIZE])
@pytest.mark.parametrize('outputs', [0.05, 0.2, 1.0])  # some blocks have none
@pytest.mark.parametrize('seed', range(3))
def test_smoothed_states_equal_the_batch_solution(seed, outputs, block, monkeypatch):
    monkeypatch.setattr(rts_smoother, 'BLOCK_SIZE', block)
    chain = Chain(seed)
    chain.output('start')
    chain.drive_randomly(40, outputs)
    for state, (mean, covariance) in zip(states(chain.recorder), chain.batch(), strict=True):
        assert state.segment == 0
        assert_equal(state, mean, covariance)


@pytest.mark.parametrize('seed', range(2))
def test_smoothed_covariances_are_positive_and_below_those_of_the_filter(seed):
    chain = Chain(seed, size=4)
    chain.drive_randomly(300)
    for state, (_, P) in zip(states(chain.recorder), chain.filtered, strict=True):
        sigma = np.sqrt(np.diag(P))
        scale = np.outer(sigma, sigma)
        assert np.array_equal(state.P, state.P.T)
        assert np.linalg.eigvalsh((P - state.P) / scale).min() > -1e-9
        assert np.linalg.eigvalsh(state.P / scale).min() > -1e-12


def test_nearly_equal_states_and_states_without_variance_are_smoothed():
    smoother = RtsSmoother(3)
    x, P = np.zeros(3), np.array([[1.0, 1.0, 0.0], [1.0, 1.0 + 1e-15, 0.0], [0.0, 0.0, 0.0]])
    smoother.record_output('first', x.tolist(), P)
    for _ in range(50):
        smoother.record_transition(x, P, np.eye(3), x, P)
        smoother.record_output('on', x.tolist(), P)
    smoother.record_transition(x, P, np.eye(3), x, P)
    smoother.record_output('last', [0.5, 0.5, 0.0], 1e-4 * P)  # both are measured
    for state in states(smoother):
        assert state.x == pytest.approx([0.5, 0.5, 0.0], abs=1e-6)
        assert np.abs(state.P - 1e-4 * P).max() < 1e-9


def test_segments_are_smoothed_independently():
    together, alone = Chain(1), []
    for _ in range(3):
        together.drive_randomly(30)
        alone.append(list(together.batch()))
        together.begin()
    smoothed = states(together.recorder)
    expected = [(i, *state) for i, segment in enumerate(alone) for state in segment]
    for state, (segment, mean, covariance) in zip(smoothed, expected, strict=True):
        assert state.segment == segment
        assert_equal(state, mean, covariance)


def test_no_outputs_give_no_states():
    chain = Chain(2)
    assert states(chain.recorder) == []
    chain.begin()
    chain.drive_randomly(10, outputs=0.0)
    chain.begin()
    assert states(chain.recorder) == []


def test_outputs_without_a_transition_between_them_share_one_state():
    chain = Chain(3)
    chain.output('a')
    chain.output('b')
    assert [state.context for state in states(chain.recorder)] == ['a', 'b']
    chain.begin()
    chain.output('c')
    chain.correct(np.ones(SIZE), 1e-3)  # between two outputs of one state
    chain.output('d')
    smoothed = states(chain.recorder)
    assert [state.context for state in smoothed] == ['a', 'b', 'c', 'd']
    assert smoothed[2].x == smoothed[3].x == pytest.approx(chain.x)


def test_states_can_be_read_twice_and_recording_continues():
    chain = Chain(4)
    chain.drive_randomly(20, outputs=1.0)
    first = states(chain.recorder)
    assert [state.x for state in states(chain.recorder)] == [state.x for state in first]
    chain.begin()
    chain.drive_randomly(20, outputs=1.0)
    again = states(chain.recorder)
    assert [state.x for state in again[:20]] == [state.x for state in first]
    assert len(again) == 40


def test_measurements_after_the_last_output_are_used():
    chain = Chain(5)
    chain.drive_randomly(5, outputs=1.0)
    chain.drive_randomly(4, outputs=0.0)
    chain.predict(np.eye(SIZE), np.zeros(SIZE))  # measurements before it inform the states
    for state, (mean, covariance) in zip(states(chain.recorder), chain.batch(), strict=True):
        assert_equal(state, mean, covariance)


def test_a_full_disk_raises_an_error_that_names_the_directory():
    chain = Chain(6)
    chain.drive_randomly(5)
    chain.recorder.close()
    with pytest.raises(EstimatorError, match='cannot write to .*TMPDIR'):
        states(chain.recorder)
