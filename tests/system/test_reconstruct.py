"""The main job on real photos, at reduced size: through the command line and the API."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from skimage.data import astronaut

import unlit
from changed import part
from unlit.color import encode_srgb
from unlit.render.relighter import Relighter

PHOTOS = ("A_006", "A_039", "A_062", "obama_2012_official")
#: Far fewer iterations than `draft`: enough to run every line of every stage.
QUICK = {f"stage{k}.iterations": n for k, n in ((1, 60), (2, 60), (3, 30), (4, 30), (5, 30))}


def quick() -> unlit.Settings:
    return unlit.override(unlit.PRESETS["draft"], QUICK)


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "unlit", *arguments], capture_output=True, text=True, check=False
    )


def error_in_encoded(face: unlit.Result) -> float:
    """Root-mean-square error of the re-rendering inside the mask, sRGB-encoded."""
    inside = face.face.mask > 0.5
    difference = encode_srgb(face.images.render[inside]) - encode_srgb(face.photo.image[inside])
    return float(np.sqrt(np.mean(difference**2)))


def test_demo_writes_every_file(tmp_path: Path) -> None:
    """`unlit demo` at the draft preset: all files, a faithful re-rendering, a montage."""
    folder = tmp_path / "demo"
    done = command("demo", "-o", str(folder))
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == str(folder / "montage.png")
    face = unlit.load(folder)
    assert error_in_encoded(face) < 0.05
    assert (face.head.landmark_residual or 1) < 0.06
    names = {path.name for path in folder.iterdir()}
    for stem in ("diffuse_albedo", "specular_albedo", "roughness", "render", "mask"):
        assert {f"{stem}.exr", f"{stem}.png"} <= names
    metrics = json.loads((folder / "metrics.json").read_text())
    assert {"stage1", "stage2", "stage3", "stage4", "stage5"} <= set(metrics["seconds"])


def test_same_input_same_bits() -> None:
    """Two runs of one photo give bit-identical maps, mesh and light."""
    first, second = (
        unlit.reconstruct(astronaut(), quick(), face="largest", progress=False) for _ in range(2)
    )
    for place in (
        "face.maps.diffuse_albedo",
        "face.maps.specular_albedo",
        "face.normals.specular",
        "face.mesh.vertices",
        "images.render",
    ):
        np.testing.assert_array_equal(part(first, place), part(second, place), err_msg=place)
    np.testing.assert_array_equal(first.light.axis, second.light.axis)
    np.testing.assert_array_equal(first.light.amplitude, second.light.amplitude)


@pytest.mark.parametrize("name", PHOTOS)
def test_photo(shared: Path, name: str) -> None:
    """Dark, made-up, old and small faces: finite maps in range, a face that can be relit."""
    face = unlit.reconstruct(shared / f"data/photos/{name}.jpg", quick(), progress=False)
    inside = face.face.mask > 0.5
    assert inside.mean() > 0.1
    for image in (
        face.face.maps.diffuse_albedo,
        face.face.maps.specular_albedo,
        face.images.render,
        face.face.maps.roughness,
    ):
        assert np.isfinite(image).all()
        assert image.min() >= 0
    assert face.face.maps.diffuse_albedo[inside].max() <= 1.5
    np.testing.assert_allclose(
        np.linalg.norm(face.face.normals.specular[inside], axis=1), 1, atol=1e-4
    )
    assert (face.head.landmark_residual or 1) < 0.06
    assert error_in_encoded(face) < 0.12
    # Light from the image's right lights that side of the face more than light from the left.
    relighter = Relighter(face.face)
    right = relighter(unlit.lights.disc((1, 0, 0.5)))
    left = relighter(unlit.lights.disc((-1, 0, 0.5)))
    columns = np.nonzero(inside)[1]
    far = np.zeros_like(inside)
    far[:, int(np.percentile(columns, 75)) :] = True
    assert right[inside & far].mean() > left[inside & far].mean()
