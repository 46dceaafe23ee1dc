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
Take the pictures of the viewer in ``docs/images`` from a recording, such as that of a demo.

Usage: ``python docs/take_screenshots.py demo_output [PICTURE]...``; ``view_camera`` requires a
recording with an overhead camera. Requires rerun, Chromium, and
``pip install playwright pillow``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import shutil
import sys
import tempfile
import time

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

from smart_tire.analysis.pipeline import bag_params
from smart_tire.bags import Bag
from smart_tire.view.bag import find_bags, image_topic, show
from smart_tire.view.layout import ViewLayout
from smart_tire.view.scene import Scene
from smart_tire.view.viewer import open_stream, Viewer

IMAGES = Path(__file__).resolve().parent / 'images'
SIZE = {'width': 1920, 'height': 1080}
CAMERA_SIZE = {'width': 1280, 'height': 720}  # noise of an image makes large files
LOADING_SIZE = {'width': 320, 'height': 240}  # drawn faster while data arrive
# picture -> horizontal position of its tab, None for the first one
TABS = {'view_bag': None, 'view_contact': 170, 'view_camera': 680}
PICTURES = 'view_bag', 'view_contact'  # of a demo
LOADING_TIME, DRAWING_TIME = 40.0, 20.0  # s; without a GPU the viewer is slow
MAX_FRAME_TIME = 300_000.0  # ms
COLORS, GRAYS = 96, 32
MIN_CHROMA = 24  # of 255, difference of the components of a color that is not a gray
FLAGS = ('--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader',
         '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist')


def reduced(picture: Image.Image) -> Image.Image:
    """Return ``picture`` in ``COLORS``: grays, and those of the pixels that are not gray."""
    pixels = np.asarray(picture.convert('RGB'))
    colored = pixels[np.ptp(pixels, axis=2) > MIN_CHROMA][None]
    palette = Image.new('P', (1, 1))
    palette.putpalette([
        *np.repeat(np.linspace(0, 255, GRAYS).astype(int), 3).tolist(),
        *(Image.fromarray(colored).quantize(COLORS - GRAYS).getpalette() or [])])
    return picture.convert('RGB').quantize(palette=palette, dither=Image.Dither.NONE)


def take(folder: Path, pictures: Sequence[str] = PICTURES) -> None:
    """Serve the recording in ``folder`` and take ``pictures``."""
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as tools, \
            Viewer(web=True, wait=time.sleep) as viewer:
        path, estimates = find_bags(folder)
        with Bag(path) as bag:
            params, camera = bag_params(bag).params, bool(image_topic(bag))
        layout = ViewLayout(params.robot.film.wheels, live=False, camera=camera)
        stream = open_stream('demo', layout.blueprint(), address=viewer.address.stream)
        show(path, estimates, Scene(stream, params.robot), params, estimate=False, describe=print)
        browser = tools.chromium.launch(executable_path=shutil.which('chromium'), args=FLAGS)
        page = browser.new_page(viewport=LOADING_SIZE, color_scheme='dark')
        page.goto(viewer.address.page)
        time.sleep(LOADING_TIME)
        page.set_viewport_size(SIZE)
        time.sleep(DRAWING_TIME)
        for name in pictures:
            if name == 'view_camera':
                page.set_viewport_size(CAMERA_SIZE)
                time.sleep(DRAWING_TIME)
            if (tab := TABS[name]) is not None:
                page.mouse.click(tab, 50)
                time.sleep(DRAWING_TIME)
            page.screenshot(path=f'{scratch}/{name}.png', timeout=MAX_FRAME_TIME)
            with Image.open(f'{scratch}/{name}.png') as picture:
                reduced(picture).save(IMAGES / f'{name}.png', optimize=True)
        browser.close()
        stream.disconnect()


if __name__ == '__main__':
    take(Path(sys.argv[1]), sys.argv[2:] or PICTURES)
