"""Ready scenes at sizes for tests."""

import warprt as rt

SMALL = {"forest": {"size": 20_000}, "rings": {"size": 4}, "mountain": {"size": 6}, "pot_in_a_field": {"size": 128}}
"""Options of scene() where the default is more than a small picture needs."""


def load(name: str) -> rt.Scene:
    """A ready scene, in its small size if it has one."""
    return rt.load_scene(name, **SMALL.get(name, {}))
