"""Writes Smokeview and slice files as FDS does, with values of a function of place and time."""

from pathlib import Path

import numpy as np

EXTINCTION, CO = "SOOT EXTINCTION COEFFICIENT", "CARBON MONOXIDE VOLUME FRACTION"


def record(data):
    return len(data).to_bytes(4, "little") + data + len(data).to_bytes(4, "little")


def nodes_of(box, cell):
    return [
        np.linspace(low, high, round((high - low) / cell) + 1) for low, high in zip(box[::2], box[1::2], strict=True)
    ]


def write_slices(folder, meshes, slices, times, cell=0.5, name="fire"):
    """Write the files; return the path of the Smokeview file and the values of each slice file.

    `meshes` are boxes (x1, x2, y1, y2, z1, z2). Each of `slices` is (quantity, z, is_centred, function), where z is a
    height, or None for a volume, and the function gives values at (x, y, z, time).
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    lines, written = ["TITLE", " synthetic", "", "VERSION", " FDS6.9.1", "", "CHID", f" {name}", ""], {}
    axes = [nodes_of(box, cell) for box in meshes]
    for k, (box, own) in enumerate(zip(meshes, axes, strict=True), start=1):
        cells = " ".join(str(len(axis) - 1) for axis in own)
        lines += [f"GRID  MESH_{k}", f"  {cells} 0", "", "PDIM", "  " + " ".join(f"{end:.6f}" for end in box), ""]
        for letter, axis in zip("XYZ", own, strict=True):
            lines += [f"TRN{letter}", "   0", *(f"  {index}  {value:.6f}" for index, value in enumerate(axis)), ""]
        lines += ["OBST", "   0", "", "VENT", "   0   0", "", "CVENT", "   0", ""]
    for number, (quantity, z, is_centred, function) in enumerate(slices, start=1):
        for k, own in enumerate(axes, start=1):
            bounds = [[0, len(axis) - 1] for axis in own]
            if z is not None:
                if not own[2][0] - 1e-9 <= z <= own[2][-1] + 1e-9:
                    continue
                nearest = int(np.abs(own[2] - z).argmin())
                bounds[2] = [max(nearest, 1), max(nearest, 1)] if is_centred else [nearest, nearest]
            places = []
            for axis, (first, last) in zip(own, bounds, strict=True):
                at = axis[first : last + 1]
                if is_centred:
                    before = axis[np.maximum(np.arange(first, last + 1) - 1, 0)]
                    at = 0.5 * (at + before)
                places.append(at)
            grid = np.meshgrid(*places, indexing="ij")
            file = f"{name}_{number:02d}_{k}.sf"
            head = b"".join(record(text[:30].ljust(30).encode()) for text in (quantity, "short", "unit"))
            data = [head, record(np.array(bounds, "<i4").ravel().tobytes())]
            values = []
            for time in times:
                value = np.broadcast_to(function(*grid, time), grid[0].shape).astype("<f4")
                values.append(value)
                data += [record(np.array([time], "<f4").tobytes()), record(value.T.tobytes())]
            (folder / file).write_bytes(b"".join(data))
            written[file] = np.array(values)
            key = "SLCC" if is_centred else "SLCF"
            ends = " ".join(f"{one:5d}" for pair in bounds for one in pair)
            lines += [
                f"{key}     {k} # STRUCTURED &{ends} !     {number}",
                f" {file}",
                f" {quantity}",
                " short",
                " unit",
            ]
    path = folder / f"{name}.smv"
    path.write_text("\n".join(lines) + "\n")
    return path, written
