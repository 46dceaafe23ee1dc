# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings of the film of paper A's Table I on a simulated bench, and its motions."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from smart_tire.models.film.hysteresis import TABLE_I, TABLE_I_GAIN
from smart_tire.papers.film_experiments import bench
from smart_tire.papers.film_files import COLUMNS, write_columns
from smart_tire.simulation.film import FilmTestStand

TRUE = {'alpha_gain': TABLE_I.alpha * TABLE_I_GAIN, 'a_gain': TABLE_I.a * TABLE_I_GAIN,
        'b_gain': TABLE_I.b * TABLE_I_GAIN}
RATE = 500.0  # Hz


@lru_cache
def several_loops(seed=1):
    """Return loops of 12, 6 and 3 mm at 2 Hz."""
    return bench(FilmTestStand(), sines([0.012, 0.006, 0.003], 2.0, 4, RATE), RATE, seed)


@lru_cache
def one_loop(top=0.012, frequency=5.0, seed=1):
    """Return the paper's Fig. 8, or a loop of another size."""
    return bench(FilmTestStand(), sine(top, frequency, 4.0, RATE), RATE, seed)


def sine(amplitude, frequency, duration, rate):
    """Return sinusoidal deflections between 0 and ``amplitude`` [m], as in paper A, from 0 on."""
    return sines([amplitude], frequency, duration * frequency, rate)


def ramps(corners, speed, rate):
    """Return deflections [m] from 0 to each of ``corners`` in sequence at ``speed`` [m/s]."""
    distance = np.concatenate([[0.0], np.cumsum(np.abs(np.diff([0.0, *corners])))])
    time = np.arange(round(distance[-1] / speed * rate) + 1) / rate
    return np.interp(time * speed, distance, [0.0, *corners])


def sines(amplitudes, frequency, cycles, rate):
    """Return ``cycles`` periods of ``sine`` for each of ``amplitudes`` [m], in sequence."""
    time = np.arange(round(len(amplitudes) * cycles / frequency * rate) + 1) / rate
    index = np.minimum((time * frequency / cycles).astype(int), len(amplitudes) - 1)
    return 0.5 * np.asarray(amplitudes)[index] * (1.0 - np.cos(2.0 * np.pi * frequency * time))


def write_recording(path, recording):
    """Write the file that ``read_recording`` reads."""
    write_columns(path, COLUMNS, (recording.time, recording.input, recording.output))
