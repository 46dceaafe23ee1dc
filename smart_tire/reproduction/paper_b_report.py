"""What paper B's figures show, and what of it is found again; all numbers from the records."""

from __future__ import annotations

import numpy as np

from smart_tire.analysis.metrics import SlipScore
from smart_tire.reproduction import tire_maps
from smart_tire.reproduction.report_section import Section
from smart_tire.reproduction.tire_maps import (
    CRITICAL, LEAST_SLIP, MU, Outline, OUTLINE_SLIP, Signals, SLIPS, STIFFNESS, Sweep, WAYS)
from smart_tire.reproduction.tire_runs import ROBOT, StiffnessFit

SIMULATED = ('The robot is simulated: its track, wheelbase, inertia, centre of mass, motors and '
             'the ground beyond mu and C_x are chosen, because the paper gives none, so the '
             "slips have the paper's pattern and not its values.")
CALIBRATED = ('Volts per charge are a chosen calibration: the paper found its own too badly '
              'known to use, so heights in volts can not be compared.')
CLOSE_TO_ZERO = 0.05  # slip that is still close to it
CLOSE = 0.03          # slip, rms error of an estimate that follows the truth
LINE = 0.95           # R^2 that passes for a straight line on a graph
ALIKE = 0.1           # relative
PAPER_STIFFNESS, PAPER_FRICTION = 52.7, 0.47  # N, -: Table I


def outline_page(found: Outline) -> Section:
    """Return the words for Fig. 8."""
    page = Section('paper_b_fig_8', 'Paper B, Fig. 8: one passage of a film')
    read, state = found.read_height('fig8'), found.read_height('state')
    dropped = 1e3 * tire_maps.OUTLINE_SPEED * (found.printed_interval - found.interval)
    shift = 1e3 * (tire_maps.OUTLINE_SPEED * found.interval - tire_maps.LENGTH)
    page.row('slip, wheel speed', 'schematic', f'{OUTLINE_SLIP}, 60 rpm')
    page.row('time in the patch', 'L / r w', f'{found.whole * 1e3:.1f} ms')
    page.row('peak to release', '(l + L - L_a) / r w',
             f'{found.printed_interval * 1e3:.1f} ms printed, {found.interval * 1e3:.1f} ms exact')
    page.row('q_sm', 'B(25)',
             f'{found.printed_height:.3f} V printed, {found.height:.3f} V exact')
    page.claim(abs(read / found.height - 1.0) < 0.01,
               f"With the release as drawn, the difference of the two peaks' magnitudes is q_sm "
               f'({read:.3f} V of {found.height:.3f} V).',
               f"The difference of the two peaks' magnitudes is {read:.3f} V and not q_sm.")
    late = 1e3 * (found.printed_interval - found.interval)
    page.cannot(f'The stretch charge is largest {late:.1f} '
                f'ms later than the paper says: x_m = L_a - l is {dropped:.1f} mm short, where '
                f'sliding moves the peak by no more than {shift:.1f} mm in all. B(25) is also '
                f'{1.0 - found.printed_height / found.height:.0%} low at this slip.')
    page.cannot('The opposite peak at release is drawn and not derived. A charge that is a state '
                f'comes back to rest, and the same reading then gives {state:.2f} V, '
                f'{state / found.height:.1f} times q_sm.')
    page.cannot(CALIBRATED)
    return page


def slip_page(found: dict[str, dict[str, SlipScore]]) -> Section:
    """Return the words for Fig. 10."""
    page = Section('paper_b_fig_10', 'Paper B, Fig. 10: slips at 120/60 rpm on concrete and sand')
    for ground, sides in found.items():
        for side, told in sides.items():
            page.row(f'{ground}, {side} side', 'graph',
                     f'{told.estimated_mean:+.3f}, truth {told.true_mean:+.3f}, rms error '
                     f'{told.error.rms:.3f}')
    sand, right = found['sand'], found['concrete']['right'].estimated_mean
    both = [sand[side].estimated_mean for side in ('left', 'right')]
    worst = max(told.error.rms for sides in found.values() for told in sides.values())
    page.claim(min(both) > 0.0,
               f'On sand both sides slip forward ({both[0]:+.2f} and {both[1]:+.2f}).',
               'On sand not both sides slip forward.')
    page.claim(right < 0.0, f'On concrete the slip of the right, slower side is negative '
               f'({right:+.2f}).', 'On concrete the slip of the right side is not negative.')
    page.claim(worst < CLOSE,
               f'Estimates follow the truth, with rms errors up to {worst:.3f}.',
               f'Estimates stray from the truth by up to {worst:.3f} rms.')
    page.claim(abs(right) < CLOSE_TO_ZERO, 'It is close to zero, as in the paper.',
               f"The paper calls the right side's slip on concrete close to zero; here it is "
               f'{right:+.2f}. It follows from track, wheelbase and centre of mass, which are '
               'not in the paper.')
    page.cannot('Ground truth of the simulation stands for the overhead camera, with none of its '
                'errors. ' + SIMULATED)
    return page


def signal_page(found: Signals) -> Section:
    """Return the words for Fig. 11."""
    page = Section('paper_b_fig_11', "Paper B, Fig. 11: the films' signals at 60/80 rpm")
    one, two = found.variation
    mean = found.peaks.mean(axis=0)
    page.row('highest voltage above rest, films 1 and 2', 'graph',
             f'{mean[0]:.2f} V and {mean[1]:.2f} V on average')
    page.row('its range from cycle to cycle', 'varies (graph)', f'{one:.0%} and {two:.0%}')
    page.row('film 2 behind film 1', '30 mm on the wheel',
             f'{found.lag * 1e3:.1f} ms ({found.expected_lag * 1e3:.1f} ms for 30 mm)')
    page.row('bump before the contact', 'graph', f'{found.bump * 1e3:.0f} mV of opposite sign')
    page.claim(min(one, two) > ALIKE,
               f'The peaks vary from one cycle to another (by {one:.0%} and {two:.0%} of their '
               'mean) and the films differ in size.', 'The peaks hardly vary.')
    page.claim(found.bump > 0.0, 'One cycle shows the pattern of Fig. 8 with a bump of the '
               'opposite sign before and after the contact.', 'There is no bump.')
    page.claim(abs(found.lag / found.expected_lag - 1.0) < ALIKE,
               'The second film repeats the first after the travel between them.',
               'The delay between the films is not that of the travel between them.')
    page.cannot("Variation and bumps are put into the simulation with sizes read off the paper's "
                'graph; no theory gives them. ' + CALIBRATED)
    return page


def stretch_page(found: Sweep) -> Section:
    """Return the words for Fig. 12."""
    page = Section('paper_b_fig_12', 'Paper B, Fig. 12: stretch charge over slip')
    told = found.passages
    for speed, line in found.lines.items():
        page.row(f'{speed:.0f} rpm: slope of q_sm over slip', 'graph',
                 f'{line.slope:.2f} V per unit slip, R^2 {line.determination:.3f}')
    off = told.raw_stretch - told.stretch
    bias, scatter = float(np.nanmean(off)), float(np.nanstd(off))
    low = [float(1.0 - tire_maps.printed_stretch(slip) / tire_maps.highest_stretch(slip))
           for slip in (0.1, 0.3)]
    slopes = [line.slope for line in found.lines.values()]
    page.row('raw samples against fitted waveform', '-',
             f'{bias * 1e3:+.0f} mV on average, scatter {scatter * 1e3:.0f} mV')
    page.row('B(25) below the exact q_sm at slip 0.1 and 0.3', '-',
             f'{low[0]:.0%} and {low[1]:.0%}')
    height = float(np.nanmedian((told.stretch / told.true_stretch)[
        told.true_total_slip > LEAST_SLIP]))
    page.row('fitted waveform over the exact q_sm of its combined slip', '-',
             f'{height:.3f} (median)')
    worst = min(line.determination for line in found.lines.values())
    page.claim(worst > LINE,
               f'The charge grows almost along a line with the slip (R^2 at least {worst:.3f}).',
               f'The charge is no line over the slip (R^2 {worst:.3f}).')
    page.claim(max(slopes) / min(slopes) - 1.0 < ALIKE,
               'Both wheel speeds give the same line within '
               f'{max(slopes) / min(slopes) - 1.0:.0%}.',
               'The wheel speeds give different lines.')
    page.claim(abs(bias) < 0.01, 'Raw samples give the same as the fitted waveform.',
               f'Read off raw samples as in the paper, q_sm comes out {bias * 1e3:+.0f} mV off on '
               f'average with a scatter of {scatter * 1e3:.0f} mV: 400 Hz misses the sharp '
               'minimum.')
    page.cannot('The points lie below the exact curve of the figure, which is for slip straight '
                'ahead: in these turns the wheels slip sideways as well. Their own exact value '
                f'they meet: {height:.3f} of it.')
    page.cannot(f'{len(found.braking)} passages with negative slip are left out: two peaks exist '
                'in traction only. ' + CALIBRATED)
    return page


def adhesion_page(found: Sweep) -> Section:
    """Return the words for Fig. 13."""
    page = Section('paper_b_fig_13', 'Paper B, Fig. 13: adhesion ratio over slip')
    exact, printed, paper = (found.slopes[way] for way in WAYS)
    excess = tire_maps.printed_excess(SLIPS)
    page.row('slope of B(22)', 'small, negative', f'{-1.0 / CRITICAL:.2f} per unit slip')
    page.row('slope, exact map', '-', f'{exact.slope:.2f}')
    page.row('slope, printed map of the same peaks', '-', f'{printed.slope:.2f}')
    page.row('slope, raw peaks and printed map', 'almost constant (graph)',
             f'{paper.slope:.2f}, R^2 {paper.determination:.2f}')
    page.row('mu by the printed map over the true one, no noise', '-',
             f'{excess.min():.1f} to {excess.max():.1f}')
    page.claim(abs(paper.slope) < 0.6 / CRITICAL,
               f'Read as in the paper, the ratio falls only {abs(paper.slope) * CRITICAL:.0%} as '
               'fast as B(22) says, and scatters: almost constant, as the paper found.',
               'Read as in the paper, the ratio falls as B(22) says.')
    page.claim(abs(exact.slope * CRITICAL + 1.0) < ALIKE,
               f'The exact map of the same peaks follows B(22): slope {exact.slope:.2f} for '
               f'{-1.0 / CRITICAL:.2f}.',
               f'The exact map does not follow B(22): {exact.slope:.2f}.')
    page.cannot('So it is not only scatter and sampling that flatten Fig. 13, as the paper '
                f'thinks: L_a = L + l - r w dt_a itself does, and makes mu {excess.min():.1f} to '
                f'{excess.max():.1f} times too large at slips up to {SLIPS[-1]:.1f} without any '
                'noise.')
    page.cannot(f'Slopes, and mu in Table I, leave out total slips below {LEAST_SLIP}: there '
                'hardly anything slides, and a passage says little of where the peak is.')
    page.cannot('In a turn a wheel also slips sideways; the adhesion length follows the total '
                'slip (right panel), which the paper does not have. ' + SIMULATED)
    return page


def table_page(found: Sweep, fit: StiffnessFit) -> Section:
    """Return the words for Table I."""
    page = Section('paper_b_table_1', 'Paper B, Table I: stiffness and friction')
    tire, film = ROBOT.tire, ROBOT.film
    for name, paper, here in (('l', 20, film.length), ('b', 3, film.width),
                              ('B', 89, tire.contact_width), ('L', 46, tire.contact_length),
                              ('r', 87, ROBOT.wheel_radius)):
        page.row(f'{name} [mm], put in', f'{paper}', f'{here * 1e3:.0f}')
    page.row('mass [kg], put in', '10.9', f'{ROBOT.mass}')
    page.row('C_x from accelerations', f'{PAPER_STIFFNESS} N',
             f'{fit.stiffness:.1f} ± {fit.sigma:.1f} N (put in: {STIFFNESS} N)')
    median = {way: float(np.nanmedian(found.friction[way])) for way in WAYS}
    labels = ('mu, exact map and total slip', 'mu, printed map and total slip',
              'mu as in the paper: raw peaks, longitudinal slip')
    for way, label in zip(WAYS, labels):
        low, high = np.nanpercentile(found.friction[way], [16, 84])
        page.row(label, f'{PAPER_FRICTION}' if way == 'paper' else '-',
                 f'median {median[way]:.2f}, 68 % of them {low:.2f} to {high:.2f} (put in: {MU})')
    per_speed = [float(np.nanmedian(found.friction['paper'][found.passages.speed == speed]))
                 for speed in found.lines]
    page.claim(abs(fit.stiffness / STIFFNESS - 1.0) < ALIKE,
               f'C_x comes back from the accelerations of a straight run within '
               f'{abs(fit.stiffness / STIFFNESS - 1.0):.1%}.', 'C_x does not come back.')
    page.claim(abs(median['exact'] / MU - 1.0) < ALIKE,
               f'mu comes back with the exact map: {median["exact"]:.2f} for {MU}.',
               f'mu does not come back: {median["exact"]:.2f} for {MU}.')
    page.claim(abs(per_speed[0] / per_speed[1] - 1.0) < 2.0 * ALIKE,
               f'As in the paper, its way gives similar values at both wheel speeds '
               f'({per_speed[0]:.2f} and {per_speed[1]:.2f}).',
               f"The paper's way gives different values at the two wheel speeds "
               f'({per_speed[0]:.2f} and {per_speed[1]:.2f}).')
    page.cannot(f'That both speeds agree proves little: the printed map gives '
                f'{median["printed"] / MU:.1f} times the true mu from the best peaks, and from '
                f'raw peaks and longitudinal slip {median["paper"] / MU:.1f} times (the missing '
                "lateral slip makes up for a part). If the paper's data behaved like these, its "
                f'{PAPER_FRICTION} would stand for about '
                f'{PAPER_FRICTION * MU / median["paper"]:.2f}.')
    page.claim(abs(fit.stiffness - STIFFNESS) < 3.0 * fit.sigma, 'The error of C_x is within its '
               'error bars.', 'The error of C_x is larger than its scatter tells: the simulation '
               'steps by a millisecond, and the true slip is read at the end of a step whose '
               'force came from its begin.')
    return page
