"""The bench of the models: its two ways must solve the same problem, whatever time they take."""

import pytest
from benchmarks import models


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    for name, value in (('BUDGET', 0.0), ('PERIODS', 2), ('FILMS', 6), ('BVP_FILMS', 3),
                        ('PASSAGES', 2)):
        monkeypatch.setattr(models, name, value)


@pytest.mark.parametrize('measure, agree', [
    ('duhem', 1e-3), ('weightless_film', 1e-6), ('heavy_film', 1e-6), ('passages', 1e-12)])
def test_both_ways_come_to_the_same_result(measure, agree):
    for figure in getattr(models, measure)():
        assert figure.difference < agree, figure
        assert figure.rate > 0.0 and figure.general_rate > 0.0


def test_one_line_is_printed_for_each_figure(capsys):
    assert models.main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    for what in ('Duhem samples', 'elastica, charges', 'heavy elastica, solutions',
                 'heavy elastica, one by one', 'film passages of 93 samples', 'at once'):
        assert sum(what in line and ' times, ' in line for line in lines) == 1, what
