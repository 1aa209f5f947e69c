"""Binary little-endian PLY, as far as the benchmark needs it: triangle meshes and bare point clouds of float x y z."""

import numpy as np

_NUMPY_TYPE = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "<i2", "int16": "<i2", "ushort": "<u2", "uint16": "<u2",
    "int": "<i4", "int32": "<i4", "uint": "<u4", "uint32": "<u4", "float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8",
}  # fmt: skip


def _header(path, data):
    """The elements of the header, as (name, count, properties) in file order, and where the body starts."""
    mark = b"end_header\n"
    end = data.find(mark)
    if not data.startswith(b"ply\n") or end < 0:
        raise ValueError(f"{path}: not a PLY file")
    elements = []
    for line in data[:end].decode("ascii").splitlines()[1:]:
        word, *rest = line.split()
        if word == "format" and rest[0] != "binary_little_endian":
            raise ValueError(f"{path}: format {rest[0]}, expected binary_little_endian")
        if word == "element":
            elements.append((rest[0], int(rest[1]), []))
        if word == "property":
            elements[-1][2].append(rest)
    return elements, end + len(mark)


def _vertices(path, data):
    """Points (n, 3) in float64, the elements that follow, and where they start."""
    elements, start = _header(path, data)
    name, count, properties = elements[0]
    if name != "vertex" or any(kind == "list" for kind, *_ in properties):
        raise ValueError(f"{path}: the first element is not a list of plain vertices")
    row = np.dtype([(field, _NUMPY_TYPE[kind]) for kind, field in properties])
    table = np.frombuffer(data, row, count, start)
    points = np.column_stack([table[axis] for axis in "xyz"]).astype(float)
    return points, elements[1:], start + count * row.itemsize


def read_points(path):
    """The vertices of a cloud or mesh: (n, 3)."""
    with open(path, "rb") as file:
        return _vertices(path, file.read())[0]


def read_mesh(path):
    """Vertices (n, 3) and triangles (m, 3) of a mesh whose only face property is a list of three indices."""
    with open(path, "rb") as file:
        data = file.read()
    points, elements, start = _vertices(path, data)
    name, count, properties = elements[0] if elements else ("", 0, [])
    if name != "face" or len(properties) != 1 or properties[0][0] != "list":
        raise ValueError(f"{path}: no plain list of faces")
    _, length, index, _ = properties[0]
    row = np.dtype([("length", _NUMPY_TYPE[length]), ("corners", _NUMPY_TYPE[index], 3)])
    table = np.frombuffer(data, row, count, start)
    if (table["length"] != 3).any():
        raise ValueError(f"{path}: a face is not a triangle")
    return points, table["corners"].astype(int)


def write_points(path, points):
    """A cloud, as float x y z."""
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    with open(path, "wb") as file:
        file.write(header.encode("ascii"))
        file.write(np.ascontiguousarray(points, "<f4").tobytes())
