"""How good the fitted mesh is, on heads whose surface is known (docs/geometry.md).

    python benchmarks/geometry.py [--people LIST] [--lights LIST] [--model FILE] [--seeds N]
                                  [--relight] [--quick] -o DIR
    python benchmarks/quality.py --geometry ...        the same

Every head is photographed by path tracing under each light, and the head model is fitted to the
photo in four ways. Per photo and way: the angle between the mesh's and the true normals (mean and
median, degrees) and the error of depth after one scale (mm) inside the face without eyes, nostrils
and inner mouth; the angle between the two heads' axes of symmetry (degrees), which says how far
their turn is off whatever their shapes; the landmarks' residual (% of the eye distance).
`features`: how far the strongest edges of the true normals near the wings of the nose, the mouth's
line, the lips' edges, the lids and the jaw are displaced across themselves (features.py; pixels at
512, median and 90th percentile; of all of the face in the tables, of each by name in the JSON).
With --seeds every photo is taken N times with other noise, and the figures are means;
`normal_spread` is the largest less the smallest mean angle of the N. With --relight the five stages
(`draft`) run on three of the fits, and on the last one without stage 3, too: PSNR (dB, sRGB, inside
the face, after one gain) of the head relit by all lights, the mesh's and the specular normals' mean
angle after the stages, and `halo`, the albedo's error within 6 pixels of those features over its
error elsewhere. That takes about a minute for each photo.

DIR gets geometry.md, geometry.json, a picture of the errors for each head, and in DIR/steps the
photos, so that a second run takes half a second a photo. Settings are chosen on the people marked
`tuned`, and judged on the others.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import features
import numpy as np
from numpy.typing import NDArray
from subjects import SHARED, ict, lee_perry_smith, own

# isort: split
from threadpoolctl import threadpool_limits

from unlit.color import encode_srgb
from unlit.evaluate.command import light
from unlit.evaluate.metrics import best_gain, psnr
from unlit.evaluate.protocol import NamedLight, Shot, Study
from unlit.evaluate.step_cache import StepCache
from unlit.evaluate.table import Table, markdown
from unlit.evaluate.truth import KnownSubject, visible_surface
from unlit.face.conditions import Conditions
from unlit.face.face import PosedMesh
from unlit.face.head import FittedHead
from unlit.face.photo import FacePhoto
from unlit.fit.head import landmark_problem
from unlit.fit.landmarks import HeadFit, LandmarkProblem
from unlit.fit.shading import ShadingProblem
from unlit.head.landmark_error import NO_ERROR
from unlit.head.model import HeadModel
from unlit.head.sources.library import default_model
from unlit.optimize.run_record import RunRecord
from unlit.output.images import png
from unlit.perception.topology import FACE_OVAL, LEFT_EYE, LIPS_INNER, RIGHT_EYE
from unlit.photo.photo import Photo
from unlit.pipeline.chain import Steps, run_chain
from unlit.pipeline.observe import observe
from unlit.render.relighter import Relighter
from unlit.settings.fit import LandmarkFit, ShadingFit
from unlit.settings.settings import PRESETS, Settings
from unlit.storage.folder import write_one
from unlit.storage.keys import key

SIZE = 256
SKY = SHARED / "data/hdri/lebombo_1k.hdr"
LIGHTS = ("uniform", "flash", "side", "sky")
QUICK = ("own-41", "ict-22", "scan-20")
STAGES = replace(PRESETS["draft"], resolution=SIZE)
WITHOUT_3 = replace(STAGES, stage3=replace(STAGES.stage3, iterations=0))
_SUFFIX = "_without_stage_3"
#: Ways of fitting that --relight goes on from; the last one without stage 3, too.
RELIT = ("mean head", "landmarks", "photometric")
#: What a landmark fit should not do.
TIGHT = LandmarkFit(oval_weight=1, other_weight=1, deviation=1.5, huber=30, last_deviation=1.5)
#: Pairs of landmarks around the nostrils, and the radius about their middle, pixels of 512.
_NOSTRILS, _NOSTRIL = ((98, 97), (327, 326)), 6.0
_WORST = 30.0
#: Figures of the table of means, in its heading's order.
_MEANS = ("normal_mean", "depth_mm", "turn", "features_all_50", "features_all_90")

_SMILE = {"mouthSmile_L": 0.6, "mouthSmile_R": 0.5, "cheekSquint_L": 0.3, "cheekSquint_R": 0.3}
_OPEN = {"jawOpen": 0.3, "browInnerUp_L": 0.5, "browInnerUp_R": 0.5}
_OWN_SMILE = {"mouthSmileLeft": 0.5, "mouthSmileRight": 0.6, "browInnerUp": 0.4}
_OWN_POUT = {"mouthPucker": 0.5, "browDownLeft": 0.5, "browDownRight": 0.5}


@dataclass(frozen=True)
class Person:
    """A head to be fitted: how to make it at a size, its turn, degrees, and which half it is of."""

    make: Callable[[int], KnownSubject]
    yaw: float
    tuned: bool


def _ict(skin: str, seed: int, yaw: float, tuned: bool, **more: object) -> Person:
    return Person(lambda size: ict(skin, seed, size, yaw, **more), yaw, tuned)


def _own(skin: str, seed: int, yaw: float, tuned: bool, expression: dict[str, float]) -> Person:
    return Person(lambda size: own(skin, seed, size, yaw, expression), yaw, tuned)


def _scan(yaw: float, tuned: bool) -> Person:
    return Person(lambda size: lee_perry_smith(size, yaw), yaw, tuned)


def people() -> dict[str, Person]:
    """All heads that this machine can make; all but own-* need the licensed test data."""
    found = {
        "own-41": _own("light", 41, 12, True, _OWN_SMILE),
        "own-42": _own("dark", 42, -18, False, _OWN_POUT),
    }
    if (SHARED / "data").is_dir():
        found |= {
            "ict-21": _ict("light", 21, 0, True),
            "ict-22": _ict("dark", 22, 15, True),
            "ict-23": _ict("light", 23, -25, True),
            "ict-24": _ict("medium", 24, 8, True, deviation=1.1, expression=_SMILE),
            "ict-31": _ict("dark", 31, 0, False),
            "ict-32": _ict("light", 32, 30, False),
            "ict-33": _ict("medium", 33, -12, False, lipstick=True),
            "ict-34": _ict("light", 34, -5, False, deviation=1.1),
            "ict-35": _ict("medium", 35, 20, False, expression=_SMILE),
            "ict-36": _ict("dark", 36, -20, False, expression=_OPEN),
            "scan-20": _scan(20, True),
            "scan-0": _scan(0, False),
            "scan--30": _scan(-30, False),
        }
    return found


@dataclass(frozen=True)
class Case:
    """One photo of a person, among those under all lights, `shots`.

    mask: where errors count. landmarks: (478, 2), pixels, seen in even light. position, normal,
    albedo: (H, W, 3), the truth.
    """

    name: str
    light: str
    yaw: float
    photo: FacePhoto
    mask: np.ndarray
    landmarks: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    albedo: np.ndarray
    shots: tuple[Shot, ...]


def cases(
    name: str,
    person: Person,
    lights: Sequence[str],
    steps: Path,
    size: int = SIZE,
    seed: int = 0,
) -> list[Case]:
    """The person photographed under every light; seed: of the path tracer."""
    subject = person.make(size)
    vertices, triangles = subject.mesh()
    known = tuple(named(x) for x in ("uniform", *(x for x in lights if x != "uniform")))
    content = key(name, size, vertices, triangles, *vars(subject.truth).values())
    study = Study(
        *(subject, content, known, replace(PRESETS["draft"], resolution=size), StepCache(steps)),
        samples=64,
        seed=seed,
    )
    shots = study.shots()
    photos_by_light = {shot.light.name: _observed(name, shot, subject) for shot in shots}
    position, normal = visible_surface(*_welded(vertices, triangles), subject.camera)
    landmarks = photos_by_light["uniform"].landmarks[:, :2]
    mask = face(landmarks, size) & (normal != 0).any(axis=2)
    truth = landmarks, position, normal, subject.truth.diffuse_albedo
    return [
        Case(name, x, person.yaw, photos_by_light[x], mask, *truth, shots)
        for x in lights
        if x in photos_by_light
    ]


def named(name: str) -> NamedLight:
    """A light by name; `sky` is a photographed one."""
    return replace(light(str(SKY)), name=name) if name == "sky" else light(name)


def _observed(name: str, shot: Shot, subject: KnownSubject) -> FacePhoto:
    photo = np.rint(255 * np.clip(encode_srgb(shot.image), 0, 1)).astype(np.uint8)
    return observe(Photo.of(photo, name), shot.image.shape[0], "largest", camera=subject.camera)


def _welded(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mesh without the copies of vertices along cuts of the texture, whose normals differ."""
    vertices, index = np.unique(np.round(vertices, 4), axis=0, return_inverse=True)
    return vertices.astype(np.float32), index.ravel()[triangles].astype(np.int32)


def face(landmarks: np.ndarray, size: int) -> np.ndarray:
    """(S, S) bool: the face's oval without eyes, nostrils, inner mouth and a margin."""
    unit = size / 512

    def filled(contour: tuple[int, ...]) -> NDArray[np.uint8]:
        image = np.zeros((size, size), np.uint8)
        cv2.fillPoly(image, [np.round(landmarks[list(contour)]).astype(np.int32)], 1)
        return image

    def disk(radius: float) -> np.ndarray:
        side = 2 * max(1, round(radius * unit)) + 1
        return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))

    inside = cv2.erode(filled(FACE_OVAL), disk(6))
    holes = filled(RIGHT_EYE) | filled(LEFT_EYE) | filled(LIPS_INNER)
    for a, b in _NOSTRILS:
        middle = landmarks[[a, b]].mean(axis=0) - (0, 2 * unit)
        cv2.circle(holes, np.round(middle).astype(int).tolist(), round(_NOSTRIL * unit), 1, -1)
    return (inside > 0) & (cv2.dilate(holes, disk(3)) == 0)


Fitter = Callable[[HeadModel, FacePhoto], HeadFit]


def _closed(photo: FacePhoto) -> bool:
    return bool(photo.regions.mouth.max() < 0.5)


def mean_head(model: HeadModel, photo: FacePhoto) -> HeadFit:
    """The mean head with the pose that fits the landmarks best."""
    problem = LandmarkProblem(model, photo.landmarks, photo.camera, LandmarkFit())
    state = problem.start()
    for _ in range(problem.settings.iterations):
        state = problem.step(state, slice(6))
    return problem.posed(state, model.vertices(state.identity, state.expression))


def tight_fit(model: HeadModel, photo: FacePhoto) -> HeadFit:
    """To all landmarks as the landmarker gives them, trusted to 1.5 pixels of 512."""
    problem = LandmarkProblem(model, photo.landmarks, photo.camera, TIGHT, NO_ERROR)
    return problem.solve(_closed(photo))


def landmark_fit(model: HeadModel, photo: FacePhoto) -> HeadFit:
    """To the landmarks and the outline, as `shading_fit` starts."""
    return landmark_problem(photo, model, STAGES).solve(_closed(photo))


def shading_fit(model: HeadModel, photo: FacePhoto) -> HeadFit:
    """What `unlit reconstruct` does."""
    problem = landmark_problem(photo, model, STAGES)
    closed = _closed(photo)
    shading = ShadingProblem(problem, photo.image, photo.regions, ShadingFit())
    return shading.solve(problem.solve(closed), closed)


FITTERS: dict[str, Fitter] = {
    "mean head": mean_head,
    "tight": tight_fit,
    "landmarks": landmark_fit,
    "photometric": shading_fit,
}


@dataclass(frozen=True)
class Found:
    """Errors of one fit: figures by name, and the normals' error (H, W), degrees, NaN outside."""

    figures: dict[str, float]
    image: np.ndarray


def judge(case: Case, model: HeadModel, fit: HeadFit, seconds: float) -> Found:
    """The errors that the module's docstring names."""
    position, normal = visible_surface(fit.vertices, model.triangles, case.photo.camera)
    error = _degrees(case, normal)
    seen = np.isfinite(error)
    ours, true = -position[seen][:, 2], -case.position[seen][:, 2]
    scale = np.median(true / ours)
    yaw = np.radians(case.yaw)
    axis = fit.state.rotation @ (1, 0, 0)
    turn = np.degrees(np.arctan2(-axis[2], axis[0])) - np.degrees(yaw)
    across = np.array([np.cos(yaw), 0, -np.sin(yaw)])
    figures = {
        "normal_mean": np.nanmean(error),
        "normal_median": np.nanmedian(error),
        "depth_mm": 10 * np.abs(scale * ours - true).mean(),
        "turn": np.degrees(np.arccos(np.clip(axis @ across, -1, 1))),
        "yaw": turn,
        "landmarks_percent": 100 * fit.landmark_residual,
        "seconds": seconds,
    }
    figures |= _features(case, normal)
    return Found({name: round(float(x), 3) for name, x in figures.items()}, error)


def _features(case: Case, normal: np.ndarray) -> dict[str, float]:
    """Median and 90th percentile of the features' displacements, pixels at 512."""
    moved = features.distances(case.normal, normal, case.mask, case.landmarks)
    return {
        f"features_{name}_{share}": np.percentile(values, share)
        for name, values in moved.items()
        for share in (50, 90)
        if len(values)
    }


def _degrees(case: Case, normal: np.ndarray) -> np.ndarray:
    """(H, W): angle of normals (H, W, 3), 0 where there is none, to the truth; NaN outside."""
    seen = case.mask & (normal != 0).any(axis=2)
    cosine = np.clip((normal * case.normal).sum(axis=2), -1, 1)
    return np.where(seen, np.degrees(np.arccos(cosine)), np.nan)


def relit(case: Case, model: HeadModel, fit: HeadFit, settings: Settings) -> dict[str, float]:
    """What the stages make of the fit: PSNR under each light, mean angles of mesh and map."""
    posed = PosedMesh(fit.vertices, model.triangles, model.uv, model.triangle_uv)
    head = FittedHead(posed, fit.landmarks.astype(np.float32), model.landmark_points)
    steps = Steps(lambda _: case.photo, lambda *_: head, lambda *_: Conditions())
    face = run_chain(steps, settings, RunRecord(lambda *_: None)).face
    mask = (face.mask > 0.5) & (case.normal != 0).any(axis=2)
    relighter, figures = Relighter(face), {}
    for shot in case.shots:
        image = relighter(shot.light.environment)
        gain = best_gain(image, shot.image, mask)
        figures[f"relit_{shot.light.name}"] = psnr(image * gain, shot.image, mask)
    mesh = visible_surface(face.mesh.vertices, face.mesh.triangles, face.camera)[1]
    figures["mesh_after"] = np.nanmean(_degrees(case, mesh))
    figures["map_after"] = np.nanmean(_degrees(case, face.normals.specular))
    figures |= {f"{name}_after": x for name, x in _features(case, mesh).items()}
    albedo = face.maps.diffuse_albedo
    albedo = albedo * best_gain(albedo, case.albedo, mask)
    error = np.abs(encode_srgb(albedo) - encode_srgb(case.albedo)).mean(axis=2)
    figures["halo"] = features.halo(error, mask, case.landmarks)
    return {name: round(float(x), 3) for name, x in figures.items()}


def run(case: Case, model: HeadModel, relight: bool = False) -> dict[str, Found]:
    """Every way of fitting on one photo; relight: and the stages on it."""
    found = {}
    for name, fitter in FITTERS.items():
        start = time.process_time()
        with threadpool_limits(1, user_api="blas"):
            fit = fitter(model, case.photo)
        found[name] = judge(case, model, fit, time.process_time() - start)
        if relight and name in RELIT:
            found[name].figures.update(relit(case, model, fit, STAGES))
        if relight and name == RELIT[-1]:
            without = relit(case, model, fit, WITHOUT_3)
            found[name].figures.update({f"{x}{_SUFFIX}": y for x, y in without.items()})
    return found


def averaged(rows: list[tuple[Case, dict[str, Found]]]) -> dict[str, dict[str, dict[str, float]]]:
    """Figures by light and way, their mean over the photos under one light that have them."""
    lights: dict[str, list[dict[str, Found]]] = {}
    for case, found in rows:
        lights.setdefault(case.light, []).append(found)
    result: dict[str, dict[str, dict[str, float]]] = {}
    for name, photos in lights.items():
        result[name] = {}
        for way in photos[0]:
            figures = [found[way].figures for found in photos]
            names = dict.fromkeys(key for f in figures for key in f)
            mean = {key: float(np.mean([f[key] for f in figures if key in f])) for key in names}
            spread = float(np.ptp([f["normal_mean"] for f in figures]))
            result[name][way] = mean | {"normal_spread": spread}
    return result


def picture(rows: list[tuple[Case, dict[str, Found]]]) -> np.ndarray:
    """(H, W, 3) uint8 sRGB: one row a light, the photo and each way's error, 0 to 30 degrees."""
    lines = []
    for case, found in rows:
        photo = np.rint(255 * np.clip(encode_srgb(case.photo.image), 0, 1)).astype(np.uint8)
        line = [photo]
        for way in found.values():
            level = np.rint(255 * np.clip(np.nan_to_num(way.image) / _WORST, 0, 1))
            colour = cv2.applyColorMap(level.astype(np.uint8), cv2.COLORMAP_INFERNO)[..., ::-1]
            line.append(np.where(np.isnan(way.image)[..., None], photo // 3, colour))
        lines.append(np.concatenate(line, axis=1))
    return np.concatenate(lines).astype(np.uint8)


Results = dict[str, dict[str, dict[str, dict[str, float]]]]  # person, light, way, figure


def tables(results: Results, tuned: dict[str, bool]) -> list[Table]:
    """Every photo; and the means of the two halves."""
    names = list(_first(_first(results)))
    body = []
    for person, lights in results.items():
        for name, found in lights.items():
            cells = (
                f"{x['normal_mean']:.1f} / {x['normal_median']:.1f} / {x['depth_mm']:.1f} / "
                f"{x['turn']:.1f} / {x['landmarks_percent']:.1f}"
                for x in found.values()
            )
            body.append((person, "tuned" if tuned[person] else "", name, *cells))
    every = Table(
        "Normals mean / median (degrees) / depth (mm) / turn (degrees) / landmarks (%)",
        ("head", "half", "light", *names),
        tuple(body),
    )
    means = []
    for half, is_tuned in (("tuned", True), ("held out", False)):
        for kind in ("own", "ict", "scan"):
            chosen = [p for p in results if p.startswith(kind) and tuned[p] == is_tuned]
            for name in sorted({x for p in chosen for x in results[p]}):
                found = [results[p][name] for p in chosen if name in results[p]]
                cells = (
                    " / ".join(
                        f"{np.mean([f[way][figure] for f in found]):.1f}" for figure in _MEANS
                    )
                    for way in names
                )
                means.append((kind, half, name, *cells))
    halves = Table(
        "Means: normals (degrees) / depth (mm) / turn (degrees) / features, 50 / 90 % (pixels)",
        ("heads", "half", "light", *names),
        tuple(means),
    )
    return [halves, every]


def relighting_tables(results: Results) -> list[Table]:
    """By kind of head and input light: PSNR under every light, mean and worst; angles after."""
    columns = [*((way, "") for way in RELIT), (RELIT[-1], _SUFFIX)]
    heading = [f"{way}{suffix.replace('_', ' ')}" for way, suffix in columns]
    lights = list(_first(results))

    def relit(figures: list[dict[str, float]], suffix: str) -> str:
        values = np.array([[f[f"relit_{x}{suffix}"] for x in lights] for f in figures])
        means = " / ".join(f"{x:.1f}" for x in values.mean(axis=0))
        return f"{means} (worst {values.min():.1f})"

    def beside(figures: list[dict[str, float]], suffix: str) -> str:
        names = ("features_all_50_after", "features_all_90_after", "halo")
        return " / ".join(
            f"{np.mean([f[f'{name}{suffix}'] for f in figures]):.2f}" for name in names
        )

    def angles(figures: list[dict[str, float]], suffix: str) -> str:
        names = ("normal_mean", f"mesh_after{suffix}", f"map_after{suffix}")
        return " / ".join(f"{np.mean([f[name] for f in figures]):.1f}" for name in names)

    tables = []
    for title, cell in (
        (f"Relit, mean of {' / '.join(lights)} (dB)", relit),
        ("Normals before / after the stages, mesh / map (degrees)", angles),
        ("Features after the stages, median / 90 % (pixels); halo", beside),
    ):
        body = []
        for kind in ("own", "ict", "scan"):
            heads = [found for person, found in results.items() if person.startswith(kind)]
            for name in lights if heads else ():
                cells = [cell([found[name][way] for found in heads], end) for way, end in columns]
                body.append((kind, name, *cells))
        tables.append(Table(title, ("heads", "input", *heading), tuple(body)))
    return tables


def _first(mapping: dict) -> dict:
    return next(iter(mapping.values()))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--people", default="", help="comma-separated; default all there are")
    parser.add_argument("--lights", default=",".join(LIGHTS), help="comma-separated")
    parser.add_argument("--model", type=Path, help="head model file; default the built-in one")
    parser.add_argument("--seeds", type=int, default=1, help="photos of each; default 1")
    parser.add_argument("--relight", action="store_true", help="run the stages on every fit, too")
    parser.add_argument("--quick", action="store_true", help="three people, flash and side light")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to write")
    options = parser.parse_args(arguments)
    everyone = people()
    chosen = options.people.split(",") if options.people else list(everyone)
    lights = options.lights.split(",")
    if options.quick:
        chosen, lights = [name for name in QUICK if name in everyone], ["flash", "side"]
    if unknown := set(chosen) - set(everyone):
        parser.error(f"no such head here: {', '.join(sorted(unknown))}; {', '.join(everyone)}")
    if not SKY.is_file():
        lights = [name for name in lights if name != "sky"]
    model = default_model() if options.model is None else HeadModel.load(options.model)
    folder = options.output
    results: Results = {}
    for name in chosen:
        rows = [
            (case, run(case, model, options.relight))
            for seed in range(options.seeds)
            for case in cases(name, everyone[name], lights, folder / "steps" / name, seed=seed)
        ]
        results[name] = averaged(rows)
        write_one(folder / f"{name}.png", png(picture(rows)))
        print(f"{name} done", file=sys.stderr, flush=True)
    facts = [
        f"head model {model.name}, {SIZE} x {SIZE} pixels, 64 samples a pixel",
        f"photos of each head under each light: {options.seeds}",
    ]
    tuned = {name: everyone[name].tuned for name in chosen}
    made = tables(results, tuned)
    if options.relight:
        made = [*made[:1], *relighting_tables(results), *made[1:]]
    text = markdown("Geometry", facts, made)
    write_one(folder / "geometry.md", text.encode())
    content = {"model": model.name, "size": SIZE, "tuned": tuned, "figures": results}
    write_one(folder / "geometry.json", json.dumps(content, indent=1).encode())
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
