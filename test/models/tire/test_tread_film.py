"""Film in the tread: exact integral, exact peak, and the shape of a passage."""

import numpy as np
import pytest
from scipy.integrate import quad
from smart_tire.models.tire import brush_tire, tread_film

L, FILM = 0.046, 0.020  # m, paper B, Table I
CRITICAL = 3.0 * 0.47 * 26.7 / 52.7
PASSAGE = {'film_length': FILM, 'contact_length': L, 'bending_peak': 0.83, 'bending_alpha': 67.0,
           'stretch_gain': 307.5, 'critical_slip': CRITICAL}


def adhesion(total_slip, critical=CRITICAL):
    return max(0.0, 1.0 - total_slip / critical) * L


def by_quadrature(x, slip, total, critical, film):
    def displacement(zeta):
        return min(total * zeta, critical * zeta * (1.0 - zeta / L)) * slip / total / L
    low, high, edge = max(x, 0.0), min(x + film, L), adhesion(total, critical)
    if high <= low:
        return 0.0
    return quad(displacement, low, high, points=[edge] if low < edge < high else None,
                epsabs=1e-13)[0]


@pytest.mark.parametrize('film', [FILM, 0.045, 0.07])
def test_the_stretch_integral_is_exact_wherever_the_film_is(film):
    rng = np.random.default_rng(3)
    for _ in range(100):
        critical = rng.uniform(0.05, 1.0)
        total = rng.uniform(0.01, 1.5) * critical
        slip, x = rng.uniform(-total, total), rng.uniform(-film - 0.01, L + 0.01)
        exact = tread_film.stretch_integral(x, slip, total, critical, film, L)
        assert float(exact) == pytest.approx(by_quadrature(x, slip, total, critical, film),
                                             abs=1e-12)


def test_without_a_limit_nothing_slides_and_without_slip_nothing_is_stretched():
    free = tread_film.stretch_integral(0.01, 0.2, 0.2, np.inf, FILM, L)
    assert float(free) == pytest.approx(0.2 * (0.03**2 - 0.01**2) / (2.0 * L))
    assert tread_film.stretch_integral(0.01, 0.0, 0.0, CRITICAL, FILM, L) == 0.0
    assert tread_film.stretch_integral(0.01, 0.0, 0.3, CRITICAL, FILM, L) == 0.0


def test_above_the_critical_slip_more_slip_changes_nothing():
    x = np.linspace(-FILM, L, 50)
    some = tread_film.stretch_integral(x, CRITICAL, CRITICAL, CRITICAL, FILM, L)
    more = tread_film.stretch_integral(x, 9.0, 9.0, CRITICAL, FILM, L)
    np.testing.assert_allclose(more, some, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize('share', [0.01, 0.1, 0.3, 0.5, 0.7, 0.72, 0.95, 1.5])
def test_the_charge_peaks_at_the_peak_position(share):
    total = share * CRITICAL
    x_m = float(tread_film.peak_position(adhesion(total), FILM, L))
    near = x_m + np.array([-1e-4, 0.0, 1e-4])
    left, top, right = tread_film.stretch_integral(near, total, total, CRITICAL, FILM, L)
    assert top > left and top > right
    x = np.linspace(-FILM, L, 2001)
    assert tread_film.stretch_integral(x, total, total, CRITICAL, FILM, L).max() <= top


def test_adhesion_length_and_peak_position_are_inverse_where_the_peak_tells():
    lengths = np.linspace(0.5 * (L - FILM) + 1e-6, L, 200)
    peaks = tread_film.peak_position(lengths, FILM, L)
    assert np.all(np.diff(peaks) > 0.0)
    np.testing.assert_allclose(tread_film.adhesion_length(peaks, FILM, L), lengths, rtol=1e-9)


def test_where_the_film_slides_at_its_peak_the_peak_tells_nothing():
    peaks = tread_film.peak_position([0.0, 0.005, 0.5 * (L - FILM)], FILM, L)
    np.testing.assert_array_equal(peaks, 0.5 * (L - FILM))
    assert np.isnan(tread_film.adhesion_length(peaks, FILM, L)).all()
    assert np.isnan(tread_film.adhesion_length(np.nan, FILM, L))


def test_the_printed_map_makes_friction_about_twice_too_high():
    slip = np.array([0.05, 0.1, 0.2, 0.3])
    ratio = brush_tire.adhesion_ratio(slip, 0.47, 26.7, 52.7)
    x_m = tread_film.peak_position(ratio * L, FILM, L)
    for method, low, high in (('exact', 0.9999, 1.0001), ('printed', 1.8, 2.3)):
        found = tread_film.adhesion_length(x_m, FILM, L, method) / L
        factor = brush_tire.friction_from_adhesion(found, slip, 26.7, 52.7) / 0.47
        assert np.all((low < factor) & (factor < high)), (method, factor)


def test_a_film_longer_than_the_patch_and_an_unknown_method_are_refused():
    with pytest.raises(ValueError, match='no peak'):
        tread_film.peak_position(0.04, 0.05, L)
    with pytest.raises(ValueError, match='guess'):
        tread_film.adhesion_length(0.02, FILM, L, 'guess')
    with pytest.raises(ValueError, match='fig9'):
        tread_film.passage(0.0, slip=0.1, total_slip=0.1, release='fig9', **PASSAGE)


@pytest.mark.parametrize('alpha', [1e-3, 1.0, 67.0, 5e3])
def test_the_bending_shape_rises_from_zero_to_one(alpha):
    shape = tread_film.bending_shape(np.linspace(-0.01, FILM + 0.01, 301), FILM, alpha)
    assert shape[0] == 0.0 and shape[-1] == 1.0 and np.all(np.diff(shape) >= 0.0)


def test_the_bending_shape_is_b15_and_its_limit_for_a_stiff_tread_a_cube():
    u = np.linspace(0.002, FILM, 50)
    grown, whole = np.exp(67.0 * u), FILM - 2.0 / 67.0 * np.tanh(0.5 * 67.0 * FILM)
    printed = u - 2.0 / 67.0 * (grown - 1.0) / (grown + 1.0)
    np.testing.assert_allclose(tread_film.bending_shape(u, FILM, 67.0), printed / whole,
                               rtol=1e-9)
    np.testing.assert_allclose(tread_film.bending_shape(u, FILM, 0.01), (u / FILM)**3, rtol=1e-7)


@pytest.mark.parametrize('release', ['fig8', 'state'])
@pytest.mark.parametrize('film', [FILM, 0.07])
@pytest.mark.parametrize('slip, total', [(0.1, 0.13), (-0.2, 0.25), (0.9, 1.2)])
def test_a_passage_is_continuous_and_starts_and_ends_at_rest(release, film, slip, total):
    x = np.linspace(-film - 0.02, L + 0.1, 200_001)
    volts = tread_film.passage(x, slip=slip, total_slip=total, release=release,
                               **{**PASSAGE, 'film_length': film})
    assert np.abs(np.diff(volts)).max() < 1e-3
    assert volts[0] == 0.0 and abs(volts[-1]) < 1e-6


def test_the_releases_differ_after_the_film_begins_to_leave_only():
    x = np.linspace(-FILM, L - FILM, 100)
    both = [tread_film.passage(x, slip=0.1, total_slip=0.1, release=name, **PASSAGE)
            for name in ('fig8', 'state')]
    np.testing.assert_allclose(both[0], both[1], atol=1e-15)
    at_release = [float(tread_film.passage(L, slip=0.1, total_slip=0.1, release=name, **PASSAGE))
                  for name in ('fig8', 'state')]
    assert at_release == pytest.approx([-0.83, 0.0])


def test_a_fully_flat_film_without_slip_shows_the_bending_peak():
    x = np.linspace(0.0, L - FILM, 10)
    volts = tread_film.passage(x, slip=0.0, total_slip=0.0, **PASSAGE)
    np.testing.assert_allclose(volts, 0.83)


def test_reverse_mirrors_the_place_and_so_repeats_the_signal_in_time():
    x = np.linspace(-0.05, 0.09, 300)
    options = {'slip': 0.1, 'total_slip': 0.12, **PASSAGE}
    back = tread_film.passage(L - FILM - x, reverse=True, **options)
    np.testing.assert_allclose(back, tread_film.passage(x, **options), atol=1e-12)


def test_bumps_stand_a_centimetre_outside_and_end_where_the_contact_begins():
    x = np.linspace(-0.06, 0.09, 1501)
    bumps = tread_film.contact_bumps(x, FILM, L)
    assert np.all(bumps[(x >= -FILM) & (x <= L)] == 0.0)
    before = x < 0.0
    assert x[before][bumps[before].argmax()] == pytest.approx(-FILM - 0.01, abs=1e-4)
    assert x[~before][bumps[~before].argmax()] == pytest.approx(L + 0.01, abs=1e-4)
    assert bumps.max() == pytest.approx(1.0, abs=1e-3) and bumps.min() >= 0.0
