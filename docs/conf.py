# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Configuration of the documentation site: ``make site`` builds it without access to a network.

Formulas become MathML at build time, which browsers draw without a script, so the pages can be
read offline. Notebooks are executed by the build.
"""

from __future__ import annotations

from pathlib import Path
import shutil
import sys
from typing import Any

from smart_tire import __version__

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS))  # for the extensions of this folder

project = 'smart_tire'
author = 'The smart_tire developers'
copyright = f'2026 {author}'  # noqa: A001, the name is that of Sphinx
version = release = __version__

extensions = ['myst_nb', 'sphinx.ext.autodoc', 'mathml_renderer', 'command_line_page',
              'parameters_page', 'topics_page']
source_suffix = {'.md': 'myst-nb', '.ipynb': 'myst-nb', '.rst': 'restructuredtext'}

myst_enable_extensions = ['dollarmath']
myst_heading_anchors = 4
nb_execution_mode = 'force'
nb_execution_timeout = 120
nb_execution_raise_on_error = True

autodoc_member_order = 'bysource'
autodoc_preserve_defaults = True
autodoc_type_aliases = {'Array': 'Array', 'ArrayLike': 'ArrayLike', 'Instants': 'Instants'}
python_display_short_literal_types = True
python_use_unqualified_type_names = True

smartquotes = False  # it makes a dash of the two hyphens of an option
html_theme = 'furo'
html_title = f'smart_tire {version}'
html_math_renderer = 'mathml'
html_static_path = ['site.css']
html_css_files = ['site.css']
html_copy_source = False
html_show_sphinx = False


def link_copies(app: Any, docname: str, source: list[str]) -> None:
    """Let links to pages outside of this folder lead to their copies."""
    for outside, copy in (('../../examples/', '../examples/'),
                          ('../CONTRIBUTING.md', 'contributing.md')):
        source[0] = source[0].replace(outside, copy)


def setup(app: Any) -> None:
    """Copy notebooks and pages of the repository: Sphinx reads pages below its folder only."""
    copies = DOCS / 'examples'
    copies.mkdir(exist_ok=True)
    for path in (DOCS.parent / 'examples').glob('*.ipynb'):
        shutil.copy(path, copies)
    for name in ('CONTRIBUTING.md', 'CHANGELOG.rst'):
        text = (DOCS.parent / name).read_text(encoding='utf-8').replace('](docs/', '](')
        (DOCS / name.lower()).write_text(text, encoding='utf-8')
    app.connect('source-read', link_copies)
