"""face.usda: the face as a USD layer with a UsdPreviewSurface material.

Metres, y up, as face.glb, and with the same limits: one normal for both lobes, GGX. The preview
surface has no scale of the specular lobe, so the specular albedo is left out. Needs Pixar's
usd-core (the extra `usd`).
"""

# Pixar's type stubs know a part of the library only.
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import OutputError
from ..scene.brdf import IOR
from . import textures
from .atlas import Atlas
from .geometry import Welded
from .gltf import METRE
from .parts import PARTS


def usda(atlas: Atlas, directx: bool = False) -> bytes:
    """The layer as text; it refers to the PNG files of textures.py beside it.

    directx: whether the PNG normals have y down. Raises OutputError without usd-core.
    """
    try:
        from pxr import Usd, UsdGeom, UsdShade, Vt
    except ImportError:
        raise OutputError("usd: needs a further package; run `pip install 'unlit[usd]'`") from None

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, "/head")
    stage.SetDefaultPrim(root.GetPrim())
    face = _face(stage, atlas.mesh)
    material = _material(stage, directx)
    UsdShade.MaterialBindingAPI.Apply(face.GetPrim()).Bind(material)
    for index in np.unique(atlas.part):
        rows = np.flatnonzero(atlas.part == index).astype(np.int32)
        part = UsdGeom.Subset.CreateGeomSubset(
            face, PARTS[index], UsdGeom.Tokens.face, Vt.IntArray.FromNumpy(rows)
        )
        part.CreateFamilyNameAttr("part")
    return stage.GetRootLayer().ExportToString().encode()


def _face(stage: Any, mesh: Welded) -> Any:
    from pxr import Gf, Sdf, UsdGeom, Vt

    face = UsdGeom.Mesh.Define(stage, "/head/face")
    centre = (mesh.position.min(axis=0) + mesh.position.max(axis=0)) / 2  # of the head
    position = np.ascontiguousarray((mesh.position - centre) * METRE, dtype=np.float32)
    face.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(position))
    face.CreateExtentAttr([Gf.Vec3f(*end.tolist()) for end in (position.min(0), position.max(0))])
    face.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.normal)))
    face.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    face.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.triangles.ravel()))
    face.CreateFaceVertexCountsAttr(Vt.IntArray(len(mesh.triangles), 3))
    face.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    uv = UsdGeom.PrimvarsAPI(face).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
    )
    uv.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(mesh.uv)))
    return face


def _material(stage: Any, directx: bool) -> Any:
    from pxr import Gf, Sdf, UsdShade

    def texture(name: str, file: str, space: str, **remap: tuple[float, ...]) -> Any:
        node = UsdShade.Shader.Define(stage, f"/head/material/{name}")
        node.CreateIdAttr("UsdUVTexture")
        node.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{file}")
        node.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
        for axis in ("wrapS", "wrapT"):
            node.CreateInput(axis, Sdf.ValueTypeNames.Token).Set("clamp")
        for key, value in remap.items():
            node.CreateInput(key, Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*value))
        node.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.ConnectableAPI(), "result"
        )
        return node

    material = UsdShade.Material.Define(stage, "/head/material")
    reader = UsdShade.Shader.Define(stage, "/head/material/st")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    surface = UsdShade.Shader.Define(stage, "/head/material/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("ior", Sdf.ValueTypeNames.Float).Set(IOR)
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(0.0)
    y = -1.0 if directx else 1.0
    bend = {"scale": (2.0, 2.0 * y, 2.0, 1.0), "bias": (-1.0, -y, -1.0, 0.0)}
    kinds = Sdf.ValueTypeNames
    for name, kind, output, node in (
        ("diffuseColor", kinds.Color3f, "rgb", texture("albedo", textures.ALBEDO, "sRGB")),
        ("roughness", kinds.Float, "r", texture("roughness", textures.ROUGHNESS, "raw")),
        ("normal", kinds.Normal3f, "rgb", texture("normal", textures.NORMAL, "raw", **bend)),
    ):
        node.CreateOutput(output, kinds.Float if output == "r" else kinds.Float3)
        surface.CreateInput(name, kind).ConnectToSource(node.ConnectableAPI(), output)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    return material
