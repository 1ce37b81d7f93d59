"""Files of points as other programs write them."""

import laspy
import numpy as np

__all__ = ["PLACES", "RGB", "las", "ply", "vertices"]

CHANCE = np.random.default_rng(11)
PLACES = CHANCE.integers(-1000, 1000, (3000, 3)) * 0.01 + [4000.0, 500.0, 20.0]
RGB = CHANCE.integers(0, 256, (3000, 3))


def las(path, *, rgb=None, intensity=None, places=PLACES, version="1.4", point_format=7, wkt=None):
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = np.full(3, 0.01), np.array([4000.0, 500.0, 0.0])
    if wkt:
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
    data = laspy.LasData(header)
    data.x, data.y, data.z = np.asarray(places, dtype=float).T
    if rgb is not None:
        data.red, data.green, data.blue = np.asarray(rgb, dtype=np.uint16).T
    if intensity is not None:
        data.intensity = np.asarray(intensity, dtype=np.uint16)
    data.write(str(path))
    return path


def ply(path, fields, order="<", extra=""):
    """A PLY whose vertices have these named arrays."""
    kinds = {"f4": "float", "f8": "double", "u1": "uchar", "u2": "ushort", "i4": "int"}
    names = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}
    arrays = {name: np.asarray(values) for name, values in fields.items()}
    count = len(next(iter(arrays.values())))
    lines = ["ply", f"format {names[order]} 1.0", "comment of a test", f"element vertex {count}"]
    lines += [f"property {kinds[array.dtype.str[1:]]} {name}" for name, array in arrays.items()]
    head = "\n".join([*lines, *([extra] if extra else []), "end_header\n"]).encode()
    if order:
        rows = np.empty(count, [(name, order + array.dtype.str[1:]) for name, array in arrays.items()])
        for name, array in arrays.items():
            rows[name] = array
        body = rows.tobytes()
    else:
        lines = [" ".join(repr(value.item()) for value in row) for row in zip(*arrays.values(), strict=True)]
        body = ("\n".join(lines) + "\n").encode()
    path.write_bytes(head + body)
    return path


def vertices(places=PLACES, kind=np.float64):
    return {name: places[:, axis].astype(kind) for axis, name in enumerate("xyz")}
