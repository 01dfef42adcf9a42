"""How surfaces answer light."""

from dataclasses import dataclass

from . import checks
from .texture import Texture
from .typing import ArrayLike


@dataclass(frozen=True)
class Material:
    """What a surface does with light: a mixture of scattering evenly, highlights and a mirror, and light of its own.

    Colours are linear RGB, or one number for grey. The shares `diffuse`, `mirror` and `specular` should not exceed 1
    together; a surface then never reflects more than it receives. Raises ValueError for a negative or non-finite
    colour, a shininess or refraction index that is not positive, and glass with too much beside it.
    """

    diffuse: ArrayLike = (0.8, 0.8, 0.8)
    """Share of the light that is scattered evenly."""
    mirror: ArrayLike = (0.0, 0.0, 0.0)
    """Share of the light that is reflected as by a mirror. With `diffuse` it should not exceed 1."""
    texture: Texture | None = None
    """Multiplies both, point by point. The shape must be a mesh with uvs."""
    emission: ArrayLike = (0.0, 0.0, 0.0)
    """Light that both sides give off evenly, whatever falls on them.

    It is seen, but lights something else only with `integrator="path"`.
    """
    specular: ArrayLike = (0.0, 0.0, 0.0)
    """Share of the light of lamps (all but ambient light) that is reflected as a highlight (Blinn-Phong).

    The lobe is normalised: light that falls along the normal is reflected by just this share, other light by less.
    """
    shininess: float = 50.0
    """How small and bright highlights are: the exponent of the lobe, greater than 0, up to 1e6."""
    glass: ArrayLike = (0.0, 0.0, 0.0)
    """Share of the light that a clear boundary reflects or lets through, as Fresnel says; 1 for glass.

    The side of the outward normal is air. Each sample follows one of both ways, chosen by its share, so that clear
    pictures need `samples`; shadow rays do not pass. Not together with `mirror`, and with `diffuse` at most 1.
    """
    ior: float = 1.5
    """Refraction index of glass, relative to what is around it; greater than 0."""
    absorption: ArrayLike = (0.0, 0.0, 0.0)
    """Of glass: light weakens by exp(-absorption * distance) inside."""
    shines: bool = True
    """Whether its emission lights others; False for what only shows a lamp, such as `RectangleLight.panel`."""

    def __post_init__(self):
        object.__setattr__(self, "diffuse", checks.color(self.diffuse, "Material diffuse"))
        object.__setattr__(self, "mirror", checks.color(self.mirror, "Material mirror"))
        object.__setattr__(self, "emission", checks.color(self.emission, "Material emission"))
        object.__setattr__(self, "specular", checks.color(self.specular, "Material specular"))
        shininess = checks.number(self.shininess, "Material shininess")
        if not 0 < shininess <= 1e6:
            raise ValueError(f"Material shininess must be greater than 0, up to 1e6; got {shininess:g}")
        object.__setattr__(self, "shininess", shininess)
        object.__setattr__(self, "glass", checks.color(self.glass, "Material glass"))
        object.__setattr__(self, "absorption", checks.color(self.absorption, "Material absorption"))
        object.__setattr__(self, "ior", checks.number(self.ior, "Material ior"))
        if not self.ior > 0:
            raise ValueError(f"Material ior must be greater than 0; got {self.ior:g}")
        if any(self.glass):
            self._check_glass()
        if not isinstance(self.shines, bool):
            raise ValueError(f"Material shines must be True or False; got {self.shines!r}")
        if not isinstance(self.texture, (Texture, type(None))):
            raise ValueError(f"Material texture must be a Texture; got {type(self.texture).__name__}")

    def _check_glass(self) -> None:
        if any(self.mirror):
            raise ValueError(f"Material glass reflects by itself and takes no mirror; got mirror {self.mirror}")
        if max(g + d for g, d in zip(self.glass, self.diffuse, strict=True)) > 1:
            raise ValueError(
                f"Material glass and diffuse must not exceed 1 together; got {self.glass} and {self.diffuse}, "
                "clear glass has diffuse 0"
            )

    @property
    def lobe_factor(self) -> float:
        """Pi times what normalises the lobe: the integral of (cos t/2)^s cos t over the hemisphere, turned over.

        Light along the normal leaves at an angle t from it, halfway to which the lobe is looked up (Giesen 2009,
        "Phong normalization factor derivation").
        """
        s = self.shininess
        return (s + 2) * (s + 4) / (8 * (2 ** (-s / 2) + s))
