"""The head turned before the camera: its maps as the same camera would then see them.

What the photo shows lies in the atlas (output/atlas.py), which also continues it over the rest of
the head. The turned head is drawn from the atlas into new image-space maps, so that both
renderers take it like any other face.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..face.face import Face, Normals
from ..face.reconstruction import Reconstruction
from ..machine.runtime import mitsuba
from ..output.atlas import bake
from ..output.eyes import eyes_of
from ..output.layout import LARGEST, laid_out
from ..scene.maps import Maps, fill
from ..scene.mesh import Mesh, surface_weights

mi = mitsuba()

#: Texels of the atlas for each pixel of the crop along one side, so that no detail is lost.
_FINER = 4


class Turntable:
    """The head of a reconstruction on a turntable: the atlas is baked once."""

    def __init__(self, reconstruction: Reconstruction) -> None:
        self.face = reconstruction
        size = min(_FINER * reconstruction.face.camera.width, LARGEST)
        eyes = eyes_of(reconstruction)
        self.atlas = bake(laid_out(reconstruction, "face"), size, eyes=eyes)

    def turned(self, degrees: float) -> Face:
        """The head turned by `degrees` about the vertical axis through its middle.

        Positive turns the face to the picture's right. The mask is 1 wherever the head is seen,
        also where nothing was measured.
        """
        r, atlas = self.face, self.atlas
        angle = np.radians(degrees)
        cosine, sine = np.cos(angle), np.sin(angle)
        turn = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
        middle = 0.5 * (r.face.mesh.vertices.min(axis=0) + r.face.mesh.vertices.max(axis=0))
        vertices = ((r.face.mesh.vertices - middle) @ turn.T + middle).astype(np.float32)

        body = Mesh(vertices, r.face.mesh.triangles)
        hits = body.camera_hits(r.face.camera)
        pixel, triangle = hits.pixel.numpy(), hits.triangle.numpy()
        weight = surface_weights(r.face.camera, hits, body.vertices, body.triangles)[1].numpy().T
        corner = atlas.mesh.triangles[triangle]

        def at(values: np.ndarray) -> np.ndarray:
            """Values (W, C) of the mesh's corners at the pixels, (P, C)."""
            return np.einsum("pi,pic->pc", weight, values[corner])

        place = at(atlas.mesh.uv)
        normal, tangent = at(atlas.mesh.normal), at(atlas.mesh.tangent)
        across = np.sign(tangent[:, 3:]) * np.cross(normal, tangent[:, :3])
        frame = np.stack([tangent[:, :3], across, normal], axis=-1)
        bent = np.einsum("pxc,pc->px", frame, _texture(atlas.specular_normal, place))
        plain, bent = (_unit(n) @ turn.T for n in (normal, bent))

        height, width = r.face.mask.shape
        known = np.zeros((height, width), dtype=bool)
        known.ravel()[pixel] = True

        def image(values: np.ndarray) -> np.ndarray:
            out = np.zeros((height * width, *values.shape[1:]), dtype=np.float32)
            out[pixel] = values
            return out.reshape(height, width, *values.shape[1:])

        # Beyond the silhouette as at it: rays from one part of the face to another look there.
        colour, gloss, roughness = (
            fill(image(_texture(texels, place)), known)
            for texels in (atlas.diffuse_albedo, atlas.specular_albedo, atlas.roughness)
        )
        maps = Maps(colour, gloss, roughness, image(bent - plain))
        diffuse = _unit(plain + maps.diffuse_perturbation().reshape(-1, 3)[pixel])
        return Face(
            r.face.camera,
            replace(r.face.mesh, vertices=vertices),
            maps,
            Normals(image(bent), image(diffuse)),
            known.astype(np.float32),
        )


def _texture(texels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Bilinear values (P, ...) of `texels` (N, N, ...), row 0 at v = 1, at uv (P, 2)."""
    size = len(texels)
    place = uv * (size, -size) + (-0.5, size - 0.5)
    low = np.floor(place).astype(np.int64)
    total = 0.0
    for corner in np.array([(0, 0), (1, 0), (0, 1), (1, 1)]):
        x, y = np.clip(low + corner, 0, size - 1).T
        weight = (1 - np.abs(place - low - corner)).prod(axis=1)
        total += weight.reshape(-1, *([1] * (texels.ndim - 2))) * texels[y, x]
    return np.asarray(total, dtype=np.float32)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
