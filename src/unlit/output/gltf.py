"""face.glb: the face as binary glTF 2.0, with all its textures inside.

Metres, y up, the face towards +z, the origin in the middle of the head. A camera node stands
where the photo's camera stood; its field is widened about the optical axis until it holds the
crop, whose window is in the camera's extras.

glTF has one specular lobe (GGX, where ours is Beckmann) and one normal for both lobes (we give it
the specular one). Of the same roughness alpha both distributions have the same peak, so that
roughness = sqrt(alpha). The specular albedo is KHR_materials_specular's factor up to 1, which
scales the whole lobe as ours does; above 1 it is its colour, which scales all but the grazing
reflection. The index of refraction is KHR_materials_ior's.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from ..color import encode_srgb
from ..face.reconstruction import Reconstruction
from ..head.procrustes import procrustes
from ..scene.brdf import IOR
from ..scene.normals import vertex_normals
from .atlas import Atlas
from .cornea import Cornea, cornea
from .eyes import Eye
from .geometry import Welded, welded
from .gltf_file import GltfFile
from .images import bytes_of, encoded
from .parts import EYES, PARTS
from .shapes import lids_clear, shapes
from .textures import normal_bytes, perceptual_roughness

#: Metres in a centimetre.
METRE = 0.01
#: The photo's light beside the file, see gltf_environment.
GLTF_LIGHT = "environment_gltf.exr"
#: Nodes by the part they show; eyes have one each.
_NODES = ("face", "eyes", "mouth", "teeth")

#: What a morph target moves by less is left out, m, and how little its normals may turn.
_STILL, _UNBENT = 5e-5, 0.03
#: The cornea is there to this share, and reflects that much more for it: 2.5 % of the light that
#: falls straight on it, of which viewers without KHR_materials_specular show a part. Its texture is
#: that of the eye behind, so that it veils nothing. Roughness of tears.
_THERE, _GLOSS, _WET = 0.1, 10.0, 0.08
_CORNEA_IOR = 1.376


def glb(
    reconstruction: Reconstruction,
    atlas: Atlas,
    eyes: tuple[Eye, ...] = (),
    camera: bool = True,
) -> bytes:
    """A binary glTF file of the face with the maps of `atlas`.

    eyes: of the reconstruction, whose eyeballs look where they do (eyes.looking); without any,
    eyeballs are one mesh and have no corneas. camera: whether the photo's camera is in the file.
    """
    r = lids_clear(reconstruction, eyes)
    mesh = welded(r) if eyes else atlas.mesh
    low, high = mesh.position.min(axis=0), mesh.position.max(axis=0)
    centre = (low.astype(np.float64) + high) / 2
    file = GltfFile()
    moved = _moved(r, mesh, shapes(r, eyes))
    material = _material(file, atlas)
    materials: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []
    nodes: list[dict[str, Any]] = [{"name": "head"}]

    def add(name: str, piece: _Piece, own: dict[str, Any], origin: np.ndarray) -> None:
        if own not in materials:
            materials.append(own)
        meshes.append(_mesh(file, name, piece, origin, materials.index(own)))
        place = (origin - centre) * METRE
        node = {"name": name, "mesh": len(meshes) - 1}
        nodes.append(node | ({"translation": place.tolist()} if place.any() else {}))

    for index in np.unique(atlas.part):
        here = atlas.part == index
        if index == EYES and eyes:
            for eye in eyes:
                ball = _piece(mesh, here & eye.vertices[mesh.vertex[mesh.triangles[:, 0]]], moved)
                side = "left" if eye.left else "right"
                add(f"eye_{side}", ball, {"name": PARTS[EYES], **material}, eye.centre)
                clear = cornea(eye, ball.position, ball.triangles)
                add(f"cornea_{side}", _over(ball, clear, eye.centre), _clear(material), eye.centre)
        else:
            own = {"name": PARTS[index], **material}
            add(_NODES[index], _piece(mesh, here, moved), own, centre)
    nodes[0]["children"] = list(range(1, len(nodes)))
    tops = [0]
    cameras = {}
    if camera:
        place = (-centre * METRE).tolist()
        tops.append(len(nodes))
        nodes.append({"name": "photo camera", "camera": 0, "translation": place})
        cameras = {"cameras": [_camera(r)]}
    document = {
        "asset": {"version": "2.0", "generator": f"unlit {version('unlit')}"},
        "extensionsUsed": ["KHR_materials_ior", "KHR_materials_specular"],
        "scene": 0,
        "scenes": [{"name": r.photo.name or "face", "nodes": tops}],
        "nodes": nodes,
        "meshes": meshes,
        **cameras,
        "materials": materials,
        **file.tables(),
    }
    return file.packed(document)


@dataclass(frozen=True)
class _Piece:
    """Corners and triangles of a part of the mesh, cm.

    position, normal (W, 3), tangent (W, 4), uv (W, 2), triangles (F, 3); targets: by name, how
    position and normal move, each (W, 3); only those that move it.
    """

    position: np.ndarray
    normal: np.ndarray
    tangent: np.ndarray | None
    uv: np.ndarray
    triangles: np.ndarray
    targets: dict[str, tuple[np.ndarray, np.ndarray]]


#: By unit's name: how the vertices (V, 3), cm, and the normals of the corners (W, 3) move.
_Moved = dict[str, tuple[np.ndarray, np.ndarray]]


def _moved(r: Reconstruction, mesh: Welded, shapes: dict[str, np.ndarray]) -> _Moved:
    out = {}
    vertices, triangles = r.face.mesh.vertices, r.face.mesh.triangles
    rest = vertex_normals(vertices, triangles)
    for name, delta in shapes.items():
        bent = vertex_normals(vertices + delta, triangles) - rest
        out[name] = delta[mesh.vertex], bent[mesh.vertex]
    return out


def _piece(mesh: Welded, triangles: np.ndarray, moved: _Moved) -> _Piece:
    """The triangles (F,) bool of the mesh."""
    corners, index = np.unique(mesh.triangles[triangles], return_inverse=True)
    targets = {}
    for name, both in moved.items():
        delta, bent = (values[corners] for values in both)
        if np.linalg.norm(delta, axis=1).max(initial=0) * METRE > _STILL:
            targets[name] = delta, bent
    return _Piece(
        mesh.position[corners],
        mesh.normal[corners],
        mesh.tangent[corners],
        mesh.uv[corners],
        index.reshape(-1, 3),
        targets,
    )


def _over(ball: _Piece, clear: Cornea, centre: np.ndarray) -> _Piece:
    """The cornea as a piece that turns with the eyeball about `centre` (3,), cm."""
    arm = clear.position - centre

    def of(values: np.ndarray) -> np.ndarray:
        return np.einsum("nc,ncx->nx", clear.weights, values[clear.corners])

    targets = {}
    for name, (delta, _) in ball.targets.items():
        turn = procrustes(ball.position, ball.position + delta)[1]
        targets[name] = arm @ turn.T - arm, clear.normal @ turn.T - clear.normal
    return _Piece(clear.position, clear.normal, None, of(ball.uv), clear.triangles, targets)


def _mesh(
    file: GltfFile, name: str, piece: _Piece, origin: np.ndarray, material: int
) -> dict[str, Any]:
    """One mesh with one primitive, about `origin`, cm."""
    attributes = {
        "POSITION": file.vertices((piece.position - origin) * METRE, bounds=True),
        "NORMAL": file.vertices(piece.normal),
        "TEXCOORD_0": file.vertices(np.stack([piece.uv[:, 0], 1 - piece.uv[:, 1]], axis=1)),
    }
    if piece.tangent is not None:
        attributes["TANGENT"] = file.vertices(piece.tangent)
    primitive: dict[str, Any] = {
        "attributes": attributes,
        "indices": file.indices(piece.triangles),
        "material": material,
    }
    out: dict[str, Any] = {"name": name, "primitives": [primitive]}
    if piece.targets:
        primitive["targets"] = [
            {
                "POSITION": file.sparse(delta * METRE, _STILL),
                "NORMAL": file.sparse(bent, _UNBENT),
            }
            for delta, bent in piece.targets.values()
        ]
        out["weights"] = [0] * len(piece.targets)
        out["extras"] = {"targetNames": list(piece.targets)}
    return out


def _clear(material: dict[str, Any]) -> dict[str, Any]:
    """The material of the cornea, given that of the eye behind."""
    albedo = material["pbrMetallicRoughness"]["baseColorTexture"]
    return {
        "name": "cornea",
        "alphaMode": "BLEND",
        "pbrMetallicRoughness": {
            "baseColorTexture": albedo,
            "baseColorFactor": [1, 1, 1, _THERE],
            "roughnessFactor": _WET,
            "metallicFactor": 0,
        },
        "extensions": {
            "KHR_materials_ior": {"ior": _CORNEA_IOR},
            "KHR_materials_specular": {"specularColorFactor": [_GLOSS] * 3},
        },
    }


def gltf_environment(light: np.ndarray) -> np.ndarray:
    """A latitude-longitude map (H, W, ...) as glTF viewers want it, given ours (scene/light.py).

    three.js, <model-viewer> and Blender have +x in the middle column, we have +z there: a quarter
    turn.
    """
    return np.roll(light, light.shape[1] // 4, axis=1)


def specular_texture(albedo: np.ndarray) -> tuple[np.ndarray, float]:
    """(N, N, 4) uint8 texture of KHR_materials_specular, and the factor of its colour.

    albedo: (N, N) specular albedo. Alpha, linear, holds what is up to 1; the colour,
    sRGB-encoded, what is above, over the factor.
    """
    above = np.maximum(albedo, 1)
    factor = float(above.max())
    colour = np.repeat(encode_srgb(above / factor)[..., None], 3, axis=-1)
    return bytes_of(np.concatenate([colour, albedo[..., None]], axis=-1)), factor


def _material(file: GltfFile, atlas: Atlas) -> dict[str, Any]:
    rough = perceptual_roughness(atlas.roughness)
    # Red is for occlusion, which is not used; blue is the metalness.
    surface = np.stack([np.full_like(rough, 255), rough, np.zeros_like(rough)], axis=-1)
    specular, factor = specular_texture(atlas.specular_albedo)
    specular_index = {"index": file.texture("specular", specular)}
    return {
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": file.texture("albedo", encoded(atlas.diffuse_albedo))},
            "metallicRoughnessTexture": {"index": file.texture("roughness", surface)},
            "metallicFactor": 0,
        },
        "normalTexture": {"index": file.texture("normal", normal_bytes(atlas.specular_normal))},
        "extensions": {
            "KHR_materials_ior": {"ior": IOR},
            "KHR_materials_specular": {
                "specularTexture": specular_index,
                "specularColorTexture": specular_index,
                "specularColorFactor": [factor] * 3,
            },
        },
    }


def _camera(r: Reconstruction) -> dict[str, Any]:
    camera = r.face.camera
    half_x = max(camera.cx, camera.width - camera.cx)
    half_y = max(camera.cy, camera.height - camera.cy)
    return {
        "name": "photo camera",
        "type": "perspective",
        "perspective": {
            "yfov": float(2 * np.arctan(half_y / camera.focal)),
            "aspectRatio": float(half_x / half_y),
            "znear": 0.01,
        },
        "extras": {
            "film": [2 * half_x, 2 * half_y],
            "crop": [half_x - camera.cx, half_y - camera.cy, camera.width, camera.height],
        },
    }
