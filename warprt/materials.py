"""How surfaces answer light."""

from dataclasses import dataclass

from . import checks
from .texture import Texture
from .typing import ArrayLike


@dataclass(frozen=True)
class Material:
    """A Lambert surface, a mirror, or a mixture of both.

    `diffuse` and `mirror` are linear RGB, or one number for grey; negative or non-finite values raise ValueError.
    """

    diffuse: ArrayLike = (0.8, 0.8, 0.8)
    """Share of the light that is scattered evenly."""
    mirror: ArrayLike = (0.0, 0.0, 0.0)
    """Share of the light that is reflected as by a mirror. With `diffuse` it should not exceed 1."""
    texture: Texture | None = None
    """Multiplies both, point by point. The shape must be a mesh with uvs."""

    def __post_init__(self):
        object.__setattr__(self, "diffuse", checks.color(self.diffuse, "Material diffuse"))
        object.__setattr__(self, "mirror", checks.color(self.mirror, "Material mirror"))
        if not isinstance(self.texture, (Texture, type(None))):
            raise ValueError(f"Material texture must be a Texture; got {type(self.texture).__name__}")
