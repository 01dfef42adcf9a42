"""Results of casting rays."""

import copy
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warprt.kernels.spec import Stored
from warprt.kernels.structs import bounded_arrays_struct, hit_arrays_struct, vec3

from .typing import Array, ArrayLike

if TYPE_CHECKING:
    from .rays import Rays
    from .tracer import Tracer

BRIEF = ("hit", "t", "instance_id", "primitive_id")
"""Fields that need nothing but the search for the closest hit."""
FIELDS = (*BRIEF, "position", "normal", "uv", "t_error")
"""What "all" stands for."""
KNOWN = (*FIELDS, "position_error")
"""All that may be asked for by name."""


def field_types(real: type) -> dict[str, type]:
    """The device type of each field."""
    vec2 = wp.types.vector(2, real)
    types = (wp.bool, real, wp.int32, wp.int32, vec3(real), vec3(real), vec2, real, real)
    return dict(zip(KNOWN, types, strict=True))


def stored(names: Iterable[str]) -> Stored:
    """How much a kernel must store for these fields."""
    if "position_error" in names:
        return Stored.BOUNDED
    return Stored.BRIEF if set(names) <= set(BRIEF) else Stored.FULL


def field_names(outputs) -> tuple[str, ...]:
    """The fields that `outputs` asks for, or a ValueError that names the one that does not exist."""
    if isinstance(outputs, str):
        outputs = FIELDS if outputs == "all" else (outputs,)
    try:
        names = tuple(outputs)
    except TypeError:
        raise ValueError(f"outputs must be names of fields, or 'all'; got {outputs!r}") from None
    for name in names:
        if name not in KNOWN:
            raise ValueError(f"outputs must be among {', '.join(KNOWN)}, or 'all'; got {name!r}")
    return names


class Hits:
    """Closest hits; every field has the leading shape of the rays. A miss: t = inf, ids -1, the rest 0.

    Of hits at equal t, before t is rounded to its type, the lower instance id and then the lower primitive id wins.

    Arrays are NumPy arrays, or Warp arrays where the rays were. Floats are float32 in `fast` and `robust`,
    float64 in `mixed` and `double`. A field that `outputs` did not name raises AttributeError. A pickle
    holds the fields as NumPy arrays, and neither the rays nor the tracer.
    """

    hit: Array
    """(...) bool."""
    t: Array
    """(...) parameter of the hit, in units of the direction's length."""
    position: Array
    """(..., 3) the point, on the surface."""
    normal: Array
    """(..., 3) unit geometric normal: outward, by winding on meshes; never turned towards the ray."""
    uv: Array
    """(..., 2) barycentric weights of a triangle's 2nd and 3rd vertex; 0 on other shapes."""
    instance_id: Array
    """(...) int32, placements counted in scene order."""
    primitive_id: Array
    """(...) int32, the face of a mesh; 0 on other shapes."""
    t_error: Array
    """(...) bound on `|t - t*|`, `t*` being where the ray as given meets the surface as given; see docs/numerics.md.

    Infinite where there is none (a sliver, a ray in the plane of what it meets); NaN in `fast`.
    """
    position_error: Array
    """(...) bound on `|position - p*|`, the Euclidean distance to `p* = o + t* d`, `t*` being that of `t_error`.

    Only where `outputs` names it: "all" leaves it out. Infinite and NaN as `t_error` is; 0 for a miss.
    """

    def __init__(self, fields: dict[str, Array], rays: "Rays", tracer: "Tracer"):
        self.__dict__.update(fields)
        self._names = tuple(fields)
        self._count = rays.count
        self._rays: Rays | None = rays
        self._tracer: Tracer | None = tracer

    def __getstate__(self):
        fields = {name: on_host(self.__dict__[name]) for name in self._names}
        return {**self.__dict__, **fields, "_rays": None, "_tracer": None}

    def __deepcopy__(self, memo):
        other = copy.copy(self)
        other.__dict__.update({name: copied(self.__dict__[name], memo) for name in self._names})
        # Nothing in hits changes the tracer, so they share it, unless it is copied with them.
        other._tracer = memo.get(id(self._tracer), self._tracer)
        return other

    def __copy__(self):
        other = object.__new__(Hits)
        other.__dict__.update(self.__dict__)
        return other

    def __getattr__(self, name: str):
        if name in KNOWN:
            raise AttributeError(f"{name} was not computed: name it in outputs=, which were {', '.join(self._names)}")
        raise AttributeError(f"Hits has no field {name!r}")

    def __repr__(self) -> str:
        return f"Hits({self._count} rays; {', '.join(self._names)})"

    def spawn(self, directions: ArrayLike | wp.array) -> tuple[Array, Array]:
        """(origins, directions) of rays that leave the hit points to the side each direction points to.

        directions: (..., 3), broadcast against the hits. Origins are float64, (..., 3), and lie off the surface by
        a bound on all roundings, so that a convex shape never meets its own rays; those of misses are NaN. The hits
        are found again, so call it before anything in the scene moves, or the arrays of rays change that were
        Warp's, or too many for the tracer's `budget`.

        Raises ValueError for directions of other shapes or types, and for hits from a pickle.
        """
        if self._tracer is None:
            raise ValueError("Hits from a pickle have no tracer: call spawn before pickling, or cast again")
        return self._tracer._spawn(self._rays, directions)


def on_host(values: Array) -> np.ndarray:
    """The values as a NumPy array."""
    return values.numpy() if isinstance(values, wp.array) else values


def copied(values: Array, memo: dict) -> Array:
    """A deep copy where the values are. (`copy.deepcopy` does not work on Warp arrays.)"""
    if isinstance(values, wp.array):
        return wp.clone(values)
    return copy.deepcopy(values, memo)


def hit_arrays(real: type, fields: dict[str, wp.array]):
    """Where hits are to be stored, as kernels take it."""
    arrays = (bounded_arrays_struct if "position_error" in fields else hit_arrays_struct)(real)()
    for name, array in fields.items():
        setattr(arrays, name, array)
    return arrays


def by_parts(rays: "Rays", types: dict[str, type], run: Callable) -> dict[str, Array]:
    """What run(part, {name: array}) stores for each part of the rays, with their leading shape.

    Warp arrays where the rays are, else NumPy arrays.
    """
    results: dict[str, Array] = {}
    for part in rays.parts():
        fields = {name: wp.empty(part.count, dtype=dtype, device=rays.device) for name, dtype in types.items()}
        run(part, fields)
        if rays.is_whole:
            results = fields if rays.is_device_array else {name: array.numpy() for name, array in fields.items()}
            break
        for name, array in fields.items():
            values = array.numpy()
            if name not in results:
                results[name] = np.zeros((rays.count, *values.shape[1:]), dtype=values.dtype)
            results[name][part.first : part.first + part.count] = values
    if rays.is_device_array:
        return {name: array.reshape(rays.shape) for name, array in results.items()}
    return {name: values.reshape(rays.shape + values.shape[1:]) for name, values in results.items()}
