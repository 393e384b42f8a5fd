"""Buildings of known truth in the files of strangers, written from the specifications of the formats alone."""

from tests.importing.strangers import drawings, maps, solids

#: What writes a file of each format: of a seed and a folder, a `Stranger`.
FORMATS = {
    "osm": maps.osm,
    "imdf": maps.imdf,
    "fds": solids.fds,
    "dxf": drawings.dxf,
    "ifc": solids.ifc,
}
