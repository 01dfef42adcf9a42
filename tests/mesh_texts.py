"""Mesh files of polygons, written by hand in every format, and the faces that reading them should give."""

import struct

import numpy as np

import warprt as rt

V = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
BOTH = CORNERS[[[0, 1, 2], [0, 2, 3]]]
SOLID = """solid a vertex of endsolid
  facet normal 0 0 1
    outer loop
      vertex 0 0 0
      vertex 1 0 0
      vertex 1 1 0
    endloop
  endfacet
endsolid a
"""
_LETTERS = {"uchar": "B", "char": "b", "ushort": "H", "short": "h", "int": "i", "uint": "I"}


def obj(vertices, polygons) -> bytes:
    rows = ["v " + " ".join(map(repr, map(float, v))) for v in vertices]
    rows += ["f " + " ".join(str(k + 1) for k in polygon) for polygon in polygons]
    return "\n".join([*rows, ""]).encode()


def off(vertices, polygons) -> bytes:
    rows = ["OFF", f"{len(vertices)} {len(polygons)} 0", *(" ".join(map(repr, map(float, v))) for v in vertices)]
    rows += [" ".join(map(str, (len(polygon), *polygon))) for polygon in polygons]
    return "\n".join([*rows, ""]).encode()


def ply(vertices, polygons, style="ascii", count="uchar", index="int", real="double", face_extra="", extra=()) -> bytes:
    """face_extra: a property of uchar behind the list, whose values are `extra`."""
    head = f"ply\nformat {style} 1.0\ncomment made by hand\nelement vertex {len(vertices)}\n"
    head += "".join(f"property {real} {axis}\n" for axis in "xyz")
    head += f"element face {len(polygons)}\nproperty list {count} {index} vertex_indices\n"
    head += f"property uchar {face_extra}\n" if face_extra else ""
    extra = list(extra) if face_extra else [()] * len(polygons)
    rows = [(len(polygon), *polygon, *np.atleast_1d(value)) for polygon, value in zip(polygons, extra, strict=True)]
    if style == "ascii":
        body = "".join(" ".join(map(repr, map(float, v))) + "\n" for v in vertices)
        body += "".join(" ".join(str(int(number)) for number in row) + "\n" for row in rows)
        return (head + "end_header\n" + body).encode()
    order = ">" if "big" in style else "<"
    body = np.array(vertices, order + ("f8" if real == "double" else "f4")).tobytes()
    tail = "B" if face_extra else ""
    for row, polygon in zip(rows, polygons, strict=True):
        body += struct.pack(order + _LETTERS[count] + _LETTERS[index] * len(polygon) + tail, *map(int, row))
    return (head + "end_header\n").encode() + body


def stl(vertices, polygons) -> bytes:
    """Fans of the polygons."""
    body = b""
    for polygon in polygons:
        for k in range(1, len(polygon) - 1):
            corners = [vertices[i] for i in (polygon[0], polygon[k], polygon[k + 1])]
            body += struct.pack("<12fH", 0, 0, 0, *np.ravel(corners), 0)
    return b"\0" * 80 + struct.pack("<I", len(body) // 50) + body


def random_polygons(rng, count: int, most: int) -> tuple[list, list, np.ndarray]:
    """(vertices, polygons, corners of their triangles): convex polygons that lie about, and their fans."""
    sizes = rng.integers(3, most + 1, count)
    rings = []
    for k, size in enumerate(sizes):
        angle = 2 * np.pi * np.arange(size) / size
        ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        # In float32, so that any format can hold them.
        rings.append(np.float32(ring @ turn + (3 * k, 0, 0)))
    corners = np.concatenate(rings).astype(float)
    number = rng.permutation(len(corners))
    vertices = np.empty_like(corners)
    vertices[number] = corners
    polygons = [tuple(ring.tolist()) for ring in np.split(number, np.cumsum(sizes)[:-1])]
    fans = [(p[0], p[k], p[k + 1]) for p in polygons for k in range(1, len(p) - 1)]
    return vertices.tolist(), polygons, vertices[np.array(fans)]


def textured_ply(picture: str) -> str:
    text = f"ply\nformat ascii 1.0\ncomment TextureFile {picture}\nelement vertex 3\n"
    text += "".join(f"property float {axis}\n" for axis in "xyzst")
    text += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    return text + "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n3 0 1 2\n"


def read(folder, name, data, **options):
    (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    return rt.Mesh.from_file(folder / name, **options)


def triangles(mesh):
    return mesh.vertices[mesh.faces]
