"""The command `warprt view`."""

import argparse
import webbrowser

from ..scene_files import find_scene, load_scene
from .reach import has_screen
from .viewer import view


def run(options: argparse.Namespace) -> None:
    """Shows a scene until Ctrl-C. Raises ValueError and OSError for mistakes."""
    path = find_scene(options.scene)
    scene = load_scene(path, options.trust, **dict(options.option))
    try:
        viewer = view(
            scene,
            options.accuracy,
            options.device,
            options.size,
            options.samples,
            options.max_bounces,
            options.host,
            options.port,
            path.stem,
        )
    except ModuleNotFoundError as error:
        raise ValueError(error) from None
    if has_screen() and not options.no_browser:
        webbrowser.open(viewer.url)
    viewer.wait()
