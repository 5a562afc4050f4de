"""The head that a subject.toml describes: its meshes in the world, moved by their maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import ndimage

from ..errors import SubjectError
from ..scene.normals import vertex_normals
from ..settings.regions import RoughnessByRegion
from ..storage.meshes import V_AXIS, Surface, read_mesh
from ..storage.pictures import read_picture
from .scan import Part, Scan, frontal, seen_by
from .subject_file import DiffuseAlbedo, Displacement, Map, MeshTable, NormalMap, read_subject_file

_MAX_TRIANGLES = 20_000_000


def read_subject(file: Path, size: int) -> Scan:
    """The subject that `file` describes, on a film of `size` x `size` pixels.

    file: a subject.toml, or the folder that holds one. Raises SubjectError or PictureError.
    """
    found = read_subject_file(file)
    parts = tuple(_part(mesh, found.object_to_world, found.unit) for mesh in found.mesh)
    if found.camera is None:
        return frontal(found.name, parts, size)
    pose = found.camera.camera_to_world.copy()
    pose[:3, 3] *= found.unit
    return seen_by(found.name, parts, found.camera.pinhole(), pose, size)


def _part(mesh: MeshTable, object_to_world: np.ndarray, unit: float) -> Part:
    surface = read_mesh(mesh.file)
    if surface.uv is None and mesh.pictures():
        raise SubjectError(f"{mesh.file}: no texture coordinates, but maps are given")
    axis = mesh.v_axis or V_AXIS.get(mesh.file.suffix.lower(), "up")
    vertices, uv, triangles, smooth = _unified(surface, axis)
    bend = _bend(mesh.normal)
    in_object = mesh.normal is not None and mesh.normal.space == "object"
    if mesh.displacement is not None:
        vertices, uv, triangles, smooth = _displaced(
            mesh.displacement, vertices, uv, triangles, smooth
        )
    if np.linalg.det(object_to_world[:3, :3]) < 0:  # a mirrored head, turned right side out
        triangles = triangles[:, ::-1]
    linear = object_to_world[:3, :3] * unit
    world = vertices @ linear.T + object_to_world[:3, 3] * unit
    return Part(
        vertices=world,
        normals=vertex_normals(world, triangles, smooth),
        triangles=triangles,
        uv=uv,
        diffuse=_colour(mesh.diffuse_albedo),
        specular=_scalar(mesh.specular_albedo, 0, 20, 1),
        roughness=_scalar(mesh.roughness, 0.02, 1, RoughnessByRegion().skin),
        normal=bend @ np.linalg.inv(linear) if in_object else bend,
        object_space=in_object,
    )


def _colour(albedo: DiffuseAlbedo) -> np.ndarray:
    """(h, w, 3) in [0, 1]."""
    image = albedo.pixels()
    if image.min() < 0 or image.max() > 4:
        given = f"albedos from {image.min():.2f} to {image.max():.2f}"
        raise SubjectError(f"{albedo.file}: {given}; change the scale of diffuse_albedo")
    return np.clip(image, 0, 1).astype(np.float32)


def _scalar(given: Map | None, low: float, high: float, default: float) -> np.ndarray:
    """(h, w, 1)."""
    if given is None:
        return np.full((1, 1, 1), default, dtype=np.float32)
    grey = given.pixels().mean(axis=2, keepdims=True)
    return np.clip(grey, low, high).astype(np.float32)


def _bend(given: NormalMap | None) -> np.ndarray:
    """(h, w, 3) vectors; green up."""
    if given is None:
        return np.array([[[0.0, 0.0, 1.0]]], dtype=np.float32)
    normal = (2 * read_picture(given.file) - 1) * (1, 1 if given.green == "up" else -1, 1)
    return normal.astype(np.float32)


def _unified(surface: Surface, axis: str) -> tuple[np.ndarray, ...]:
    """Vertices, uv with v up, triangles into both, and for each vertex its smooth point's number.

    Vertices are split where the texture is cut, and belong to one smooth point where they lie
    together, so that shading does not show the cuts.
    """
    if surface.uv is None or surface.triangle_uv is None:
        uv, corner_uv = np.zeros((1, 2)), np.zeros_like(surface.triangles)
    else:
        uv, corner_uv = surface.uv.copy(), surface.triangle_uv
        if axis == "down":
            uv[:, 1] = 1 - uv[:, 1]
    pairs = np.stack([surface.triangles.ravel(), corner_uv.ravel()], axis=1)
    unique, index = np.unique(pairs, axis=0, return_inverse=True)
    vertices = surface.vertices[unique[:, 0]]
    grain = 1e-6 * float(np.ptp(surface.vertices, axis=0).max())
    _, smooth = np.unique(np.round(vertices / grain), axis=0, return_inverse=True)
    return vertices, uv[unique[:, 1]], index.reshape(-1, 3), smooth.ravel()


def _displaced(
    given: Displacement,
    vertices: np.ndarray,
    uv: np.ndarray,
    triangles: np.ndarray,
    smooth: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """The mesh split `subdivisions` times and moved along its normals by the map."""
    times = given.subdivisions
    if len(triangles) * 4**times > _MAX_TRIANGLES:
        what = f"{times} subdivisions make over {_MAX_TRIANGLES} triangles"
        raise SubjectError(f"{given.file}: {what}; set fewer in displacement")
    image = read_picture(given.file, given.encoding)
    normals = vertex_normals(vertices, triangles, smooth)
    for _ in range(times):
        triangles, ends = _split(triangles)
        vertices, uv, normals = (
            np.concatenate([x, x[ends].mean(axis=1)]) for x in (vertices, uv, normals)
        )
        low, high = np.sort(smooth[ends], axis=1).T
        key = low * (int(smooth.max()) + 1) + high
        _, middle_point = np.unique(key, return_inverse=True)
        smooth = np.concatenate([smooth, int(smooth.max()) + 1 + middle_point.ravel()])
    # Pixel centres; v = 0 is the bottom row.
    where = [(1 - uv[:, 1]) * len(image) - 0.5, uv[:, 0] * image.shape[1] - 0.5]
    grey = image.mean(axis=2)
    value = ndimage.map_coordinates(grey, where, np.float64, order=1, mode="nearest")
    # Copies of one point across a cut of the texture must not part.
    count = np.bincount(smooth)
    value = (np.bincount(smooth, value) / np.maximum(count, 1))[smooth]
    vertices = vertices + normals * (given.scale * (value - given.middle))[:, None]
    return vertices, uv, triangles, smooth


def _split(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every triangle in four: new triangles, and the ends (E, 2) of the edges with new vertices."""
    first = int(triangles.max()) + 1
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)
    ends, middle = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    m = first + middle.reshape(-1, 3)
    a, b, c = triangles.T
    quarters = [(a, m[:, 0], m[:, 2]), (m[:, 0], b, m[:, 1]), (m[:, 2], m[:, 1], c), m.T]
    return np.concatenate([np.stack(q, axis=1) for q in quarters]), ends
