"""A scene in the browser: preview, world view and result, and the cells that a pixel's ray visits."""

from .viewer import Viewer as Viewer
from .viewer import view as view
