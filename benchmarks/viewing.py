"""How fast the viewer is in a browser: `python -m warprt.benchmarks.viewing`, with playwright and a Chromium.

First picture: from the call that opens the page to the first drawn picture. Coarse frames: pictures of new cameras that
the page has drawn, each second, while the preview is dragged without a break; and without any browser, to tell our
share of that from WebGL's. Copies: how long the page does not answer at a time, with 10,000 of them; and with one
sphere, to tell their share of that from what viser's page takes to set itself up.
"""

import argparse
import json
import os
import shutil
import statistics
import sys
import time
from pathlib import Path

import numpy as np
import warp as wp

import warprt as rt
from warprt.files import write_whole

from . import machine
from .meshes import blob

FLAGS = ["--no-sandbox", "--disable-background-networking", "--use-gl=angle", "--use-angle=swiftshader"]
WATCH = """if (window === top) {
  window.seen = { first: null, views: [], steps: [], gaps: [] };
  let last = performance.now(), view = null;
  setInterval(() => {
    const now = performance.now(), state = window.warprt;
    if (now - last > 100) seen.gaps.push([last, now - last]);
    last = now;
    if (!state || !state.bitmap || !state.place || !state.frame) return;
    if (seen.first === null) seen.first = now;
    if (state.frame.view !== view) { view = state.frame.view; seen.views.push(now); seen.steps.push(state.frame.step); }
  }, 5);
}"""
SIZE = (640, 480)
DRAG_S = 6.0
REPEATS = 5


def mesh_scene(triangles: int = 100_000) -> rt.Scene:
    """A blob in daylight on the ground."""
    vertices, faces = blob(triangles)
    lights = [rt.AmbientLight(0.2), rt.DirectionalLight((-1, -1.5, -0.5))]
    return rt.Scene(
        [rt.Mesh(vertices, faces)], lights, rt.Camera((0, 1.2, 4.5), (0, 0, 0), fov_deg=35), (0.5, 0.6, 0.7)
    )


def copies_scene(count: int = 10_000) -> rt.Scene:
    """As many copies of a mesh of 5,000 triangles, turned and moved at random."""
    rng, (vertices, faces) = np.random.default_rng(7), blob(5000)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0] * 0.4
    matrices[:, :3, 3] = rng.uniform(-20, 20, (count, 3))
    lights = [rt.AmbientLight(0.2), rt.DirectionalLight((-1, -1.5, -0.5))]
    return rt.Scene([rt.Instances(rt.Mesh(vertices, faces), matrices)], lights, background=(0.5, 0.6, 0.7))


def first_picture_s(browser) -> list[float]:
    """Seconds until the page shows a picture, each time of a viewer that has just begun."""
    found = []
    for _ in range(REPEATS + 1):
        viewer = rt.view(mesh_scene(), size=SIZE, port=0)
        page = opened(browser, viewer)
        page.wait_for_function("window.seen && seen.first !== null")
        found.append(page.evaluate("seen.first") / 1000)
        page.context.close()
        viewer.stop()
    return found[1:]  # the first one loads kernels


def dragged(browser, size: tuple[int, int]) -> dict:
    """Pictures per second while the camera moves in the preview, in a window of that size."""
    viewer = rt.view(mesh_scene(), size=SIZE, port=0)
    page = opened(browser, viewer, size)
    page.frame_locator("#preview iframe").locator("canvas").first.wait_for()
    page.wait_for_timeout(8000)
    box = page.locator("#preview iframe").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    start, k = time.perf_counter(), 0
    first = page.evaluate("performance.now()")
    while time.perf_counter() - start < DRAG_S:
        k += 1
        page.mouse.move(x + 80 * np.sin(k / 15), y + 20 * np.cos(k / 15))
    last = page.evaluate("performance.now()")
    page.mouse.up()
    seen = page.evaluate("seen")
    views = [at for at in seen["views"] if first <= at <= last]
    steps = seen["steps"][-len(views) :]
    page.context.close()
    viewer.stop()
    return {"frames_per_s": len(views) / ((last - first) / 1000), "median_step": statistics.median(steps or [0])}


def served() -> dict:
    """The same without a browser: cameras come 60 times a second, and pictures are counted as they go out."""
    viewer = rt.view(mesh_scene(), size=SIZE, port=0)
    shown, send = [], viewer._web.tell_all
    viewer._web.tell_all = lambda kind, message: (shown.append(time.perf_counter()), send(kind, message))
    time.sleep(2.0)
    start, k = time.perf_counter(), 0
    while time.perf_counter() - start < DRAG_S:
        k += 1
        viewer._move(rt.Camera((4.5 * np.sin(k / 60), 1.2, 4.5 * np.cos(k / 60)), (0, 0, 0), fov_deg=35))
        time.sleep(1 / 60)
    count = sum(at >= start for at in shown)
    viewer.stop()
    return {"frames_per_s": count / DRAG_S}


def stalls(browser, scene: rt.Scene) -> dict:
    """How long the page does not answer at a time, and what is drawn."""
    rt.Tracer(scene).render(size=(8, 8))  # loads kernels
    viewer = rt.view(scene, size=SIZE, port=0)
    page = opened(browser, viewer)
    page.wait_for_timeout(20_000)
    seen = page.evaluate("seen")
    drawn = sum(len(mesh.faces) * len(mesh.batched_positions) for mesh in viewer._preview.meshes)
    late = [gap for at, gap in seen["gaps"] if at > 10_000]
    found = {
        "first_picture_s": seen["first"] / 1000,
        "longest_gap_s": max(gap for _, gap in seen["gaps"]) / 1000,
        "sum_of_gaps_s": sum(gap for _, gap in seen["gaps"]) / 1000,
        "longest_gap_after_10_s": max(late, default=0) / 1000,
        "triangles_drawn": drawn,
        "notes": viewer.notes,
    }
    page.context.close()
    viewer.stop()
    return found


def opened(browser, viewer, size: tuple[int, int] = (1400, 800)):
    """The page, watched from its first moment."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, bypass_csp=True)
    context.add_init_script(WATCH)
    page = context.new_page()
    page.set_default_timeout(120_000)
    page.goto(viewer.url, wait_until="commit")
    return page


MEASURES = {
    "first_picture_s": first_picture_s,
    "served": lambda browser: served(),
    "dragged in 900x560": lambda browser: dragged(browser, (900, 560)),
    "dragged in 1400x800": lambda browser: dragged(browser, (1400, 800)),
    "one sphere": lambda browser: stalls(browser, rt.Scene([rt.Sphere()])),
    "copies": lambda browser: stalls(browser, copies_scene()),
}


def main() -> None:
    """Measures all, prints it, and writes it where told."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, metavar="JSON")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        result = {"machine": machine.about("cpu")}
        for name, measure in MEASURES.items():
            result[name] = measure(browser)
            print(name, result[name], f"load {os.getloadavg()[0]:.1f}", file=sys.stderr)
        browser.close()
    text = json.dumps(result, indent=1)
    print(text)
    if options.output:
        write_whole(options.output, lambda file: file.write(text.encode()))


if __name__ == "__main__":
    sys.exit(main())
