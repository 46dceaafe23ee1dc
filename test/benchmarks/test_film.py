"""The bench's table of measuring with a film: every cell is there, and honest."""

from __future__ import annotations

import re

from benchmarks import film


def test_each_size_and_frequency_has_an_error_and_its_share_of_sigma(capsys, monkeypatch):
    monkeypatch.setattr(film, 'SIZES', (0.002, 0.010))
    monkeypatch.setattr(film, 'FREQUENCIES', (1.0, 5.0))
    film.print_measuring()
    cells = re.findall(r'([0-9.]+) \(([0-9.]+)\)', capsys.readouterr().out)
    assert len(cells) == 4
    assert all(10.0 < float(error) < 100.0 for error, _ in cells)  # um
    assert all(0.4 < float(share) < 1.4 for _, share in cells)
