"""What it would cost if every kernel held the code of every feature."""

from dataclasses import replace

import numpy as np

import warprt as rt
from warprt.assemble import assemble_look
from warprt.film import Film
from warprt.kernels.render import make_render
from warprt.kernels.spec import Look, ShapeKind
from warprt.kernels.structs import look_struct, scene_struct
from warprt.launch import launch
from warprt.timing import alternating, ratio


def measure(size: int, rounds: int, threads: int) -> dict:
    """Seconds for a picture of the showcase by the kernel made for it, and by one that knows every shape and light."""
    tracer = rt.Tracer(rt.load_scene("showcase"), device="cpu", threads=threads)
    scene = tracer._device_scene
    look, lights = assemble_look(tracer.scene, scene.spec, tracer.device)
    everything = Look(
        replace(scene.spec, shapes=frozenset(ShapeKind)),
        ambient=True,
        point_lights=True,
        directional_lights=True,
        mirrors=True,
        gradient_sky=True,
    )
    camera = tracer.scene.camera.struct(size, size)

    def picture(kernel, geometry, shading):
        film = Film((0, size), size, ["color"], None, 8, tracer.device, threads)
        launch(kernel, size * size, [geometry, shading, camera, film.struct, 1], tracer.device, threads)
        return film.arrays(1)["color"]

    def recast(make, spec, struct):
        other = make(spec)()
        for name in struct._cls.vars:
            setattr(other, name, getattr(struct, name))
        return other

    kernels = {
        "for what is there": (make_render(look), scene.struct, lights),
        "for everything": (
            make_render(everything),
            recast(scene_struct, everything.spec, scene.struct),
            recast(look_struct, everything, lights),
        ),
    }
    pictures = [picture(*arguments) for arguments in kernels.values()]
    if not np.array_equal(*pictures):
        raise ValueError("the two kernels of the specialisation benchmark gave different pictures")
    seconds = alternating({name: lambda a=arguments: picture(*a) for name, arguments in kernels.items()}, rounds)
    special, general = seconds.values()
    return {
        "showcase": {
            "seconds": {name: float(np.median(times)) for name, times in seconds.items()},
            "gain": ratio(general, special),
            "unused": sorted(
                [kind.name.lower() for kind in set(ShapeKind) - scene.spec.shapes]
                + [
                    name
                    for name in ("point_lights", "directional_lights", "mirrors", "gradient_sky")
                    if not getattr(look, name)
                ]
            ),
        }
    }


def table(results: dict) -> str:
    """A few lines."""
    lines = []
    for name, entry in results.items():
        lines += [f"{name}, {kernel}: {1e3 * seconds:.0f} ms" for kernel, seconds in entry["seconds"].items()]
        lines.append(f"leaving out {', '.join(entry['unused'])} makes it {entry['gain']:.2f} times as fast")
    return "\n".join(lines)
