"""Peak of the stretch charge: B(23) to B(26) against the exact integral, and where they end."""

from hypothesis import assume, given, settings, strategies as st
import numpy as np
import pytest
from scipy.integrate import quad
from smart_tire.models.film.signal_chain import SignalChain
from smart_tire.models.tire import brush_tire, strain_charge, tread_film

C_X, MU, LOAD, L, FILM = 52.7, 0.47, 26.7, 0.046, 0.02  # paper B, Table I
CRITICAL = 3.0 * MU * LOAD / C_X

films = st.floats(0.002, 0.09)
criticals = st.floats(0.05, 1.5)
shares = st.floats(0.01, 1.4)


def adhesion(slip):
    return (1.0 - slip / CRITICAL) * L


@pytest.mark.parametrize('slip', [0.05, 0.1, 0.2, 0.3])
def test_b23_is_the_exact_integral_and_b24_its_derivative(slip):
    stuck = adhesion(slip)
    x = np.linspace(stuck - FILM, L - FILM, 30)
    printed = strain_charge.printed_integral(x, slip, stuck, FILM, L)
    exact = tread_film.stretch_integral(x, slip, slip, CRITICAL, FILM, L)
    np.testing.assert_allclose(printed, exact, rtol=1e-10)
    inner, step = x[1:-1], 1e-7
    ahead, back = (strain_charge.printed_integral(inner + h, slip, stuck, FILM, L)
                   for h in (step, -step))
    slope = strain_charge.printed_slope(inner, slip, stuck, FILM, L)
    np.testing.assert_allclose((ahead - back) / (2.0 * step), slope, atol=1e-6 * slope.max())
    x_m = strain_charge.peak(slip, slip, CRITICAL, FILM, L).position
    root = strain_charge.printed_slope(x_m, slip, stuck, FILM, L)
    assert float(root) == pytest.approx(0.0, abs=1e-12)


@given(films, criticals, shares, st.floats(-1.0, 1.0))
def test_no_place_of_the_film_has_more_charge_than_the_peak(film, critical, share, direction):
    total = share * critical
    slip = direction * total
    peak = strain_charge.peak(slip, total, critical, film, L)
    x = np.linspace(-film, L, 1501)
    q = tread_film.stretch_integral(x, slip, total, critical, film, L)
    assert np.abs(q).max() <= abs(peak.integral) * (1.0 + 1e-9)
    assert np.abs(q).max() >= abs(peak.integral) * (1.0 - 1e-3)
    assert np.sign(peak.integral) == np.sign(slip)


@given(films, criticals, shares, st.floats(0.1, 1.0))
def test_braking_and_driving_peak_at_the_same_place_with_opposite_charge(
        film, critical, share, direction):
    total = share * critical
    ahead = strain_charge.peak(direction * total, total, critical, film, L)
    back = strain_charge.peak(-direction * total, total, critical, film, L)
    assert ahead.position == back.position and ahead.integral == -back.integral
    assert ahead.tells == back.tells


@given(st.floats(0.002, 0.045), criticals, shares)
def test_the_peak_tells_the_adhesion_length_exactly_where_it_says_so(film, critical, share):
    assume(abs((1.0 - share) * L - 0.5 * (L - film)) > 1e-6)
    slip = share * critical
    peak = strain_charge.peak(slip, slip, critical, film, L)
    found = float(tread_film.adhesion_length(peak.position, film, L))
    if peak.tells:
        assert found == pytest.approx((1.0 - share) * L, rel=1e-6)
    else:
        assert np.isnan(found) and (1.0 - share) * L < 0.5 * (L - film)


def test_where_the_peak_tells_nothing_it_stands_still_and_only_its_charge_is_left():
    slip = CRITICAL * np.array([0.72, 0.8, 0.95, 1.0, 2.0])
    peak = strain_charge.peak(slip, slip, CRITICAL, FILM, L)
    assert not peak.tells.any()
    np.testing.assert_array_equal(peak.position, 0.5 * (L - FILM))
    low, high = 0.013, 0.033
    parabola = (high**2 - low**2) / (2.0 * L) - (high**3 - low**3) / (3.0 * L**2)
    np.testing.assert_allclose(peak.integral, CRITICAL * parabola, rtol=1e-9)


def test_without_slip_there_is_no_peak_and_nothing_to_tell():
    for total in (0.0, 0.2):
        peak = strain_charge.peak(0.0, total, CRITICAL, FILM, L)
        assert peak.integral == 0.0 and not peak.tells


@given(st.floats(L, 0.2), shares, st.floats(-1.0, 1.0))
def test_a_film_longer_than_the_patch_feels_the_force(film, share, direction):
    total = share * CRITICAL
    s_x, s_y = direction * total, np.sqrt(max(0.0, 1.0 - direction**2)) * total
    peak = strain_charge.peak(s_x, np.hypot(s_x, s_y), CRITICAL, film, L)
    force, _ = brush_tire.brush_force(s_x, s_y, MU, LOAD, C_X)
    assert float(peak.integral) == pytest.approx(L * float(force) / (2.0 * C_X), rel=1e-9,
                                                 abs=1e-15)
    assert not peak.tells
    edges = tread_film.stretch_integral([L - film, 0.0], s_x, np.hypot(s_x, s_y), CRITICAL, film,
                                        L)
    np.testing.assert_allclose(edges, peak.integral, rtol=1e-9, atol=1e-15)


def test_b25_is_5_percent_low_at_a_slip_of_a_tenth_and_25_at_three():
    slip = np.array([0.1, 0.3])
    exact = strain_charge.peak(slip, slip, CRITICAL, FILM, L)
    printed = strain_charge.peak(slip, slip, CRITICAL, FILM, L, method='printed')
    np.testing.assert_allclose(1.0 - printed.integral / exact.integral, [0.05, 0.25], atol=0.01)
    by_hand = [quad(lambda z, s=s: min(s * z, CRITICAL * z * (1.0 - z / L)) / L, x, x + FILM,
                    points=[adhesion(s)])[0] for s, x in zip(slip, exact.position)]
    np.testing.assert_allclose(exact.integral, by_hand, rtol=1e-9)


def test_b25_is_the_charge_at_the_printed_place_without_what_slides():
    slip = np.array([0.05, 0.1, 0.3])
    stuck = adhesion(slip)
    printed = strain_charge.peak(slip, slip, CRITICAL, FILM, L, method='printed')
    np.testing.assert_allclose(printed.position, stuck - FILM)
    at_place = tread_film.stretch_integral(stuck - FILM, slip, slip, CRITICAL, FILM, L)
    np.testing.assert_allclose(printed.integral, at_place, rtol=1e-9)
    np.testing.assert_allclose(printed.integral / slip, strain_charge.gain(stuck, FILM, L))
    assert printed.tells.all()


def test_the_printed_peak_says_where_it_does_not_hold():
    slip = np.array([-0.1, 0.0, 0.1, 0.5, 0.9])
    peak = strain_charge.peak(slip, slip, CRITICAL, FILM, L, method='printed')
    np.testing.assert_array_equal(peak.tells, [False, False, True, False, False])


def test_the_two_agree_for_a_small_slip():
    exact, printed = (strain_charge.peak(1e-6, 1e-6, CRITICAL, FILM, L, method=method)
                      for method in strain_charge.METHODS)
    assert float(exact.position) == pytest.approx(float(printed.position), rel=1e-5)
    assert float(exact.integral) == pytest.approx(float(printed.integral), rel=1e-5)


def test_the_printed_map_gives_1_8_to_2_2_times_the_friction():
    slip = np.array([0.02, 0.1, 0.2, 0.3])
    x_m = strain_charge.peak(slip, slip, CRITICAL, FILM, L).position
    for method, factor in (('exact', (0.999999, 1.000001)), ('printed', (1.75, 2.25))):
        ratio = tread_film.adhesion_length(x_m, FILM, L, method) / L
        found = brush_tire.friction_from_adhesion(ratio, slip, LOAD, C_X) / MU
        assert np.all((found > factor[0]) & (found < factor[1])), (method, found)


def test_for_a_small_slip_the_printed_map_is_wrong_by_the_share_of_the_film():
    x_m = strain_charge.peak(1e-5, 1e-5, CRITICAL, FILM, L).position
    ratio = tread_film.adhesion_length(x_m, FILM, L, 'printed') / L
    found = brush_tire.friction_from_adhesion(ratio, 1e-5, LOAD, C_X) / MU
    assert float(found) == pytest.approx(L / (L - FILM), rel=1e-4)


def test_constants_of_the_papers_would_clip_the_converter_a_hundred_times_over():
    charge = strain_charge.transfer(0.003, 23e-12, 3e9) * strain_charge.peak(
        0.1, 0.1, CRITICAL, FILM, L).integral
    chain = SignalChain()
    volts = chain.amplified(charge)
    assert 50.0 < float(volts) / chain.rest_voltage < 200.0
    assert chain.saturated(chain.counts(volts))


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=4), criticals)
@settings(max_examples=30)
def test_arrays_are_worked_out_element_by_element(slips, critical):
    whole = strain_charge.peak(np.array(slips)[:, None], 0.1, [critical, np.inf], FILM, L)
    assert whole.integral.shape == whole.position.shape == whole.tells.shape == (len(slips), 2)
    for row, slip in enumerate(slips):
        one = strain_charge.peak(slip, 0.1, critical, FILM, L)
        assert [float(v) for v in one] == pytest.approx([float(v[row, 0]) for v in whole])


@pytest.mark.parametrize('call, message', [
    (lambda: strain_charge.peak(np.nan, 0.1, 1.0, FILM, L), 'slip is nan'),
    (lambda: strain_charge.peak([0.1, 0.2], [0.1] * 3, 1.0, FILM, L),
     r'slip \(2,\), total_slip \(3,\)'),
    (lambda: strain_charge.peak(0.1, 0.1, -1.0, FILM, L), 'critical_slip is -1.0'),
    (lambda: strain_charge.peak(0.1, 0.1, 0.0, FILM, L, method='printed'), 'critical_slip is 0'),
    (lambda: strain_charge.peak(0.1, 0.1, 1.0, -FILM, L), 'film_length is -0.02, expected above'),
    (lambda: strain_charge.peak(0.1, 0.1, 1.0, FILM, np.ones(2)), r'contact_length has shape'),
    (lambda: strain_charge.peak(0.1, 0.1, 1.0, FILM, L, method='guess'), "method is 'guess'"),
    (lambda: strain_charge.printed_integral(0.0, 0.1, 0.04, FILM, L),
     'x is 0.0, where B.23. is not valid: expected 0.02 to 0.026'),
    (lambda: strain_charge.printed_slope(0.01, 0.1, 0.046, FILM, L), 'adhesion_length is 0.046'),
    (lambda: strain_charge.printed_slope(0.01, 0.1, [0.04, 0.05, 0.06], [0.1, 0.2], L),
     r'adhesion_length \(3,\), film_length \(2,\)'),
    (lambda: strain_charge.gain(-0.01, FILM, L), 'adhesion_length is -0.01'),
    (lambda: strain_charge.transfer(0.003, 0.0, 3e9), 'd31 is 0.0')])
def test_what_can_not_be_is_refused_with_its_name_and_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()
