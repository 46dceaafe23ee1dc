# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Tables of the terminal as Markdown."""

from __future__ import annotations

from benchmarks.tables import markdown, new_table
from rich.text import Text


def test_a_table_becomes_markdown_with_groups_in_all_headers():
    table = new_table('Errors', 'counted', 'before:\nerror', '\nin', 'refe-\nrence')
    table.add_row('  sand 12', '1.0 / 2.0', Text('0.80 !'), '')
    table.add_section()
    table.add_row('all', '', '0.9', '3')
    assert markdown(table).splitlines() == [
        'Errors', '', '| counted | before: error | before: in | reference |',
        '| --- | --- | --- | --- |', '| sand 12 | 1.0 / 2.0 | 0.80 ! |  |', '| all |  | 0.9 | 3 |']
