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
Makes docs/images/report.png: the beginning of a report in a headless browser.

``python docs/report_screenshot.py demo_output --params demo_output/demo.yaml`` after
``make demo``; needs Chromium or Chrome.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import shutil
import subprocess
import sys
import tempfile

from smart_tire.cli.main import main as smart_tire

PICTURE = Path(__file__).resolve().parent / 'images' / 'report.png'
BROWSERS = 'chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable'
SIZE = 1180, 2030       # px of the page
SCALE = 0.8
DRAWING_TIME = 10_000   # ms of the browser's virtual time
TIMEOUT = 120.0         # s


def take(page: Path, picture: Path) -> None:
    """Save the beginning of ``page`` as a PNG file; raise FileNotFoundError without a browser."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise FileNotFoundError(f'none of {", ".join(BROWSERS)} is installed')
    picture.parent.mkdir(exist_ok=True)
    subprocess.run(
        [browser, '--headless=new', '--no-sandbox', '--disable-gpu', '--hide-scrollbars',
         f'--window-size={SIZE[0]},{SIZE[1]}', f'--force-device-scale-factor={SCALE}',
         f'--virtual-time-budget={DRAWING_TIME}', f'--screenshot={picture.resolve()}',
         page.resolve().as_uri()], check=True, timeout=TIMEOUT, capture_output=True)


def main() -> int:
    """Make the report of the bag given on the command line, and its picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('bag', type=Path)
    parser.add_argument('--params', type=Path, required=True)
    parser.add_argument('--out', type=Path, default=PICTURE)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / 'report.html'
        status = smart_tire(['report', str(args.bag), '--params', str(args.params),
                             '--out', str(page)])
        if status == 0:
            text = page.read_text(encoding='utf-8')
            page.write_text(text.replace(f'{Path.cwd()}/', ''), encoding='utf-8')
            take(page, args.out)
    return status


if __name__ == '__main__':
    sys.exit(main())
