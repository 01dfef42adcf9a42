"""The tree of nodes of a glTF file: where things stand in the world."""

from collections.abc import Iterator

import numpy as np

from .brief import shown
from .gltf import Document
from .gltf_accessors import read_floats
from .json_record import Record
from .quaternions import compose

NODE_BYTES = 512
"""Memory of a node: two matrices, and what Python needs to know of it."""
COPY_BYTES = 256
"""Memory of the matrix of a copy, and of the numbers that it is made of."""


def walk(document: Document) -> Iterator[tuple[Record, np.ndarray]]:
    """(node, world_from_node) of the nodes of the scene to show, parents before children, in the order of the file.

    Raises ValueError where a node has two parents, or is its own ancestor.
    """
    nodes, parents = _tree(document)
    document.rules.charge(NODE_BYTES * len(nodes), "the tree of nodes")
    world_from_node = np.empty((len(nodes) + 1, 4, 4))
    world_from_node[0] = np.eye(4)
    with np.errstate(all="ignore"):  # what overflows is found out later, if it matters
        for k, (parent, parent_from_node) in enumerate(zip(parents, _parent_from_node(nodes), strict=True)):
            np.matmul(world_from_node[parent], parent_from_node, out=world_from_node[k + 1])
    return zip(nodes, world_from_node[1:], strict=True)


def _tree(document: Document) -> tuple[list[Record], list[int]]:
    """(nodes, the place of each one's parent among them, counted from 1, or 0)."""
    nodes, parents, seen = [], [], set()
    stack = [(index, 0) for index in reversed(_roots(document))]
    while stack:
        index, parent = stack.pop()
        node = document.find("nodes", index, "the tree of nodes")
        if index in seen:
            raise ValueError(f"{node.name} is the child of two nodes, or of itself")
        seen.add(index)
        nodes.append(node)
        parents.append(parent)
        stack += [(child, len(nodes)) for child in reversed(node.integers("children"))]
    return nodes, parents


def _roots(document: Document) -> list[int]:
    """The nodes that the scene to show starts from; without scenes, those that are no other node's child."""
    scenes = document.root.values("scenes")
    number = document.root.integer("scene", 0)
    if scenes or "scene" in document.root:
        scene = document.find("scenes", number, "scene")
        document.note_extensions(scene)
        for other in range(len(scenes)):
            if other != number:
                name = document.find("scenes", other, "scenes").name
                document.notes.add(f"{{}} is not shown; {scene.name} is", name)
        return scene.integers("nodes")
    count = len(document.root.values("nodes"))
    children = {c for i in range(count) for c in document.find("nodes", i, "nodes").integers("children")}
    return [i for i in range(count) if i not in children]


def _parent_from_node(nodes: list[Record]) -> np.ndarray:
    """(N, 4, 4) float64: the matrix of each node, or its T R S."""
    result = np.tile(np.eye(4), (len(nodes), 1, 1))
    turned, rotations, scales = [], [], []
    for i, node in enumerate(nodes):
        if "matrix" in node:
            result[i] = _matrix(node)
            continue
        if "translation" in node:
            result[i, :3, 3] = node.numbers("translation", 3)
        scale = node.numbers("scale", 3) if "scale" in node else np.ones(3)
        if "rotation" not in node:
            if "scale" in node:
                result[i, [0, 1, 2], [0, 1, 2]] = scale
            continue
        rotation = node.numbers("rotation", 4)
        if not rotation.any():
            raise ValueError(f"{node.name}: rotation must not be zero")
        turned.append(i)
        rotations.append(rotation)
        scales.append(scale)
    if turned:
        result[turned] = compose(result[turned, :3, 3], np.array(rotations), np.array(scales))
    return result


def _matrix(node: Record) -> np.ndarray:
    if any(key in node for key in ("translation", "rotation", "scale")):
        raise ValueError(f"{node.name} has both a matrix and a translation, rotation or scale")
    matrix = node.numbers("matrix", 16).reshape(4, 4).T
    if (matrix[3] != (0, 0, 0, 1)).any():
        raise ValueError(f"{node.name}: its matrix is projective; the last row is {matrix[3].tolist()}")
    return matrix


def copies(document: Document, node: Record) -> np.ndarray | None:
    """(N, 4, 4): node_from_copy of EXT_mesh_gpu_instancing, or None without it."""
    extensions = node.record("extensions", {})
    if "EXT_mesh_gpu_instancing" not in extensions:
        return None
    attributes = extensions.record("EXT_mesh_gpu_instancing").record("attributes")
    values = {}
    for key, kind in (("TRANSLATION", "VEC3"), ("ROTATION", "VEC4"), ("SCALE", "VEC3")):
        if key in attributes:
            values[key] = read_floats(document, attributes.integer(key), (kind,), f"{node.name}: {key} of its copies")
    for key in attributes:
        if key not in values:
            document.notes.add(
                f"{{}}: the attribute {shown(key)} of its copies is not understood and left out", node.name
            )
    counts = {len(value) for value in values.values()}
    if len(counts) != 1:
        raise ValueError(
            f"{node.name}: EXT_mesh_gpu_instancing needs a TRANSLATION, ROTATION or SCALE, each of the same length; "
            f"got { ({key: len(value) for key, value in values.items()}) }"
        )
    count = counts.pop()
    document.rules.charge(COPY_BYTES * count, f"{node.name}: its copies")
    translation = values.get("TRANSLATION", np.zeros((count, 3)))
    rotation = values.get("ROTATION", np.broadcast_to((0.0, 0.0, 0.0, 1.0), (count, 4)))
    is_zero = (rotation == 0).all(axis=1)
    if is_zero.any():
        raise ValueError(f"{node.name}: ROTATION of its copies must not be zero; number {int(np.argmax(is_zero))} is")
    return compose(translation, rotation, values.get("SCALE", np.ones((count, 3))))
