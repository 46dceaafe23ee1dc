# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Sphinx extension: formulas as MathML, made at build time."""

from __future__ import annotations

from typing import Any

from latex2mathml.converter import convert


def render_inline(translator: Any, node: Any) -> None:
    """Write an inline formula."""
    translator.body.append(f'<span class="math">{convert(node.astext())}</span>')
    raise _skip()


def render_block(translator: Any, node: Any) -> None:
    """Write a displayed formula, with its label as anchor."""
    anchor = f' id="equation-{node["label"]}"' if node.get('label') else ''
    formula = convert(node.astext(), display='block')
    translator.body.append(f'<div class="math"{anchor}>{formula}</div>')
    raise _skip()


def _skip() -> Exception:
    """Return the signal that a node is complete."""
    from docutils.nodes import SkipNode
    return SkipNode()


def setup(app: Any) -> dict[str, bool]:
    """Register the renderer ``mathml``."""
    app.add_html_math_renderer(
        'mathml', inline_renderers=(render_inline, None), block_renderers=(render_block, None))
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
