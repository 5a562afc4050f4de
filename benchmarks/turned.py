"""How well the completed head looks from where the photo did not, against a scan's truth.

    python benchmarks/turned.py [--steps DIR] [-o DIR]

The Lee Perry-Smith scan, its head turned by 0 and 25 degrees, is photographed under uniform and
side light and reconstructed at `draft` as from any photo. The completed head, turned by 45 degrees
to either side of the photo's pose, is rendered under uniform light, and so is the scan, turned
with it and scaled to the depth that the fit has. The table gives PSNR (dB, sRGB, after one gain)
of the skin of the face, of its part that the photo does not show or shows at more than 57 degrees
from the normal, and of all skin with neck, ears and scalp. The scan's eyes are closed and its
scalp is shorn, so that the last is a rough figure. Where the fitted shape is off, brows, lips and
ears lie beside the true ones: no texture can be better than that allows. -o writes a picture for
each photo: ours above, the truth below.

BEFORE has the same figures of the completion that took all of the mask for evidence, copied the
other half of the face, and went on smoothly.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from subjects import SHARED, lee_perry_smith

import unlit  # noqa: F401 - before Dr.Jit, which looks for LLVM when it is loaded

# isort: split
from unlit.color import encode_srgb
from unlit.evaluate.command import light
from unlit.evaluate.metrics import best_gain, psnr
from unlit.evaluate.protocol import Study
from unlit.evaluate.scan import Scan
from unlit.evaluate.step_cache import StepCache
from unlit.evaluate.table import Table, markdown
from unlit.face.reconstruction import Reconstruction
from unlit.head.model import VERTEX_REGIONS
from unlit.head.sources.library import default_model
from unlit.output.images import png
from unlit.relighting.pose import Turntable
from unlit.render.relighter import Relighter
from unlit.scene.light import uniform
from unlit.scene.mesh import Mesh
from unlit.settings.settings import PRESETS
from unlit.storage.keys import key

YAWS, TURNS, LIGHTS = (0.0, 25.0), (-45.0, 45.0), ("uniform", "side")
SIZE = 256
#: By photo's yaw, light and turn: face, its part not seen, all skin.
BEFORE: dict[tuple[float, str, float], tuple[float, float, float]] = {
    (0.0, "uniform", -45.0): (24.1, 23.2, 23.4),
    (0.0, "uniform", 45.0): (23.9, 23.4, 23.5),
    (0.0, "side", -45.0): (24.8, 24.0, 24.3),
    (0.0, "side", 45.0): (22.2, 23.2, 22.8),
    (25.0, "uniform", -45.0): (23.0, 22.1, 22.6),
    (25.0, "uniform", 45.0): (24.5, 20.2, 21.9),
    (25.0, "side", -45.0): (22.8, 21.9, 21.9),
    (25.0, "side", 45.0): (22.9, 21.6, 23.9),
}
_FACE = ("skin", "lips", "eyebrows")
_SQUARE = 0.55
_SKIN = (*_FACE, "scalp", "neck", "ears")


def turned_truth(scan: Scan, r: Reconstruction, degrees: float) -> Scan:
    """The scan, scaled to the depth of the fitted mesh and turned with it about its middle."""
    mesh = r.face.mesh
    truth, camera = scan.truth, r.face.camera
    hits = Mesh(mesh.vertices, mesh.triangles).camera_hits(camera)
    pixel = hits.pixel.numpy()
    corner = mesh.triangles[hits.triangle.numpy()]
    ours = mesh.vertices[corner].mean(axis=1)[:, 2]
    both = (truth.seen & (r.face.mask > 0.5)).ravel()[pixel]
    scale = np.median(ours[both] / truth.position.reshape(-1, 3)[pixel[both], 2])
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    parts = tuple(
        replace(part, vertices=part.vertices * scale).moved(turn, middle - turn @ middle)
        for part in scan.parts
    )
    return Scan(scan.name, camera, parts)


def regions(table: Turntable, degrees: float) -> dict[str, np.ndarray]:
    """Masks (S, S) bool of the turned head: the face, its part hardly seen, all skin."""
    turned = table.turned(degrees)
    mesh = Mesh(turned.mesh.vertices, turned.mesh.triangles)
    hits = mesh.camera_hits(turned.camera)
    pixel, triangle = hits.pixel.numpy(), hits.triangle.numpy()
    of_vertex = default_model().vertex_region[turned.mesh.triangles]

    def within(names: tuple[str, ...]) -> np.ndarray:
        a, b, c = np.isin(of_vertex, [VERTEX_REGIONS.index(name) for name in names]).T
        return a & b & c

    straight = table.turned(0)
    front = Mesh(straight.mesh.vertices, straight.mesh.triangles)
    hit = front.camera_hits(straight.camera).triangle.numpy()
    a, b, c = (straight.mesh.vertices[straight.mesh.triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normal, axis=1) * np.linalg.norm(a, axis=1)
    square = -(normal * a).sum(axis=1) > _SQUARE * lengths
    seen = square & np.isin(np.arange(len(a)), hit)
    face = within(_FACE)
    shown = {"face": face, "unseen": face & ~seen, "skin": within(_SKIN)}

    def image(values: np.ndarray) -> np.ndarray:
        out = np.zeros(turned.mask.size, bool)
        out[pixel] = values[triangle]
        return out.reshape(turned.mask.shape)

    return {name: image(values) for name, values in shown.items()}


def judge(
    scan: Scan, r: Reconstruction, samples: int
) -> tuple[dict[float, dict[str, float]], np.ndarray]:
    """PSNR by turn and region, and a picture of ours above the truth."""
    table = Turntable(r)
    found, columns = {}, []
    for turn in TURNS:
        ours = Relighter(table.turned(turn)).under(uniform(), [0.0]).image(0)
        other = turned_truth(scan, r, turn)
        truth = other.photograph(uniform(), samples)
        masks = {name: x & other.truth.seen for name, x in regions(table, turn).items()}
        gain = best_gain(ours, truth, masks["skin"])
        found[turn] = {name: psnr(gain * ours, truth, x) for name, x in masks.items()}
        columns.append(np.vstack([gain * ours, truth]))
    return found, np.hstack(columns)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--samples", type=int, default=64, help="of the path tracer, per pixel")
    parser.add_argument("--steps", type=Path, help="folder of finished steps")
    parser.add_argument("-o", "--output", type=Path, help="folder for pictures")
    options = parser.parse_args()
    if not (SHARED / "data").is_dir():
        parser.error(f"{SHARED}: the licensed test data are not there")
    settings = replace(PRESETS["draft"], resolution=SIZE)
    body, gains = [], []
    with tempfile.TemporaryDirectory() as temporary:
        steps = options.steps or Path(temporary)
        for yaw in YAWS:
            scan = lee_perry_smith(SIZE, yaw)
            content = key("turned", yaw, *scan.mesh(), *vars(scan.truth).values())
            lights = tuple(light(name) for name in LIGHTS)
            store = StepCache(steps / f"scan{yaw:g}")
            study = Study(scan, content, lights, settings, store, options.samples)
            for shot in study.shots():
                figures, picture = judge(scan, study.face(shot), options.samples)
                if options.output:
                    options.output.mkdir(parents=True, exist_ok=True)
                    eight = np.rint(255 * encode_srgb(np.clip(picture, 0, 1))).astype(np.uint8)
                    name = f"turned-{yaw:g}-{shot.light.name}.png"
                    (options.output / name).write_bytes(png(eight))
                for turn, row in figures.items():
                    before = BEFORE.get((yaw, shot.light.name, turn), (np.nan,) * 3)
                    cells = (
                        f"{b:.1f} / {a:.1f}" for b, a in zip(before, row.values(), strict=True)
                    )
                    body.append((f"{yaw:g}", shot.light.name, f"{turn:g}", *cells))
                    gains.append(list(row.values()) + list(before))
    mean = np.mean(gains, axis=0)
    body.append(("mean", "", "", *(f"{mean[3 + k]:.1f} / {mean[k]:.1f}" for k in range(3))))
    header = ("photo's yaw", "light", "turned by", "face", "of it hardly seen", "all skin")
    facts = [f"draft, {SIZE} x {SIZE} pixels; PSNR, dB, before / now"]
    print(markdown("Turned heads", facts, [Table("PSNR", header, tuple(body))]))


if __name__ == "__main__":
    main()
