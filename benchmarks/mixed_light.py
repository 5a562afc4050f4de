"""What a light of its own for each channel would bring: docs/lab/method-notes-light.md, 6.1.

    python benchmarks/mixed_light.py [--subjects LIST]

Subjects of known truth are photographed in lights of two colours that are white together, by path
tracing, and reconstructed on their true mesh (`draft`) in two ways: with the one white light of the
method; and channel by channel, each a grey photo with lobes of its own, put together so that the
three lights have the same flux. Per way: albedo's PSNR (dB, sRGB, inside the face without the eyes)
and mean angle to the truth in RGB (degrees), and PSNR relit by a white flash and a white uniform
light, each after one gain / after one gain for each channel. The second figure leaves out what a
single colour for all of the light explains.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from subjects import SHARED, standard

import unlit
from unlit.evaluate.command import light
from unlit.evaluate.metrics import angle, best_gain, channel_gains, psnr
from unlit.evaluate.table import Table, markdown
from unlit.evaluate.truth import KnownSubject
from unlit.face.conditions import Conditions
from unlit.face.head import FittedHead
from unlit.face.photo import FacePhoto
from unlit.face.reconstruction import Reconstruction
from unlit.optimize.run_record import RunRecord
from unlit.photo.photo import Photo
from unlit.pipeline.chain import Steps, run_chain
from unlit.pipeline.observe import observe
from unlit.render.relighter import Relighter
from unlit.scene.light import RASTER, disc, latlong_solid_angles
from unlit.settings.settings import PRESETS
from unlit.storage.pictures import read_picture

SIZE = 256
SETTINGS = replace(PRESETS["draft"], resolution=SIZE)
WHITE = {name: light(name).environment for name in ("flash", "uniform")}
_EXPOSURE = 0.8
#: Colour of a lamp, linear sRGB; the cold one has it the other way round.
_WARM = np.array([1.5, 1, 0.5], np.float32)


def two_lamps() -> np.ndarray:
    """A warm lamp to one side, a cold one to the other, and a little even white: (180, 360, 3)."""
    warm, cold = (disc((side, 0.2, 0.56), 0.8, 20)[..., None] for side in (0.8, -0.8))
    return warm * _WARM + cold * _WARM[::-1] + np.float32(0.05)


def sky(name: str) -> np.ndarray:
    """A photographed environment (180, 360, 3), its mean made white."""
    radiance = read_picture(SHARED / "data/hdri" / name)
    height, width = RASTER
    radiance = cv2.resize(radiance, (width, height), interpolation=cv2.INTER_AREA)
    weight = latlong_solid_angles(height, width)[..., None]
    return (radiance * (weight.sum() / (radiance * weight).sum(axis=(0, 1)))).astype(np.float32)


def lights() -> dict[str, Callable[[], np.ndarray]]:
    """By name; the skies need the licensed test data."""
    found: dict[str, Callable[[], np.ndarray]] = {"two lamps": two_lamps}
    if (SHARED / "data/hdri").is_dir():
        found["sunset"] = lambda: sky("venice_sunset_1k.hdr")
        found["street"] = lambda: sky("potsdamer_platz_1k.hdr")
    return found


def photograph(subject: KnownSubject, environment: np.ndarray) -> np.ndarray:
    """(H, W, 3) linear, under a light of any colours."""
    channels = [np.ascontiguousarray(environment[..., c]) for c in range(3)]
    image = np.stack([subject.photograph(e, 128)[..., c] for c, e in enumerate(channels)], axis=2)
    return image * np.float32(_EXPOSURE / np.percentile(image[subject.truth.seen], 99))


Way = tuple[np.ndarray, dict[str, np.ndarray]]  # albedo; the face by white light


def reconstructed(photo: FacePhoto, head: FittedHead) -> Reconstruction:
    steps = Steps(lambda _: photo, lambda *_: head, lambda *_: Conditions())
    return run_chain(steps, SETTINGS, RunRecord(lambda *_: None))


def one_light(photo: FacePhoto, head: FittedHead) -> tuple[Way, Reconstruction]:
    made = reconstructed(photo, head)
    relighter = Relighter(made.face)
    relit = {x: relighter(e) for x, e in WHITE.items()}
    return (made.face.maps.diffuse_albedo, relit), made


def light_of_each_channel(photo: FacePhoto, head: FittedHead) -> Way:
    faces = []
    for channel in range(3):
        grey = np.repeat(photo.image[..., channel : channel + 1], 3, axis=2)
        faces.append(reconstructed(replace(photo, image=grey), head))
    area = latlong_solid_angles(*RASTER)
    flux = np.array([(face.light.rasterize() * area).sum() for face in faces])
    gains = flux / flux.mean()

    def together(images: list[np.ndarray]) -> np.ndarray:
        return np.stack([x[..., 0] * g for x, g in zip(images, gains, strict=True)], axis=2)

    relighters = [Relighter(face.face) for face in faces]
    relit = {x: together([relight(e) for relight in relighters]) for x, e in WHITE.items()}
    return together([face.face.maps.diffuse_albedo for face in faces]), relit


def figures(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> tuple[list[float], float]:
    """PSNR after one gain and after three; the angle after three, since one changes none."""
    each = channel_gains(image, truth, mask)
    found = [psnr(image * gain, truth, mask) for gain in (best_gain(image, truth, mask), each)]
    return found, _angle(image * each, truth, mask)


def _angle(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """Mean angle, degrees, between colours in RGB, which their brightness does not change."""
    a, b = (x / np.maximum(np.linalg.norm(x, axis=2, keepdims=True), 1e-9) for x in (image, truth))
    return angle(a, b, mask)


def rows(name: str, subject: KnownSubject) -> list[tuple[str, ...]]:
    """The table's lines of one subject."""
    truth = subject.truth
    by_white = {x: subject.photograph(e, 128) for x, e in WHITE.items()}
    found = []
    for label, make in lights().items():
        image = photograph(subject, make())
        photo = observe(Photo.of(image.astype(np.float32), name), SIZE, camera=subject.camera)
        head = FittedHead.of_mesh(*subject.mesh(), photo.landmarks)
        white, face = one_light(photo, head)
        mask = truth.seen & (face.face.mask > 0.5) & (photo.regions.eyes < 0.3)
        ways = {
            "one white light": white,
            "one for each channel": light_of_each_channel(photo, head),
        }
        for way, (albedo, relit) in ways.items():
            (one, three), after_three = figures(albedo, truth.diffuse_albedo, mask)
            cells = [f"{one:.1f} / {three:.1f}"]
            cells.append(f"{_angle(albedo, truth.diffuse_albedo, mask):.1f} / {after_three:.1f}")
            for light_name, picture in relit.items():
                one, three = figures(picture, by_white[light_name], mask)[0]
                cells.append(f"{one:.1f} / {three:.1f}")
            found.append((name, label, way, *cells))
            print(*found[-1], sep=" | ", file=sys.stderr, flush=True)
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--subjects", help="comma-separated; default all there are")
    options = parser.parse_args(arguments)
    subjects = standard(SIZE)
    chosen = options.subjects.split(",") if options.subjects else list(subjects)
    if unknown := set(chosen) - set(subjects):
        parser.error(f"no such subject here: {', '.join(sorted(unknown))}; {', '.join(subjects)}")
    body = [row for name in chosen for row in rows(name, subjects[name]())]
    heading = ("subject", "light", "way", "albedo", "angle", *(f"relit {x}" for x in WHITE))
    facts = [f"unlit {unlit.__version__}, {SIZE} x {SIZE} pixels, preset draft, true mesh"]
    print(markdown("Light of two colours", facts, [Table("", heading, tuple(body))]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
