# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The HTML file in a browser: every plot is drawn, time axes are linked, nothing is loaded."""

from __future__ import annotations

from base64 import b64encode
from hashlib import sha256
import html
import json
import re
import shutil
import subprocess

import pytest
from support.waiting import PATIENCE

pytestmark = pytest.mark.processes

BROWSERS = 'chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable'
OPTIONS = (
    '--headless=new', '--no-sandbox', '--disable-gpu', '--no-first-run', '--disable-extensions',
    '--disable-background-networking', '--enable-logging=stderr', '--virtual-time-budget=20000',
    '--blink-settings=preferredColorScheme=0',  # dark
    '--host-resolver-rules=MAP * ~NOTFOUND', '--dump-dom')
RANGE = [1.0, 2.0]  # s, to which the probe zooms the slip
# Zooms one plot, prints the page, and records what happened in the document.
PROBE = """
addEventListener('securitypolicyviolation', (event) => {
  document.body.dataset.violation = event.blockedURI || 'inline';
});
const probe = setInterval(async () => {
  if (document.body.dataset.plots === undefined) { return; }
  clearInterval(probe);
  const plots = [...document.querySelectorAll('.plot')];
  const ranges = () => plots.map((plot) => [plot.id, [...plot.layout.xaxis.range]]);
  const font = () => getComputedStyle(document.querySelector('.xtitle')).fill;
  const fonts = [font()];
  const before = ranges();
  await Plotly.relayout(document.getElementById('slip_plot'),
                        {'xaxis.range[0]': RANGE[0], 'xaxis.range[1]': RANGE[1]});
  await new Promise((done) => setTimeout(done, 500));
  const zoomed = ranges();
  dispatchEvent(new Event('beforeprint'));
  await new Promise((done) => setTimeout(done, 500));
  fonts.push(font());
  const width = Math.max(...[...document.querySelectorAll('.main-svg')].map(
    (drawing) => drawing.getBoundingClientRect().width));
  const violation = document.body.dataset.violation || '';
  const foreign = document.createElement('script');
  foreign.textContent = 'document.body.dataset.foreign = 1';
  document.body.append(foreign);
  await new Promise((done) => setTimeout(done, 500));
  document.body.dataset.probed = JSON.stringify({before, zoomed, fonts, width, violation});
}, 20);
"""


@pytest.fixture(scope='module')
def opened(page, tmp_path_factory):
    """Return the document after its scripts, and the log of the browser."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f'needs a browser: one of {", ".join(BROWSERS)}')
    folder = tmp_path_factory.mktemp('browser')
    file = folder / 'report.html'
    probe = PROBE.replace('RANGE', json.dumps(RANGE))
    allowed = b64encode(sha256(probe.encode()).digest()).decode('ascii')
    file.write_text(page.replace('</body>', f'<script>{probe}</script></body>').replace(
        'script-src ', f"script-src 'sha256-{allowed}' "))
    done = subprocess.run([browser, *OPTIONS, f'--user-data-dir={folder / "profile"}',
                           file.as_uri()], capture_output=True, text=True, timeout=PATIENCE,
                          check=True)
    return done.stdout, done.stderr


@pytest.fixture(scope='module')
def probed(opened):
    """Return what the probe has recorded."""
    return json.loads(html.unescape(re.search(r'data-probed="([^"]*)"', opened[0])[1]))


def test_every_plot_is_drawn(opened, page):
    document = opened[0]
    count = page.count('<div class="plot"')
    assert count == 12 and f'data-plots="{count}"' in document
    assert len(re.findall(r'class="plot [^"]*js-plotly-plot', document)) == count
    assert len(re.findall(r'<svg class="main-svg"[^>]*>', document)) >= count


def test_there_is_no_error_and_no_attempt_to_load_anything(opened, probed):
    document, log = opened
    assert [line for line in log.splitlines()
            if 'CONSOLE' in line and 'Content Security Policy' not in line] == []
    assert '<p class="error">The plots cannot' not in document
    assert probed['violation'] == ''


def test_a_script_that_is_not_of_the_page_does_not_run(opened):
    assert 'data-violation="inline"' in opened[0]
    assert 'data-foreign' not in opened[0]


def test_time_axes_are_linked_and_others_are_not(probed):
    before, zoomed = dict(probed['before']), dict(probed['zoomed'])
    others = zoomed.keys() & {'path_plot', 'normalized_plot', 'crossing_plot'}
    assert len(others) == 3
    for name in zoomed.keys() - others:
        assert zoomed[name] == RANGE and before[name] != RANGE, name
    assert all(zoomed[name] == before[name] for name in others)


def test_a_dark_page_is_printed_in_black_with_plots_that_fit_the_paper(probed):
    assert probed['fonts'] == ['rgb(230, 234, 238)', 'rgb(28, 39, 51)']
    assert probed['width'] <= 680.0
