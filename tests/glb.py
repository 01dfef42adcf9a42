"""GLB files made by hand."""

import json
import struct

import numpy as np

COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])


class Glb:
    """The JSON of a file, as a dictionary that tests may change, and its bytes."""

    def __init__(self, **lists):
        self.json = {"asset": {"version": "2.0"}, **lists}
        self.binary = b""

    def add(self, kind, value):
        self.json.setdefault(kind, []).append(value)
        return len(self.json[kind]) - 1

    def view(self, data, **more):
        self.binary += b"\0" * (-len(self.binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **more}
        self.binary += bytes(data)
        self.json["buffers"] = [{"byteLength": len(self.binary)}]
        return self.add("bufferViews", view)

    def array(self, values, dtype="f4", **more):
        values = np.asarray(values).astype(dtype)
        width = 1 if values.ndim == 1 else values.shape[1]
        accessor = {"componentType": COMPONENTS[dtype], "count": len(values), "type": KINDS[width]}
        return self.add("accessors", {"bufferView": self.view(values.tobytes()), **accessor, **more})

    def mesh(self, vertices=TRIANGLE, faces=None, attributes=(), **primitive):
        attributes = {"POSITION": self.array(vertices), **dict(attributes)}
        if faces is not None:
            primitive["indices"] = self.array(np.ravel(faces), "u4")
        return self.add("meshes", {"primitives": [{"attributes": attributes, **primitive}]})

    def node(self, **node):
        return self.add("nodes", node)

    def bytes(self):
        text = json.dumps(self.json).encode()
        chunks = b""
        for kind, data, filler in ((0x4E4F534A, text, b" "), (0x004E4942, self.binary, b"\0")):
            if data:
                data += filler * (-len(data) % 4)
                chunks += struct.pack("<II", len(data), kind) + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def save(self, path):
        path.write_bytes(self.bytes())
        return path


def triangle_glb(**node):
    """One node with one triangle."""
    glb = Glb()
    glb.node(mesh=glb.mesh(), **node)
    return glb


def matrices(scene):
    """(N, 4, 4): the world_from_local of all placements of a scene, by instance id."""
    parts = [getattr(item, "world_from_local", None) for item in scene.objects]
    parts = [
        item.transform.world_from_local[None] if part is None else part
        for item, part in zip(scene.objects, parts, strict=True)
    ]
    return np.concatenate(parts) if parts else np.zeros((0, 4, 4))
