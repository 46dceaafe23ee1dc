"""Tables of the terminal as Markdown."""

from __future__ import annotations

from rich.text import Text

from benchmarks.tables import markdown, new_table


def test_a_table_becomes_markdown_with_groups_in_all_headers():
    table = new_table('Errors', 'counted', 'before:\nerror', '\nin', 'refe-\nrence')
    table.add_row('  sand 12', '1.0 / 2.0', Text('0.80 !'), '')
    table.add_section()
    table.add_row('all', '', '0.9', '3')
    assert markdown(table).splitlines() == [
        'Errors', '', '| counted | before: error | before: in | reference |',
        '| --- | --- | --- | --- |', '| sand 12 | 1.0 / 2.0 | 0.80 ! |  |', '| all |  | 0.9 | 3 |']
