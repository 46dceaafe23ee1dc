# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Flame graph: its boxes, and stacks of all processes of an analysis."""

from pathlib import Path

import benchmarks
from benchmarks.flame_graph import below_root, Box, boxes, draw, sampled
from benchmarks.offline import simulated, write_bag
import pytest
from smart_tire.errors import SmartTireError

STACKS = {('a', 'b', 'c'): 1.0, ('a',): 0.5, ('a', 'd'): 2.0, ('e', 'c'): 0.25}


def test_a_box_is_as_long_as_the_time_of_its_function_and_begins_in_that_of_its_caller():
    assert list(boxes(STACKS)) == [
        Box('a', 0, 0.0, 3.5), Box('b', 1, 0.0, 1.0), Box('c', 2, 0.0, 1.0),
        Box('d', 1, 1.0, 2.0), Box('e', 0, 3.5, 0.25), Box('c', 1, 3.5, 0.25)]


def test_the_second_process_is_not_below_the_first_from_which_it_was_forked():
    forked = '__main__.<module>', 'offline.analyze', 'process._bootstrap', 'offline._read', 'x.y'
    assert below_root(forked) == ('offline._read', 'x.y')
    assert below_root(forked[:2]) == ('offline.analyze',)
    assert below_root((*forked[:3], 'processes._send', 'z.w')) == ('processes._send', 'z.w')
    assert below_root(('__main__.<module>', 'threading._shutdown')) == ('threading._shutdown',)


def test_graphs_are_drawn(tmp_path):
    draw({'before': STACKS, 'now': {('a',): 0.5}}, tmp_path / 'graph.png')
    assert (tmp_path / 'graph.png').stat().st_size > 10_000


@pytest.mark.long
def test_all_processes_of_a_checkout_are_sampled(tmp_path):
    source = Path(benchmarks.__file__).parents[1]
    write_bag(tmp_path / 'bag', simulated(1)[:20_000], 1)
    (tmp_path / 'params.yaml').write_text('{}')
    found = sampled(source, tmp_path / 'bag', tmp_path / 'params.yaml', tmp_path / 'found')
    assert {'offline._read', 'offline._with_friction', 'offline.analyze'} <= {
        names[0] for names in found}
    assert sum(found.values()) > 0.5
    with pytest.raises(SmartTireError, match='(?s)the analysis has failed.*missing'):
        sampled(source, tmp_path / 'missing', tmp_path / 'params.yaml', tmp_path / 'other')
