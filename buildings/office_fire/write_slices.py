"""Write the slice files of the shipped case office_fire: ``python write_slices.py``, in this folder.

The values are synthetic: formulas for smoke that fills the western stair of the building, not the result of a fire
simulation. `office_fire.fds` is the input with which FDS would compute such files. Tests write other files with
`write_slices`.
"""

from pathlib import Path

import numpy as np

#: Units of quantities as FDS writes them; others are fractions.
UNITS = {"SOOT EXTINCTION COEFFICIENT": "1/m", "EXTINCTION COEFFICIENT": "1/m", "TEMPERATURE": "C"}
UNITS |= {"INTEGRATED INTENSITY": "kW/m2"}

EXTINCTION, CO = "SOOT EXTINCTION COEFFICIENT", "CARBON MONOXIDE VOLUME FRACTION"


def record(data):
    """Return a record of Fortran: bytes between their numbers."""
    return len(data).to_bytes(4, "little") + data + len(data).to_bytes(4, "little")


def nodes_of(box, cell):
    """Return the coordinates of the nodes of a mesh along x, y and z."""
    return [
        np.linspace(low, high, round((high - low) / cell) + 1) for low, high in zip(box[::2], box[1::2], strict=True)
    ]


def write_slices(folder, meshes, slices, times, cell=0.5, name="fire"):
    """Write the files; return the path of the Smokeview file and the values of each slice file.

    Parameters
    ----------
    folder : path
    meshes : list of (x1, x2, y1, y2, z1, z2)
    slices : list of (quantity, z, is_centred, function)
        At a height z, in a volume if it is None, or in the box (x1, x2, y1, y2, z1, z2); the function gives values at
        (x, y, z, time).
    times : list of float
    cell : float
        Side of the cells [m].
    name : str
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
            if isinstance(z, tuple):
                if z[0] < own[0][0] or z[1] > own[0][-1]:
                    continue
                ends = zip(own, z[::2], z[1::2], strict=True)
                bounds = [[int(np.abs(axis - end).argmin()) for end in (low, high)] for axis, low, high in ends]
            elif z is not None:
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
                f" {UNITS.get(quantity, 'mol/mol')}",
            ]
    path = folder / f"{name}.smv"
    path.write_text("\n".join(lines) + "\n")
    return path, written


#: Plan of the building, see case.toml: the offices above, and the hall below, which is longer by the stairs.
HALL = [(-9.0, 33.0, 0.0, 12.0, -0.5, 6.5)]
STAIRS = [(-6.0, 0.0, 5.0, 7.0, 0.5, 5.5), (24.0, 30.0, 5.0, 7.0, 0.5, 5.5)]


def smoke(x, y, z, time):
    """Return K [1/m]: smoke of a fire at x = -7 m spreads in the hall, and up the western stair to the offices."""
    below = 6.0 * np.clip((time - 10.0 - np.abs(x + 7.0) / 0.25) / 90.0, 0.0, 1.0) * np.exp(-np.abs(x + 7.0) / 12.0)
    above = 5.0 * np.clip((time - 30.0 - (x + 6.0) / 0.12) / 90.0, 0.0, 1.0) * np.exp(-np.maximum(x, 0.0) / 9.0)
    rise = np.clip((z - 1.5) / 3.0, 0.0, 1.0)  # from the heads of the hall to those of the offices
    return np.round((1.0 - rise) * below + rise * above, 3)


#: Quantities as FDS writes them, and how they follow from K.
QUANTITIES = {
    EXTINCTION: lambda k: k,
    CO: lambda k: 250e-6 * k,
    "CARBON DIOXIDE VOLUME FRACTION": lambda k: 4e-4 + 3.5e-3 * k,
    "OXYGEN VOLUME FRACTION": lambda k: 0.209 - 4e-3 * k,
    "TEMPERATURE": lambda k: 20.0 + 12.0 * k,
}

if __name__ == "__main__":
    slices = [
        (quantity, place, False, lambda x, y, z, t, of_smoke=of_smoke: of_smoke(smoke(x, y, z, t)))
        for quantity, of_smoke in QUANTITIES.items()
        for place in (1.5, 4.5, *STAIRS)
    ]
    write_slices(Path(__file__).parent, HALL, slices, np.arange(0.0, 301.0, 20.0), 1.0, "office_fire")
