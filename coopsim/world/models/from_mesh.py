"""Custom models: from a trimesh object or a mesh file."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from coopsim.errors import InvalidValueError
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import as_numbers, frozen, require_finite
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model

if TYPE_CHECKING:
    import trimesh

_FARTHEST = 1e9  # in the mesh's units: beyond, numbers are too coarse for a shape, and merging vertices overflows


def model_from_mesh(
    mesh: trimesh.Trimesh | str | Path,
    name: str,
    label: ObjectClass,
    size_m: ArrayLike | None = None,
    *,
    tint: ArrayLike = 1.0,
    reflectivity: ArrayLike = 0.5,
) -> Model:
    """Make a rigid model from a mesh with x forward, y left and z up; its middle becomes the origin.

    A mesh with holes is accepted with a warning: LiDAR and cameras see every surface from both sides, so a ray that
    enters through a hole ends on the inside. Bodies that are inside out are turned.

    Args:
        mesh: a trimesh object, which is not changed, or the path of a file that trimesh can load (OBJ, PLY, STL, GLB).
        name: name of the model.
        label: its class.
        size_m: (3,) length, width and height to scale to; None: the mesh's own, in metres.
        tint: share of an actor's paint in the faces' colour, one number or (F,), in [0, 1]; the rest is the mesh's own
            colour, where it has colours by face or vertex.
        reflectivity: at the LiDAR's wavelength, one number or (F,), in [0, 1]; of retro-reflectors above.

    Raises:
        InvalidValueError: the file or its mesh is missing; no faces; faces with vertices that do not exist, or with
            inconsistent winding; a vertex that is not finite, or beyond 1e9; a flat mesh; a size or share out of
            range, so also more than 100 m, as a mesh in millimetres has without `size_m`.
    """
    of = f"of model {name!r}"
    solid = _loaded(mesh, of)
    points = np.asarray(solid.vertices, dtype=np.float64)
    used = points[np.unique(solid.faces)]
    low, high = used.min(axis=0), used.max(axis=0)
    extent = high - low
    if not (extent > 0).all():
        raise InvalidValueError(f"the mesh {of} must be a solid, but is flat: it measures {extent.tolist()} m")
    size = extent if size_m is None else frozen(size_m, (3,), np.float64, f"size_m {of}")
    return Model(
        name,
        label,
        size,
        (points - (low + high) / 2) * (size / extent),
        _turned_outwards(solid, of),
        _per_face(tint, len(solid.faces), f"tint {of}"),
        _per_face(reflectivity, len(solid.faces), f"reflectivity {of}"),
        _own_colors(solid),
    )


def _loaded(mesh: trimesh.Trimesh | str | Path, of: str) -> trimesh.Trimesh:
    """Return a checked copy, with vertices at the same place merged."""
    import trimesh  # here, because it takes long, and few have meshes

    if isinstance(mesh, (str, Path)):
        mesh = _read(Path(mesh), of)
    if not isinstance(mesh, trimesh.Trimesh):
        raise InvalidValueError(f"the mesh {of} must be a trimesh.Trimesh or the path of a file, got {mesh!r}")
    if not len(mesh.faces):
        raise InvalidValueError(f"the mesh {of} must have faces, got none")
    require_finite(np.asarray(mesh.vertices), f"vertices {of}")
    if np.abs(mesh.vertices).max() > _FARTHEST:
        raise InvalidValueError(f"vertices {of} must be within {_FARTHEST:g} of the origin along each axis")
    low, high = int(mesh.faces.min()), int(mesh.faces.max())
    if low < 0 or high >= len(mesh.vertices):
        wrong, last = (low if low < 0 else high), len(mesh.vertices) - 1
        raise InvalidValueError(f"faces {of} must be of vertices 0 to {last}, got {wrong}")
    solid = mesh.copy()
    solid.merge_vertices(merge_tex=True, merge_norm=True)
    return solid


def _read(path: Path, of: str) -> trimesh.Trimesh:
    if not path.is_file():
        raise InvalidValueError(f"the mesh {of}: there is no file {path}")
    import trimesh

    try:
        return trimesh.load_mesh(path)
    except Exception as error:
        # Each format's reader raises its own kind of errors.
        raise InvalidValueError(f"the mesh {of} cannot be read from {path}: {error}") from error


def _per_face(value: ArrayLike, count: int, what: str) -> Floats:
    """Return values (F,) from one number for all faces, or one for each."""
    numbers = as_numbers(value, np.float64, what)
    if numbers.shape not in ((), (count,)):
        raise InvalidValueError(f"{what} must be one number or {count}, got {numbers.size}")
    return np.broadcast_to(numbers, count)


def _own_colors(mesh: trimesh.Trimesh) -> NDArray[np.uint8]:
    """Return the colours (F, 3), or (0, 3) where the mesh has none by face or vertex."""
    from trimesh.visual import ColorVisuals

    visual = mesh.visual
    if isinstance(visual, ColorVisuals) and visual.kind in ("face", "vertex"):
        return np.asarray(visual.face_colors[:, :3], dtype=np.uint8)
    return np.zeros((0, 3), dtype=np.uint8)


def _turned_outwards(mesh: trimesh.Trimesh, of: str) -> Ints:
    """Return the faces (F, 3), counter-clockwise from outside where the mesh encloses a volume."""
    if not mesh.is_winding_consistent:
        raise InvalidValueError(
            f"faces {of} must all look outwards, but neighbours look different ways: mesh.fix_normals() may repair them"
        )
    faces = np.asarray(mesh.faces, dtype=np.int64)
    if not mesh.is_watertight:
        edges, count = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
        warnings.warn(
            f"the mesh {of} has holes ({(count == 1).sum()} of {len(edges)} edges belong to one face only): "
            "sensors see its inside through them",
            stacklevel=3,
        )
        return faces
    ends = mesh.face_adjacency
    links = coo_array((np.ones(len(ends)), ends.T), shape=(len(faces), len(faces)))
    _, body = connected_components(links, directed=False)
    a, b, c = np.moveaxis(mesh.triangles - mesh.centroid, 1, 0)
    volume = np.bincount(body, exact.dot(a, np.cross(b, c)))
    return np.where(volume[body, None] < 0, faces[:, ::-1], faces)
