"""What rays see that meet nothing."""

from dataclasses import dataclass
from pathlib import Path

from . import checks
from .read_only import ReadOnly
from .texture import Texture
from .typing import ArrayLike


@dataclass(frozen=True)
class GradientSky:
    """A background that goes from one colour at the horizon to another overhead (+y).

    Raises ValueError for a negative or non-finite colour.
    """

    horizon: ArrayLike = (1.0, 1.0, 1.0)
    """Linear RGB, of rays that are level or go down."""
    zenith: ArrayLike = (0.25, 0.45, 0.85)
    """Linear RGB, of rays straight up."""

    def __post_init__(self):
        object.__setattr__(self, "horizon", checks.color(self.horizon, "GradientSky horizon"))
        object.__setattr__(self, "zenith", checks.color(self.zenith, "GradientSky zenith"))


@dataclass(frozen=True, eq=False)
class ImageSky(ReadOnly):
    """A background that is a picture of all directions, as an `EquirectangularCamera` takes it.

    Columns are longitudes, with -z in the middle and +x to the right of it; rows are latitudes, with +y on top. Linear
    light is interpolated as the texture says, around the whole. Raises ValueError for a picture that is none, and for a
    scale that is negative or not finite, FileNotFoundError when there is no such file.
    """

    picture: Texture | ArrayLike | str | Path
    """A `Texture` or what makes one: an array (H, W, 3), floats being linear light, or the path of a picture."""
    rotation_deg: float = 0.0
    """How far it is turned about +y, counterclockwise as seen from above."""
    scale: ArrayLike = 1.0
    """Linear RGB, or one number: factor of the light."""

    def __post_init__(self):
        picture = self.picture
        if not isinstance(picture, Texture):
            try:
                picture = Texture(picture)
            except ValueError as error:
                raise ValueError(f"ImageSky picture: {error}") from None
        object.__setattr__(self, "picture", picture)
        object.__setattr__(self, "rotation_deg", checks.number(self.rotation_deg, "ImageSky rotation_deg"))
        object.__setattr__(self, "scale", checks.color(self.scale, "ImageSky scale"))
