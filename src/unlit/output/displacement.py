"""The displacement map: how far the surface lies above the mesh, along the mesh's normal.

The maps bend the mesh's normals by a perturbation e that was found pixel by pixel. Here it becomes
a height h of the same pixels, whose normals are the bent ones: e = -grad h (scene/height.py).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

from ..face.reconstruction import Reconstruction
from ..scene.height import PixelFrames
from ..scene.mesh import Mesh, surface

#: Wavelength, cm, of which half of the height is kept. What is broader is the mesh's shape; small
#: errors of the normals would add up to hills there.
BROADEST = 6.0
#: The same beside the face and in eyes and mouth, where nothing is raised: the height dies away.
_BESIDE = 0.5
#: Channels of Regions.weights. Brows are neither: the skin's height goes on below them, flat.
_RAISED, _FLAT = [0, 1], [2, 4, 5]
_MILLIMETRES = 10.0  # of a centimetre


def displacement(reconstruction: Reconstruction) -> np.ndarray:
    """The height (S, S) float32 in millimetres over the mesh, along its unit normal; > 0 outwards.

    One value per pixel of the crop. It has the bent normals of skin and lips, as far as they are a
    height's and seen squarely enough; what is broader than BROADEST is left out. Below brows it
    goes on flat; in eyes and mouth and beyond the mask it dies away within some millimetres.
    """
    r, camera = reconstruction, reconstruction.face.camera
    mesh = Mesh(r.face.mesh.vertices, r.face.mesh.triangles)
    hits = mesh.camera_hits(camera)
    position, normal, _ = surface(camera, hits, mesh.vertices, mesh.normals, mesh.triangles)
    pixel, position, normal = hits.pixel.numpy(), position.numpy().T, normal.numpy().T
    out = np.zeros(camera.height * camera.width, np.float32)
    inside = r.face.mask.ravel()[pixel] > 0
    if inside.any():
        centimetre = camera.focal / float(np.median(-position[inside, 2]))  # pixels
        away: Any = ndimage.distance_transform_edt(r.face.mask == 0)
        near = away.ravel()[pixel] < 2 * _BESIDE * centimetre
        frames = PixelFrames.of(camera, pixel[near].astype(np.int64), position[near], normal[near])
        out[frames.pixel] = _MILLIMETRES * _height(r, frames, centimetre)
    return out.reshape(camera.height, camera.width)


def _height(r: Reconstruction, frames: PixelFrames, centimetre: float) -> np.ndarray:
    """(P,) cm. centimetre: the length in pixels."""

    def rows(image: np.ndarray) -> np.ndarray:
        return image.reshape(r.face.mask.size, -1)[frames.pixel]

    share, measured = rows(r.photo.regions.weights), rows(r.face.mask)[:, 0]
    raised = frames.trust * measured * share[:, _RAISED].sum(axis=1)
    beside = np.where(measured > 0, share[:, _FLAT].sum(axis=1), 1)
    broadest = centimetre * BROADEST ** (1 - beside) * _BESIDE**beside
    e = rows(r.face.maps.perturbation) * raised[:, None]
    # A wave of this length costs as much by its heights as by its slopes.
    return frames.height_of(e, np.ones(len(e)), (2 * np.pi / broadest) ** 2)
