"""Ray tracing of instanced scenes with NVIDIA Warp kernels, on CPU and GPU."""

from pathlib import Path

# A checkout keeps the device code and the scenes beside this package; the wheel puts them inside.
if not (Path(__file__).parent / "kernels").is_dir():
    __path__.append(str(Path(__file__).parents[1]))

from ._version import __version__ as __version__
from .all_hits import AllHits as AllHits
from .audit import Audit as Audit
from .audit import audit as audit
from .camera import Camera as Camera
from .cameras import EquirectangularCamera as EquirectangularCamera
from .cameras import FisheyeCamera as FisheyeCamera
from .cameras import OrthographicCamera as OrthographicCamera
from .hits import Hits as Hits
from .image import Image as Image
from .lights import AmbientLight as AmbientLight
from .lights import DirectionalLight as DirectionalLight
from .lights import PointLight as PointLight
from .lights import RectangleLight as RectangleLight
from .lights import SpotLight as SpotLight
from .materials import Material as Material
from .matrix_camera import MatrixCamera as MatrixCamera
from .measure import Measured as Measured
from .measure import measure as measure
from .mesh import Mesh as Mesh
from .pool import WorkerPool as WorkerPool
from .scene import Instance as Instance
from .scene import Instances as Instances
from .scene import Scene as Scene
from .scene_files import load_scene as load_scene
from .shapes import Box as Box
from .shapes import Capsule as Capsule
from .shapes import Cone as Cone
from .shapes import Cylinder as Cylinder
from .shapes import Disk as Disk
from .shapes import Plane as Plane
from .shapes import Sphere as Sphere
from .sky import GradientSky as GradientSky
from .sky import ImageSky as ImageSky
from .stream import cast_file as cast_file
from .texture import Texture as Texture
from .tracer import Tracer as Tracer
from .transform import Transform as Transform
from .tune import Tuning as Tuning
from .tune import tune as tune
from .viewer import view as view
from .walk import CellWalk as CellWalk
