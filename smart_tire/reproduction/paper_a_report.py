"""What paper A's figures show, and what of it is found again; all numbers from the records."""

from __future__ import annotations

import math

import numpy as np

from smart_tire.models.film.elastica import TOUCHING_STROKE
from smart_tire.models.film.hysteresis import TABLE_I, TABLE_I_GAIN
from smart_tire.reproduction.film_fit import FREQUENCY, Identification
from smart_tire.reproduction.film_loops import (
    FREQUENCIES, Proportionality, RateIndependence, Trace)
from smart_tire.reproduction.report_section import Section

NO_DATA = ('The paper gives its measurements as graphs only, so the curves can be compared by '
           'their kind and not point by point.')
SCALED = ('Table I holds for the 25 x 3 mm film. For this one K is scaled with the geometry as in '
          'A(15) and the loop keeps its shape (alpha K): both assumed, so the charges in {unit} '
          'are not a prediction for the film of the paper.')
SIGNIFICANT = 3.0  # sigmas
FLAT = 0.01        # change per decade of frequency that still is flat
LINE = 0.95        # R^2 that passes for a straight line on a graph
EXPECTED = {1: 0.683, 2: 0.954}  # shares within so many sigmas


def trace_page(trace: Trace) -> Section:
    """Return the words for Fig. 4."""
    page = Section('paper_a_fig_4', 'Paper A, Fig. 4: a buckling test at 5 Hz')
    loop = trace.loop
    page.row('motion', '4 (-1 + sin 10 pi t) mm', 'the same')
    page.row('film', '32 x 3 mm, 110 um', 'the same')
    page.row('charge, half its range', 'graph', f'{loop.peak * 1e9:.2f} nC')
    page.row('charge behind deflection', 'graph', f'{math.degrees(loop.lag):.1f} degrees')
    page.row('width of the loop over the range', 'graph', f'{loop.height:.0%}')
    page.claim(loop.lag > 0.0,
               f'The charge follows the deflection with a lag, here {math.degrees(loop.lag):.1f} '
               f'degrees of the cycle, and draws a loop that is {loop.height:.0%} of the range '
               'wide.', 'The charge does not lag behind the deflection.')
    page.cannot(SCALED.format(unit='nC'))
    page.cannot(NO_DATA)
    page.cannot('A(8b) needs half the end stroke for each half film, so the film is given '
                'delta = Delta / 2L where the paper prints Delta / L.')
    return page


def rate_page(found: RateIndependence) -> Section:
    """Return the words for Fig. 6."""
    page = Section('paper_a_fig_6', 'Paper A, Fig. 6: loops and peaks over frequency')
    low, high = FREQUENCIES[0], FREQUENCIES[-1]
    page.row('(a) 5 against 10 Hz: rms difference', 'one pattern (graph)',
             f'{found.difference:.2f} of its standard error')
    page.row(f'(b) range of the peaks, {low:.0f} to {high:.0f} Hz', 'constant (graph)',
             f'{found.spread:.1%} of the mean')
    page.row('(b) change per decade of frequency', 'none',
             f'{found.slope:+.2%} ± {found.slope_sigma:.2%}')
    page.claim(found.difference < SIGNIFICANT,
               'The loops at 5 and 10 Hz differ by no more than the noise of the bench.',
               'The loops at 5 and 10 Hz differ by more than the noise of the bench.')
    page.claim(abs(found.slope) < max(FLAT, SIGNIFICANT * found.slope_sigma),
               f'The peaks are flat from {low:.0f} to {high:.0f} Hz: they change by '
               f'{found.slope:+.2%} ± {found.slope_sigma:.2%} per decade, as a rate-independent '
               'operator says.',
               f'The peaks change by {found.slope:+.2%} per decade of frequency.')
    page.cannot('The agreement is built in: film and operator of the bench know no rate, and '
                'only the corners of its charge amplifier and its noise could show one. It says '
                'that the chain of instruments keeps it, not that a real film does.')
    page.cannot(SCALED.format(unit='nC and pC'))
    page.cannot('With the printed delta = Delta / L the 16 mm of (a) would bring the clamps of '
                'the 32 mm film together (delta = 1); by A(8b) delta is Delta / 2L = 0.5.')
    return page


def amplitude_page(found: Proportionality) -> Section:
    """Return the words for Fig. 7."""
    page = Section('paper_a_fig_7', 'Paper A, Fig. 7: peaks over amplitude at 2 Hz')
    rise, sigma = found.rise
    first, last = found.amplitude[[0, -1]] * 1e3
    excess = found.models['printed'][-1] / found.models['exact'][-1] - 1.0
    page.row('straight line through the peaks, R^2', 'proportional (graph)',
             f'{found.determination:.3f}')
    page.row('exact curve off its straight line, most', '-',
             f'{found.curvature:.1%} of the largest peak')
    page.row(f'charge per amplitude, {last:.1f} against {first:.2f} mm', 'the same',
             f'{rise:+.1%} ± {sigma:.1%} (exact {found.exact_rise():+.1%})')
    page.claim(found.determination > LINE,
               f'The peaks lie near a straight line: it explains '
               f'{found.determination:.1%} of their variance, and the exact curve is nowhere more '
               f'than {found.curvature:.1%} of the largest peak below its own line.',
               'A straight line does not describe the peaks.')
    page.claim(abs(rise - found.exact_rise()) < SIGNIFICANT * sigma,
               f'The bench shows the exact curvature: charge per amplitude rises by {rise:.0%} ± '
               f'{sigma:.0%}, the models without noise say {found.exact_rise():.0%}.',
               'The bench does not show the curvature of the exact models.')
    page.cannot('The paper calls the peaks proportional, and that they are for small strokes '
                f'only: charge per amplitude rises by {found.exact_rise(0.5):.0%} up to a quarter '
                f'of the film and by {found.exact_rise():.0%} up to half of it. There the exact '
                f'charge is {found.elastica_rise:.0%} beyond A(16), and hysteresis alone makes '
                f'the loop {found.loop_rise:.0%} steeper; A(15) as printed, with -1/2 '
                f'for -7/32 in its second order, ends {excess:.0%} above the exact peak.')
    page.cannot('The amplitudes of the paper are not given as numbers; here they end where the '
                'range is half the film, which the paper states for all its experiments. '
                + SCALED.format(unit='pC'))
    return page


def fit_page(found: Identification) -> Section:
    """Return the words for Fig. 8."""
    page = Section('paper_a_fig_8', 'Paper A, Fig. 8: measured and estimated loops')
    told = found.first
    page.row('film and motion', '25 x 3 mm, 110 um; 5 Hz, 6 mm', 'the same')
    page.row('estimate forgets its start after', 'the first few cycles',
             f'{told.settled:.2f} s = {told.settled * FREQUENCY:.1f} cycles')
    page.row('rms of measured minus estimated, then', 'graph', f'{told.rms * 1e9:.3f} nC')
    page.claim(told.settled > 0.0,
               f'From a zero initial condition the estimate starts off the loop and joins it '
               f'within {told.settled * FREQUENCY:.1f} cycles.',
               'The estimate is on the loop from the start.')
    page.claim(told.determination > 0.99,
               'From then on measured and estimated loop lie on each other.',
               'The estimated loop differs from the measured one.')
    page.cannot('The measured loop is that of a simulated film that obeys the same law, so the '
                'fit must be good; the pointed tip where the stage pulled the real film taut is '
                'missing, because the elastica model ends at the flat film.')
    if found.touches:
        page.cannot(f'With the printed delta = Delta / L this motion reaches delta = '
                    f'{found.printed_stroke:.2f}, beyond {TOUCHING_STROKE:.3f}, where a film '
                    'touches itself; Delta / 2L is half of it.')
    return page


def comparison_page(found: Identification) -> Section:
    """Return the words for Fig. 9."""
    page = Section('paper_a_fig_9', 'Paper A, Fig. 9: measured against estimated charge')
    told = found.first
    page.row('slope of measured over estimated', '1', f'{told.slope:.4f}')
    page.row('R^2', 'graph', f'{told.determination:.4f}')
    page.claim(abs(told.slope - 1.0) < 0.01,
               f'Measured over estimated charge is a straight line with slope {told.slope:.3f} '
               f'and R^2 = {told.determination:.4f}.',
               f'The slope is {told.slope:.3f} and not 1.')
    page.cannot('The scatter is only the noise of simulated instruments (its size is assumed), '
                'and the sharp positive peak of a pulled film is missing, see Fig. 8. The '
                'charge of the bench is shown without the zero and the slow drift of its '
                'amplifier.')
    return page


def table_page(found: Identification) -> Section:
    """Return the words for Table I."""
    page = Section('paper_a_table_1', 'Paper A, Table I: identified parameters')
    alpha, a, b = found.constants(0)
    first = found.estimates[0]
    for name, symbol, unit, scale in (
            ('alpha_gain', 'alpha K', '', 1.0), ('a_gain', 'a K', ' nC', 1e9),
            ('b_gain', 'b K', ' nC', 1e9)):
        page.row(symbol, f'{found.true[name] * scale:.3f}{unit}',
                 f'{first[name].value * scale:.3f} ± {first[name].sigma * scale:.3f}{unit}')
    page.row(f'alpha for K = {TABLE_I_GAIN * 1e9:.2f} nC', f'{TABLE_I.alpha * 1e-9:.2f} /nC',
             f'{alpha * 1e-9:.4f} /nC')
    page.row('a, b for the same K', f'{TABLE_I.a}, {TABLE_I.b}', f'{a:.4f}, {b:.4f}')
    page.row('K from geometry, A(15)', '-', f'{found.geometric_gain * 1e9:.2f} nC')
    pulls = np.abs(found.pulls)
    shares = {sigmas: float(np.mean(pulls < sigmas)) for sigmas in EXPECTED}
    page.claim(float(pulls.max()) < SIGNIFICANT,
               f'All {len(found.estimates)} noisy recordings give the products back within their '
               f'error bars: {shares[1]:.0%} of the {pulls.size} values within one sigma '
               f'(expected {EXPECTED[1]:.0%}), {shares[2]:.0%} within two '
               f'({EXPECTED[2]:.0%}), the worst at {pulls.max():.1f}.',
               f'An error bar fails: a product is {pulls.max():.1f} sigma off.')
    page.cannot('Only products can be told: (alpha, a, b, K) and (c alpha, c a, c b, K / c) give '
                'the same charge. The single constants above rest on the K that is put in.')
    page.cannot(f'K = {TABLE_I_GAIN * 1e9:.2f} nC is a fitted gain: geometry and usual PVDF '
                f'constants give {found.geometric_gain * 1e9:.2f} nC, '
                f'{TABLE_I_GAIN / found.geometric_gain:.0f} times less. The model does not '
                'explain the difference.')
    return page
