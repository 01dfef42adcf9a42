"""The command line: render, view, tradeoff, audit, bench, info."""

import argparse
import ast
import sys
import warnings
from pathlib import Path

import warp as wp

from . import launch
from ._version import __version__
from .image import OUTPUTS, TONES
from .quiet import start_warp
from .scene_files import load_scene, ready_scenes
from .tracer import ACCELERATORS, INTEGRATORS, TIERS


class _Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line."""

    def error(self, message):
        print(f"{self.prog}: {message}; see {self.prog} --help", file=sys.stderr)
        sys.exit(2)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; the exit status is 0, or 2 after a user's mistake."""
    options = _parser().parse_args(arguments)
    options.arguments = sys.argv[1:] if arguments is None else list(arguments)
    launch.on_compile = _announce_compile
    try:
        start_warp()
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            options.run(options)
    except (ValueError, OSError, MemoryError) as error:
        print(f"warprt: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(f"warprt: {str(stop) or 'interrupted'}", file=sys.stderr)
        return 130
    return 0


def _show_warning(message, *_, **__) -> None:
    print(f"warprt: warning: {message}", file=sys.stderr)


def _parser() -> _Parser:
    parser = _Parser(prog="warprt", description="Ray tracing of instanced scenes with NVIDIA Warp kernels.")
    parser.add_argument("--version", action="version", version=f"warprt {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    render = commands.add_parser("render", help="make a picture of a scene")
    _add_scene(render, has_options=True)
    render.add_argument("-o", "--output", metavar="FILE", help="default: the scene's name with .png, here")
    render.add_argument("--size", type=_size, default=(640, 480), metavar="WxH", help="pixels; default 640x480")
    render.add_argument("--samples", type=int, default=4, metavar="N", help="rays per pixel; default 4")
    render.add_argument("--noise", type=float, metavar="X", help="pixels with less take fewer samples; try 0.01")
    render.add_argument("--integrator", default="whitted", metavar="I", help=f"{' or '.join(INTEGRATORS)}")
    render.add_argument("--max-bounces", type=int, metavar="N", help="default 8; 64 with --integrator path")
    render.add_argument("--accuracy", default="robust", metavar="T", help=f"{' or '.join(TIERS)}; default robust")
    render.add_argument("--device", metavar="D", help="cpu, cuda:0, ...; default: the GPU if there is one")
    render.add_argument("--threads", type=int, metavar="N", help="CPU threads; default: all cores")
    render.add_argument("--accelerator", default="grid", metavar="A", help=" or ".join(ACCELERATORS))
    render.add_argument("--outputs", default="color", metavar="NAMES", help=f"of {','.join(OUTPUTS)}")
    render.add_argument("--exposure", type=float, default=1.0, metavar="X", help="factor of the light; default 1")
    render.add_argument("--tone", default="srgb", metavar="T", help=f"{' or '.join(TONES)}; default srgb")
    render.add_argument("--turntable", type=int, metavar="N", help="N pictures around the scene, and a moving one")
    render.add_argument("--workers", type=int, metavar="N", help="processes here, a GPU each; 0: all there is")
    render.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster, such as tcp://host:8786")
    render.add_argument("--tile", type=float, metavar="RAYS", help="camera rays of a piece of work for them")
    render.add_argument("--resume", action="store_true", help="go on with what was interrupted")
    render.add_argument("--no-clobber", action="store_true", help="refuse to replace a file")
    render.set_defaults(run=_render)
    view = commands.add_parser("view", help="look at a scene in a web page, and at the cells that rays visit")
    _add_scene(view, has_options=True)
    view.add_argument("--size", type=_size, default=(640, 480), metavar="WxH", help="of the result; default 640x480")
    view.add_argument("--samples", type=int, default=16, metavar="N", help="rays per pixel at rest; default 16")
    view.add_argument("--max-bounces", type=int, default=8, metavar="N", help="mirror reflections; default 8")
    view.add_argument("--accuracy", default="robust", metavar="T", help=f"{' or '.join(TIERS)}; default robust")
    view.add_argument("--device", metavar="D", help="cpu, cuda:0, ...; default: the GPU if there is one")
    view.add_argument(
        "--host", default="127.0.0.1", metavar="A", help="address to listen on; default: this machine only"
    )
    view.add_argument("--port", type=int, default=8080, metavar="N", help="or the next one that is free; default 8080")
    view.add_argument("--no-browser", action="store_true", help="do not open the page, only say where it is")
    view.set_defaults(run=_view)
    bench = commands.add_parser("bench", help="measure against wp.Mesh, Embree and Mitsuba")
    topics = [
        "rates",
        "resolution",
        "scaling",
        "instances",
        "specialisation",
        "leaks",
        "all-hits",
        "mitsuba",
        "paths",
        "workers",
    ]
    bench.add_argument("topic", nargs="?", default="rates", choices=topics)
    bench.add_argument("--quick", action="store_true", help="fewer and smaller meshes: under a minute")
    bench.add_argument(
        "--mesh", nargs="+", default=[], metavar="FILE", help="measure these, or blob:20000 and the like"
    )
    bench.add_argument("--subdivide", type=int, default=0, metavar="N", help="also the first file, faces cut into 4^N")
    bench.add_argument("--field", metavar="FILE", help="also this mesh, small in the middle of a wide field")
    bench.add_argument("--size", type=int, metavar="N", help="at most N x N rays of a kind; default 512")
    bench.add_argument("--rays", type=float, metavar="N", help="for leaks (of each aim) and all-hits; default 1e6")
    bench.add_argument(
        "--accuracy", default="robust", metavar="T,...", help="for leaks: tiers, or tier:rays; default robust"
    )
    bench.add_argument("--threads", type=int, metavar="N", help="of all that can use several; default: all cores")
    bench.add_argument("-o", "--output", type=Path, metavar="JSON", help="write the figures, machine and versions")
    bench.add_argument("--plot", type=Path, metavar="PNG", help="draw the ratios")
    bench.set_defaults(run=_bench)
    audit = commands.add_parser("audit", help="which accuracy a scene needs")
    _add_scene(audit)
    audit.add_argument(
        "--tolerance", type=float, metavar="X", help="of a hit along its ray; default 1e-6 of the extent"
    )
    audit.add_argument("--device", metavar="D", help="cpu, cuda:0, ...; default: the GPU if there is one")
    audit.add_argument("--threads", type=int, metavar="N", help="CPU threads; default: all cores")
    audit.set_defaults(run=_audit)
    tradeoff = commands.add_parser("tradeoff", help="what speed costs in accuracy, on a scene")
    _add_scene(tradeoff)
    tradeoff.add_argument("--accuracy", default=",".join(TIERS), metavar="T,...", help="tiers; default all")
    tradeoff.add_argument("--rays", type=int, default=100_000, metavar="N", help="default 100,000")
    tradeoff.add_argument("--rounds", type=int, default=7, metavar="N", help="of the timing; default 7")
    tradeoff.add_argument("--device", metavar="D", help="cpu, cuda:0, ...; default: the GPU if there is one")
    tradeoff.add_argument("--threads", type=int, metavar="N", help="CPU threads; default: all cores")
    tradeoff.add_argument("-o", "--output", type=Path, metavar="JSON", help="write the figures, machine and versions")
    tradeoff.add_argument("--plot", type=Path, metavar="PNG", help="draw time against error")
    tradeoff.set_defaults(run=_tradeoff)
    info = commands.add_parser("info", help="versions, devices, ready scenes")
    info.set_defaults(run=_info)
    return parser


def _add_scene(command: argparse.ArgumentParser, has_options: bool = False) -> None:
    """The scene that a command is about, and how it is read."""
    command.add_argument(
        "scene", metavar="SCENE", help="a file (.py .cfg .glb .gltf .obj .ply .stl .off) or a ready scene"
    )
    command.add_argument(
        "--trust", action="store_true", help="let the file name any other file, and take any amount of memory"
    )
    if has_options:
        command.add_argument(
            "--option",
            action="append",
            default=[],
            type=_option,
            metavar="NAME=VALUE",
            help="for scene() of a Python file",
        )


def _bench(options: argparse.Namespace) -> None:
    # Only here: it brings in peers, which are large.
    from warprt.benchmarks.command import run

    run(options)


def _audit(options: argparse.Namespace) -> None:
    from .audit import audit

    scene = load_scene(options.scene, options.trust)
    print(audit(scene, options.tolerance, device=options.device, threads=options.threads))


def _tradeoff(options: argparse.Namespace) -> None:
    from warprt.benchmarks.tradeoff import run

    run(options)


def _size(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdecimal() and height.isdecimal() and int(width) > 0 and int(height) > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, such as 640x480")
    return int(width), int(height)


def _option(text: str) -> tuple[str, object]:
    name, equals, value = text.partition("=")
    if not (equals and name.isidentifier()):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE, such as size=5")
    if name in ("path", "trust"):
        raise argparse.ArgumentTypeError(
            f"{name!r} is a parameter of load_scene, so no option of scene() can have this name"
        )
    try:
        return name, ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return name, value


def _announce_compile() -> None:
    print("Compiling kernels for a new kind of scene; they are kept for the next time ...", file=sys.stderr, flush=True)


def _render(options: argparse.Namespace) -> None:
    from .rendering import run

    run(options)


def _view(options: argparse.Namespace) -> None:
    from .viewer.command import run

    run(options)


def _info(_options: argparse.Namespace) -> None:
    import numpy as np

    print(f"warprt {__version__}, warp {wp.__version__}, numpy {np.__version__}, python {sys.version.split()[0]}")
    for device in wp.get_devices():
        detail = f"{launch.default_threads()} threads" if device.is_cpu else device.name
        print(f"device {device.alias}: {detail}{', default' if device == wp.get_device() else ''}")
    print(f"accuracy: {', '.join(TIERS)}")
    print(f"kernel cache: {wp.config.kernel_cache_dir}")
    print(f"ready scenes: {', '.join(ready_scenes())}")


if __name__ == "__main__":
    sys.exit(main())
