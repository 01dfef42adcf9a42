"""The viewer in a real Chromium: what a person clicks on is what is shown."""

import io
import os
import shutil

import numpy as np
import PIL.Image
import pytest
from viewer_scene import SIZE, viewer_scene

import warprt as rt
from warprt.viewer.cell_lines import EDGES

pytest.importorskip("viser", reason="viser is not installed: pip install 'warprt[viewer]'")
sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")

pytestmark = pytest.mark.browser
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = [
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-quic",
    "--disable-sync",
    "--no-first-run",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
"""Chromium without a screen, a GPU, or calls home."""
TIMEOUT_MS = 120_000
PIXEL = (50, 37)
"""Its ray passes empty cells before that of its hit."""


def chromium_path():
    """An installed Chromium, by WARPRT_CHROMIUM or its usual names; None if there is none."""
    return os.environ.get("WARPRT_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)


@pytest.fixture(scope="module")
def browser():
    path = chromium_path()
    with sync_api.sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=path, args=FLAGS)
        except sync_api.Error as error:
            if path is not None:
                raise
            pytest.skip(f"there is no Chromium: install one, or set WARPRT_CHROMIUM ({str(error).splitlines()[0]})")
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def viewer():
    viewer = rt.view(viewer_scene(), device="cpu", size=SIZE, samples=2, port=0)
    yield viewer
    viewer.stop()


class Opened:
    """The viewer's page in a browser."""

    def __init__(self, browser, viewer, width=900, height=560, ratio=1, has_3d=False):
        # Playwright itself evaluates text, which the page's policy forbids.
        self.context = browser.new_context(
            viewport={"width": width, "height": height}, device_scale_factor=ratio, bypass_csp=True
        )
        if not has_3d:
            # WebGL without a GPU takes seconds for each window.
            for name in ("preview", "world"):
                self.context.route(f"**/{name}/**", lambda route: route.fulfill(body=""))
        self.page, self.errors = self.context.new_page(), []
        self.page.set_default_timeout(TIMEOUT_MS)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(viewer.url)
        self.wait("warprt.frame && warprt.frame.is_final && warprt.place")

    def wait(self, claim):
        self.page.wait_for_function(claim)

    def shift_click(self, column, row):
        """On the middle of a pixel, as it is drawn on the screen."""
        box = self.page.locator("#picture").bounding_box()
        place, window = self.page.evaluate("[warprt.place, warprt.place.window]")
        x = (place["left"] + (column + 0.5) * place["width"] / SIZE[0]) / window["ratio"]
        y = (place["top"] + (row + 0.5) * place["height"] / SIZE[1]) / window["ratio"]
        self.page.keyboard.down("Shift")
        self.page.mouse.click(box["x"] + x, box["y"] + y)
        self.page.keyboard.up("Shift")
        self.wait(f"warprt.pick && warprt.pick.pixel.join() === '{column},{row}'")
        return self.page.evaluate("warprt.pick")

    def close(self):
        self.context.close()
        assert not self.errors


def walk_of(viewer, pixel):
    origins, directions = viewer.camera.rays(*SIZE)
    column, row = pixel
    return viewer._worker.tracer.walk(origins[row, column], directions[row, column])


@pytest.mark.parametrize(("width", "height", "ratio"), [(1400, 800, 1), (700, 900, 2)])
def test_shift_click_is_on_the_pixel_that_is_seen(browser, viewer, width, height, ratio):
    opened = Opened(browser, viewer, width, height, ratio)
    for pixel in [(0, 0), (79, 0), (0, 59), (79, 59), (40, 30)]:
        assert opened.shift_click(*pixel)["pixel"] == list(pixel)
    opened.close()


def test_click_during_a_resize_is_on_what_is_seen(browser, viewer):
    opened = Opened(browser, viewer)
    # The page has not drawn anew when the click comes: what it has drawn is stretched.
    opened.page.evaluate("""() => {
      const { left, top, width, height, window } = warprt.place, picture = document.getElementById("picture");
      document.getElementById("window").style.cssText = "flex: none; height: 150px";
      warprt.pick = null;
      const box = picture.getBoundingClientRect();
      const x = (left + (70.5 / 80) * width) / window.ratio, y = (top + (50.5 / 60) * height) / window.ratio;
      const clientX = box.left + (x * box.width) / window.width, clientY = box.top + (y * box.height) / window.height;
      picture.dispatchEvent(new PointerEvent("pointerdown", { shiftKey: true, button: 0, clientX, clientY }));
    }""")
    opened.wait("warprt.pick")
    assert opened.page.evaluate("warprt.pick.pixel") == [70, 50]
    opened.wait("warprt.place.window.height === 150")
    opened.page.keyboard.press("Escape")
    opened.wait("warprt.pick === null")
    opened.close()


def test_windows_work_under_their_policies(browser, viewer):
    """Here without the help of the fixture's `bypass_csp`."""
    page, said = browser.new_page(viewport={"width": 900, "height": 560}), []
    page.set_default_timeout(TIMEOUT_MS)
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(viewer.url)
    for name in ("preview", "world"):
        page.frame_locator(f"#{name} iframe").locator("canvas").first.wait_for()
        for _ in range(60):
            picture = PIL.Image.open(io.BytesIO(page.locator(f"#{name} iframe").screenshot())).convert("RGB")
            r, _, b = np.moveaxis(np.asarray(picture, int), -1, 0)
            if (r - b > 40).sum() > 50:  # the ball, which is brown
                break
            page.wait_for_timeout(200)
        else:
            raise AssertionError(f"the scene did not come into the {name} window")
    assert not [text for text in said if "Content Security Policy" in text]
    page.close()


def test_red_cells_are_those_of_walk(browser, viewer):
    opened = Opened(browser, viewer, has_3d=True)
    page, world = opened.page, opened.page.frame_locator("#world iframe")
    world.locator("canvas").first.wait_for()
    found, walk = opened.shift_click(*PIXEL), walk_of(viewer, PIXEL)
    assert len(walk) > 3
    assert [row[2] for row in found["cells"]] == walk.cell.tolist()
    assert page.locator("#rows tr").count() == len(walk)
    assert page.locator("#rows tr.found").count() == 1
    assert "column 50, row 37" in page.inner_text("#pixel")
    # What is drawn in red: the twelve edges of each of those cells, and no others.
    kinds = ("jumped", "empty", "tested", "found")
    drawn = np.concatenate([viewer._world.lines(f"/path/cells 0 {kind}") for kind in kinds])
    expected = viewer.space.to_browser(walk.corners)[:, EDGES].reshape(-1, 2, 3)
    assert drawn.shape == expected.shape
    np.testing.assert_allclose(*(np.sort(lines.reshape(-1, 6), axis=0) for lines in (drawn, expected)), atol=1e-5)
    # The world view goes to the cells, which then are what is red there.
    page.keyboard.press("z")
    for _ in range(60):
        picture = PIL.Image.open(io.BytesIO(page.locator("#world iframe").screenshot())).convert("RGB")
        r, g, b = np.moveaxis(np.asarray(picture, int), -1, 0)
        if ((r > 180) & (g < 90) & (b < 90)).sum() > 50:
            break
        page.wait_for_timeout(500)
    else:
        raise AssertionError("no red cells came into view")
    # Steps, by keys and by a row of the list.
    start = page.evaluate("warprt.step")
    page.keyboard.press(",")
    opened.wait(f"warprt.step === {start - 1}")
    page.locator("#rows tr").first.click()
    opened.wait("warprt.step === 0")
    page.keyboard.press(".")
    opened.wait("warprt.step === 1")
    page.keyboard.press("Escape")
    opened.wait("warprt.pick === null")
    opened.close()


def test_controls_reach_the_tracer(browser, viewer):
    opened = Opened(browser, viewer)
    page = opened.page
    page.select_option("select[name=output]", "cells")
    opened.wait("warprt.frame.output === 'cells' && warprt.frame.is_final")
    with page.expect_download() as download:
        page.click("#save")
    assert download.value.suggested_filename == "scene.cells.png"
    page.select_option("select[name=output]", "color")
    page.fill("input[name=grid]", "nonsense")
    page.keyboard.press("Enter")
    page.wait_for_selector("#status.bad")
    opened.wait("document.querySelector('input[name=grid]').value === 'scene'")
    page.click("#copy")
    opened.wait("warprt.copied")
    assert page.evaluate("warprt.copied").startswith("rt.Camera(position=(0.3, 0.4, 6)")
    opened.close()


def test_orbit_in_the_preview_moves_the_result(browser, viewer):
    opened = Opened(browser, viewer, has_3d=True)
    page = opened.page
    page.frame_locator("#preview iframe").locator("canvas").first.wait_for()
    before = page.evaluate("warprt.frame.view")
    box = page.locator("#preview iframe").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for _ in range(20):
        # Until viser's page has its camera controls.
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 60, y + 15, steps=4)
        page.mouse.up()
        page.wait_for_timeout(500)
        if page.evaluate("warprt.frame.view") > before:
            break
    opened.wait(f"warprt.frame.view > {before} && warprt.frame.is_final")
    assert np.linalg.norm(viewer.camera.position - viewer.scene.camera.position) > 0.1
    np.testing.assert_allclose(viewer.camera.up, (0, 1, 0))
    opened.close()
