"""Heads with hair, brows, beards, glasses, hats and hands, photographed, and what is what in them.

The truth is counted: rays through every pixel are asked what they hit first.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from heads import Head
from scipy import ndimage
from scipy.spatial.transform import Rotation
from strands import Strands, noise
from worn.pieces import Piece, joined, rgb_of, sheet_mesh, two_sided

from unlit.head.model import VERTEX_REGIONS
from unlit.machine.runtime import mitsuba
from unlit.perception.parser import CLASSES, LENS
from unlit.render.reference import mesh_body, mitsuba_environment
from unlit.scene.arrays import device
from unlit.scene.camera import Camera

mi = mitsuba()

#: Of light between hair, skin and what is worn.
BOUNCES = 4
#: Colours of hair, linear sRGB.
HAIR = {
    "black": (0.012, 0.010, 0.009),
    "dark brown": (0.03, 0.02, 0.013),
    "brown": (0.07, 0.04, 0.022),
    "light brown": (0.16, 0.09, 0.045),
    "red": (0.25, 0.09, 0.03),
    "blond": (0.42, 0.29, 0.15),
    "light blond": (0.55, 0.44, 0.28),
    "grey": (0.30, 0.29, 0.28),
    "white": (0.62, 0.60, 0.57),
}
#: Of the default head model's regions (head/model.py), what each is here.
_OF_REGION = {"scalp": "skin", "neck": "skin", "ears": "skin", "eyebrows": "skin"}
_OF_REGION |= {"teeth": "mouth"}
#: The same of strands.
_OF_STRANDS = {"stubble": "skin"}


@dataclass(frozen=True)
class Look:
    """Colours, linear sRGB: of skin, lips, iris, hair, brows and beard; gloss of the skin."""

    skin: tuple[float, float, float] = (0.5, 0.33, 0.26)
    lips: tuple[float, float, float] = (0.4, 0.17, 0.16)
    iris: tuple[float, float, float] = (0.06, 0.035, 0.02)
    hair: tuple[float, float, float] = (0.03, 0.02, 0.012)
    brow: tuple[float, float, float] = (0.03, 0.02, 0.012)
    beard: tuple[float, float, float] = (0.03, 0.02, 0.012)
    roughness: float = 0.4


@dataclass(frozen=True)
class Dressed:
    """A head, the strands on it ('hair', 'eyebrows', 'beard', 'stubble'), and what is worn."""

    head: Head
    look: Look
    strands: dict[str, list[Strands]] = field(default_factory=dict)
    worn: list[Piece] = field(default_factory=list)
    seed: int = 0


@dataclass(frozen=True)
class View:
    """How a head is turned (yaw, pitch, roll, degrees) and how far the camera is, cm."""

    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    distance: float = 100.0
    width: float = 30.0  # cm that the picture shows at the head


class Scene:
    """A dressed head before a camera of `size` pixels a side.

    grid: rows and columns of the rays in each pixel that the truth is counted with.
    """

    def __init__(self, dressed: Dressed, view: View, size: int, grid: int = 5) -> None:
        self.dressed, self.size, self.grid = dressed, size, grid
        self.camera = Camera(size, size, size * view.distance / view.width, size / 2, size / 2)
        turn = Rotation.from_euler("zxy", [view.roll, view.pitch, view.yaw], degrees=True)
        head = dressed.head
        middle = np.nanmean(head.landmarks, axis=0) + np.array([0, 1.0, -4.0])
        offset = np.array([0, 0, -view.distance])
        self._pose = turn, middle, offset
        self._objects, self._classes = self._build()
        self._lit: Any = None

    def place(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the head's frame in the camera's, cm."""
        turn, middle, offset = self._pose
        return turn.apply(points.reshape(-1, 3) - middle).reshape(points.shape) + offset

    def photograph(self, environment: np.ndarray, samples: int, seed: int = 0) -> np.ndarray:
        """(S, S, 4) float32: linear radiance, and the share of each pixel that is not background.

        environment: (H, W, 3) in the camera's frame (scene/light.py).
        """
        light = {"type": "envmap", "bitmap": mitsuba_environment(environment)}
        if self._lit is None:
            self._lit = mi.load_dict({"type": "scene", "light": light, **self._objects})
        else:  # a new scene would be a new kernel
            parameters = mi.traverse(self._lit)
            parameters["light.data"] = mi.traverse(mi.load_dict(light))["data"]
            parameters.update()
        scene = self._lit
        # `path` takes lenses for opaque where it asks for light: eyes behind them would be black.
        integrator = mi.load_dict(
            {"type": "volpath", "max_depth": BOUNCES + 1, "hide_emitters": True}
        )
        # Passes bound the wavefront's memory.
        passes = max(1, samples * self.size**2 // 2**22)
        view = self.camera.mitsuba_sensor(-(-samples // passes))
        view["sampler"]["type"] = "multijitter"
        view["film"]["pixel_format"] = "rgba"
        sensor = mi.load_dict(view)
        _opaque(scene, sensor)
        total = np.zeros((self.size, self.size, 4), np.float32)
        for k in range(passes):
            total += mi.render(
                scene, sensor=sensor, integrator=integrator, seed=seed * 1000 + k
            ).numpy()
        return _without_fireflies(total / passes)

    @cached_property
    def shares(self) -> np.ndarray:
        """(S, S, C) float32: the share of each of CLASSES in each pixel, counted by rays."""
        return self._count()

    def landmarks(self) -> np.ndarray:
        """The true landmarks (478, 2), pixels."""
        return self.camera.project(self.place(self.dressed.head.landmarks))

    def _count(self) -> np.ndarray:
        grid = self.grid
        scene = mi.load_dict({"type": "scene", **self._objects})
        table = self._class_of_shape(scene)
        size, total = self.size, np.zeros((self.size**2, len(CLASSES)), np.float32)
        ys, xs = np.mgrid[0:size, 0:size]
        for a in range(grid):
            for b in range(grid):
                at = np.stack([xs + (b + 0.5) / grid, ys + (a + 0.5) / grid], axis=-1)
                rays = self.camera.unproject(at.reshape(-1, 2), 1.0)
                rays /= np.linalg.norm(rays, axis=1, keepdims=True)
                self._first_hits(scene, table, rays, total)
        return (total / grid**2).reshape(size, size, len(CLASSES))

    def _first_hits(
        self, scene: Any, table: dict[int, str], rays: np.ndarray, total: np.ndarray
    ) -> None:
        direction = mi.Vector3f(np.ascontiguousarray(rays.T, np.float32))
        ray = mi.Ray3f(mi.Point3f(0), direction)
        rows = np.arange(len(rays))
        open_ = np.ones(len(rays), bool)
        passed = np.zeros(len(rays), bool)
        for _ in range(5):  # a lens may have two faces, and there are two lenses
            si = scene.ray_intersect(ray)
            found = self._class_at(si, table)
            through = open_ & (found == LENS)
            done = open_ & ~through
            total[rows[done], found[done]] += 1
            passed |= through
            open_ = through
            if not open_.any():
                break
            ray = si.spawn_ray(direction)
        total[passed, LENS] += 1

    def _class_of_shape(self, scene: Any) -> dict[int, str]:
        return {int(_number(mi.ShapePtr(shape))[0]): shape.id() for shape in scene.shapes()}

    def _class_at(self, si: Any, table: dict[int, str]) -> np.ndarray:
        shape = _number(si.shape)
        found = np.zeros(len(shape), np.int64)
        primitive = si.prim_index.numpy()
        for pointer, name in table.items():
            here = shape == pointer
            if not here.any():
                continue
            if name == "head":
                found[here] = self._classes[primitive[here]]
            else:
                kind = name.split("#")[0]
                found[here] = CLASSES.index(_OF_STRANDS.get(kind, kind))
        return found

    def _build(self) -> tuple[dict[str, Any], np.ndarray]:
        dressed = self.dressed
        head = dressed.head
        objects: dict[str, Any] = {"head": self._head()}
        colours = {"hair": dressed.look.hair, "eyebrows": dressed.look.brow}
        colours |= dict.fromkeys(("beard", "stubble"), dressed.look.beard)
        for kind, several in dressed.strands.items():
            for k, strands in enumerate(several):
                if len(strands.points):
                    objects[f"{kind}#{k}"] = self._curves(strands, colours[kind])
        objects["mouth#teeth"] = self._teeth()
        for k, piece in enumerate(dressed.worn):
            objects[f"{piece.kind}#{k}"] = smooth_mesh(
                f"{piece.kind}#{k}", piece.material, self.place(piece.vertices), piece.triangles
            )
        region = np.array([_class_of(name) for name in VERTEX_REGIONS])[head.region]
        return objects, np.median(region[head.triangles], axis=1).astype(int)

    def _head(self) -> Any:
        head, look = self.dressed.head, self.dressed.look
        colour = _painted(head, look, self.dressed.seed)
        return smooth_mesh(
            "head",
            _coloured(look.roughness, 0.45),
            self.place(head.vertices),
            head.triangles,
            colour,
        )

    def _teeth(self) -> Any:
        """Both rows, behind the lips: two curved strips, dark between the teeth."""
        lm = self.dressed.head.landmarks
        rows, colours = [], []
        across, up = 97, 6
        s = np.linspace(-1, 1, across)
        half = 0.95 * 0.5 * np.linalg.norm(lm[308] - lm[78])
        for lip, sign in ((13, -1.0), (14, 1.0)):
            top = lm[lip] + (0, -0.35 * sign, -0.75)
            height = np.linspace(0, 0.95, up)
            x = lm[13, 0] + half * s
            y = top[1] + sign * height[:, None] + 0 * s
            z = top[2] - 0.8 * half * s**2 + 0 * y
            grid = np.stack([np.broadcast_to(x, y.shape), y, z], axis=-1)
            gap = np.abs((s * 5.5) % 1 - 0.5) > 0.42
            tone = np.where(gap, 0.12, 0.5) * (1 - 0.5 * np.abs(s))
            colour = tone[None, :, None] * np.array([1.0, 0.93, 0.8]) * np.ones((up, 1, 1))
            rows.append(sheet_mesh(grid, wrap=False))
            colours.append(colour.reshape(-1, 3))
        vertices, triangles = joined(rows)
        colour = np.concatenate(colours).astype(np.float32)
        return smooth_mesh(
            "mouth#teeth", _coloured(0.3, 0.5), self.place(vertices), triangles, colour
        )

    def _curves(self, strands: Strands, colour: tuple[float, float, float]) -> Any:
        points = self.place(strands.points)
        taper = np.linspace(1, 0.4, points.shape[1])[None] * strands.radius[:, None]
        rows = np.concatenate([points, taper[..., None]], axis=2)
        return curves(rows, _hair_material(colour))


def curves(rows: np.ndarray, material: dict[str, Any]) -> Any:
    """Strands as a shape of Mitsuba; rows: (N, K, 4), points along each, the radius there, cm."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "strands.txt"
        file.write_text("\n\n".join(_lines(strand) for strand in rows.tolist()))
        # Not `bsplinecurve`: a rare hit on one is no number, and a direction that is none ends
        # the program when an `envmap` is looked up in it.
        return mi.load_dict({"type": "linearcurve", "filename": str(file), "bsdf": material})


def _lines(strand: list[list[float]]) -> str:
    return "\n".join("{:.4f} {:.4f} {:.4f} {:.4f}".format(*point) for point in strand)


def _coloured(roughness: float, specular: float) -> dict[str, Any]:
    """Skin or enamel in the colours of the mesh's attribute `vertex_color`."""
    bsdf = {
        "type": "principled",
        "base_color": {"type": "mesh_attribute", "name": "vertex_color"},
        "roughness": roughness,
        "specular": specular,
    }
    return two_sided(bsdf)


def _hair_material(colour: tuple[float, float, float]) -> dict[str, Any]:
    """Glossy tubes."""
    return {
        "type": "principled",
        "base_color": rgb_of(colour),
        "roughness": 0.35,
        "specular": 0.5,
    }


def _without_fireflies(image: np.ndarray) -> np.ndarray:
    """Single pixels far brighter than those around them are a rare path's, set to their median."""
    colour = np.ascontiguousarray(image[..., :3])
    around = np.stack([ndimage.median_filter(colour[..., k], 5) for k in range(3)], axis=-1)
    spot = colour.max(axis=-1) > 2.5 * around.max(axis=-1) + 0.02
    return np.concatenate([np.where(spot[..., None], around, colour), image[..., 3:]], axis=-1)


def _opaque(*objects: Any) -> None:
    """Keep numbers out of the kernels, which would be compiled anew for every picture."""
    for thing in objects:
        parameters = mi.traverse(thing)
        for key, _ in parameters:
            dr.make_opaque(parameters[key])


def _number(shapes: Any) -> np.ndarray:
    """(N,) uint32: which shape each of mi.ShapePtr is."""
    number: Any = dr.reinterpret_array(mi.UInt32, shapes)
    return number.numpy()


def _class_of(region: str) -> int:
    """The class of a region of the head model."""
    return CLASSES.index(_OF_REGION.get(region, region))


def _painted(head: Head, look: Look, seed: int) -> np.ndarray:
    """Albedo at the vertices (V, 3): skin that is redder at cheeks, nose and ears; lips; eyes."""
    rng = np.random.default_rng(seed)
    v, lm = head.vertices, head.landmarks
    log = np.log(look.skin) + 0.06 * (noise(v, 6.0, rng) - 0.5)[:, None]
    redness = np.zeros(len(v))
    for index, width in ((50, 2.2), (280, 2.2), (4, 1.3), (152, 1.5)):
        redness += np.exp(-np.sum((v - lm[index]) ** 2, axis=1) / width**2)
    redness += 0.6 * head.within("ears") + 0.5 * (noise(v, 3.0, rng) - 0.5)
    log = log + rng.uniform(0, 1) * redness[:, None] * np.array([0.05, -0.22, -0.18])
    colour = np.exp(log)
    lips = head.within("lips")
    colour[lips] = np.array(look.lips) * np.exp(0.1 * (noise(v, 0.7, rng)[lips] - 0.5))[:, None]
    colour[head.within("mouth")] = (0.35, 0.1, 0.09)
    colour[head.within("teeth")] = (0.5, 0.46, 0.4)
    eyes = head.within("eyes")
    for side in (-1, 1):
        ball = eyes & (np.sign(v[:, 0]) == side)
        centre = 0.5 * (v[ball].min(axis=0) + v[ball].max(axis=0))
        out = v[ball] - centre
        angle = np.degrees(np.arccos(out[:, 2] / np.linalg.norm(out, axis=1)))
        white = np.array((0.62, 0.56, 0.53))
        shade = np.where((angle < 29)[:, None], look.iris, white)
        colour[ball] = np.where((angle < 12)[:, None], (0.01, 0.01, 0.01), shade)
    return np.clip(colour, 0.004, 0.9).astype(np.float32)


def smooth_mesh(
    name: str,
    material: dict[str, Any],
    vertices: np.ndarray,
    triangles: np.ndarray,
    colour: Any = None,
) -> Any:
    """A smooth mi.Mesh; colour: (V, 3), the attribute `vertex_color`, or None."""
    points, faces = device(mi.Point3f, vertices), device(mi.Vector3u, triangles)
    mesh = mesh_body(
        name, mi.load_dict(material), points, dr.zeros(mi.Vector3f, len(vertices)), faces
    )
    mesh.recompute_vertex_normals()
    if colour is not None:
        mesh.add_attribute("vertex_color", 3, device(mi.Float, colour.ravel()))
    return mesh
