"""
Accuracy of deflections measured with a film, over amplitude and frequency.

A film is identified on one simulated recording and then measures motions of other sizes and
frequencies, each over several seeds of the bench's noise.
"""

from __future__ import annotations

from collections.abc import Sequence
import sys

import numpy as np

from benchmarks.command import machine, no_arguments, reported
from smart_tire.arrays import Array
from smart_tire.calibration.bench.film_parameters import identify_film
from smart_tire.estimation.film.measure import measure
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.simulation.film_test_stand import FilmTestStand, sine

RATE = 500.0                                   # Hz
IDENTIFIED = (0.012, 1.0, 60.0)                # m peak to peak, Hz, s
SIZES = (0.0005, 0.001, 0.002, 0.005, 0.010)   # m, peak to peak
FREQUENCIES = (1.0, 2.0, 5.0, 10.0)            # Hz
DURATION = 10.0                                # s
SEEDS = range(100, 104)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return the exit status."""
    no_arguments('film', 'measure the accuracy of deflections measured with a film', argv)
    print(machine())
    return reported('film', print_measuring)


def print_measuring() -> None:
    """Print error and normalised error of the deflection for each size and frequency."""
    bench = FilmTestStand(rate=RATE)
    top, frequency, duration = IDENTIFIED
    params = identify_film(bench.run(sine(top, frequency, duration, RATE), 1), FILMS['25x3'])[0]
    print(f'deflection by the film, rms error in um (over its sigma), {len(SEEDS)} seeds:')
    print('  peak to peak' + ''.join(f'{frequency:13.0f} Hz' for frequency in FREQUENCIES))
    for size in SIZES:
        cells = []
        for frequency in FREQUENCIES:
            motion = sine(size, frequency, DURATION, RATE)
            errors, normalised = [], []
            for seed in SEEDS:
                recording = bench.run(motion, seed)
                result = measure(recording.time, recording.output, params)
                error = result.value - motion
                errors.append(error)
                normalised.append(error / result.sigma)
            cells.append(f'{1e6 * _rms(errors):8.1f} ({_rms(normalised):.2f}) ')
        print(f'  {1e3 * size:9.1f} mm' + ''.join(f'{cell:>16}' for cell in cells))


def _rms(values: list[Array]) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


if __name__ == '__main__':
    sys.exit(main())
