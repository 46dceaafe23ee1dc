"""The parts of a passage: together the passage of ``tread_film``, and slopes that are slopes."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.models.tire import crossing_jacobian, tread_film

L, FILM, ALPHA = 0.046, 0.020, 67.0
STEP = 1e-7


def places(film=FILM):
    """Return places around the whole passage, none of them at a kink."""
    return np.linspace(-film - 0.0313, L + 0.0417, 400)


@pytest.mark.parametrize('release', ['fig8', 'state'])
@pytest.mark.parametrize('film', [FILM, 0.06])
@pytest.mark.parametrize('alpha', [67.0, 1e-3, 500.0])
def test_the_bending_part_is_that_of_the_passage(release, film, alpha):
    x = places(film)
    part = crossing_jacobian.bending(x, film, L, alpha, release)
    whole = tread_film.bending_passage(x, film, L, alpha, release)
    np.testing.assert_allclose(part.value, whole, atol=1e-10)


@pytest.mark.parametrize('film', [FILM, 0.06])
@pytest.mark.parametrize('sliding', [0.02, 0.3, 0.72, 0.999, 1.0, 1.6])
def test_the_stretch_part_is_that_of_the_passage_for_a_slip_of_one(film, sliding):
    x = places(film)
    whole = tread_film.stretch_integral(x, 0.1, 0.1, 0.1 / sliding, film, L) / 0.1
    part = crossing_jacobian.stretch(x, sliding, film, L)
    np.testing.assert_allclose(part.value, whole, atol=1e-15)


def test_the_bumps_are_those_of_the_passage():
    x = places()
    part, behind = crossing_jacobian.bumps(x, FILM, L)
    np.testing.assert_allclose(part.value, tread_film.contact_bumps(x, FILM, L), atol=1e-15)
    assert np.all(behind == (x > 0.5 * (L - FILM)))


def slope(function, at):
    """Return the slope of an array-valued ``function`` by central differences."""
    return (function(at + STEP) - function(at - STEP)) / (2.0 * STEP)


@pytest.mark.parametrize('release', ['fig8', 'state'])
@pytest.mark.parametrize('film', [FILM, 0.06])
def test_the_slopes_of_the_bending_are_its_slopes(release, film):
    x = places(film)

    def value(x=x, length=L, alpha=ALPHA, recovery=0.005):
        return crossing_jacobian.bending(x, film, length, alpha, release, recovery).value

    part = crossing_jacobian.bending(x, film, L, ALPHA, release, 0.005)
    close = {'rtol': 1e-5, 'atol': 1e-4}
    np.testing.assert_allclose(part.by_place, slope(lambda x: value(x=x), x), **close)
    np.testing.assert_allclose(part.by_length, slope(lambda v: value(length=v), L), **close)
    np.testing.assert_allclose(part.by_recovery, slope(lambda v: value(recovery=v), 0.005),
                               **close)
    np.testing.assert_allclose(part.by_alpha, slope(lambda v: value(alpha=v), ALPHA), atol=1e-7)


@pytest.mark.parametrize('film', [FILM, 0.06])
@pytest.mark.parametrize('sliding', [0.05, 0.3, 0.72, 0.97, 1.6])
def test_the_slopes_of_the_stretch_are_its_slopes(film, sliding):
    x = places(film)

    def value(x=x, length=L, sliding=sliding):
        return crossing_jacobian.stretch(x, sliding, film, length).value

    part = crossing_jacobian.stretch(x, sliding, film, L)
    np.testing.assert_allclose(part.by_place, slope(lambda x: value(x=x), x), atol=2e-6)
    np.testing.assert_allclose(part.by_length, slope(lambda v: value(length=v), L), atol=2e-6)
    np.testing.assert_allclose(part.by_sliding, slope(lambda v: value(sliding=v), sliding),
                               atol=1e-8)


def test_the_slopes_of_the_bumps_are_their_slopes():
    x = places()
    part, _ = crossing_jacobian.bumps(x, FILM, L)
    by_place = slope(lambda x: crossing_jacobian.bumps(x, FILM, L)[0].value, x)
    by_length = slope(lambda v: crossing_jacobian.bumps(x, FILM, v)[0].value, L)
    np.testing.assert_allclose(part.by_place, by_place, atol=2e-3)
    np.testing.assert_allclose(part.by_length, by_length, atol=2e-3)


def test_where_all_slides_only_slip_over_sliding_shows():
    x = places()
    one, other = (crossing_jacobian.stretch(x, w, FILM, L) for w in (1.2, 2.4))
    np.testing.assert_allclose(one.value, 2.0 * other.value, atol=1e-15)
    np.testing.assert_allclose(one.by_sliding, -one.value / 1.2, atol=1e-15)


def test_an_unknown_release_is_refused():
    with pytest.raises(ValueError, match='fig9'):
        crossing_jacobian.bending(places(), FILM, L, ALPHA, 'fig9')
