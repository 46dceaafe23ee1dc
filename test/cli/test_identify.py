"""What all kinds of ``smart_tire identify`` share."""

from __future__ import annotations

import argparse
from importlib import import_module

import pytest

from smart_tire.cli import identify


def parsed(*words):
    parser = argparse.ArgumentParser()
    identify.add_arguments(parser)
    return parser.parse_args(words)


@pytest.mark.parametrize('kind', identify.KINDS)
def test_a_kind_is_a_module_that_bears_its_name(kind):
    module = import_module(f'smart_tire.cli._identify_{kind}')
    assert kind == module.NAME
    assert parsed(kind, 'some_recording').run_kind is module.run


def test_an_unknown_kind_is_a_usage_error_that_names_the_known_ones(capsys):
    with pytest.raises(SystemExit) as left:
        parsed('colour', 'some_recording')
    assert left.value.code == 2
    said = capsys.readouterr().err
    assert all(kind in said for kind in identify.KINDS)
