"""Pictures of the stages: what is taken, kept and read back, and what is refused."""

import io
import zipfile

import numpy as np
import pytest
from PIL import Image

from changed import changed, part
from unlit.color import encode_srgb
from unlit.errors import OutputError
from unlit.report.stages import STAGES, pack_stages, read_stages, stage_pictures


def decoded(content: bytes) -> np.ndarray:
    picture = Image.open(io.BytesIO(content))
    assert picture.format == "WEBP"
    return np.asarray(picture) / 255


def test_pictures_show_the_state(face):
    taken = stage_pictures(face)
    assert taken.keys() == {"render", "albedo", "normals"}
    truth = encode_srgb(face.face.maps.diffuse_albedo) * (face.face.mask > 0)[..., None]
    inside = np.zeros(face.face.mask.shape, bool)
    inside[44:52, 44:52] = True  # away from edges, where lossy pictures differ
    assert np.abs(decoded(taken["albedo"]) - truth)[inside].max() < 0.04


def test_no_render_before_the_first_stage(face):
    after_fit = stage_pictures(changed(face, {"images.render": np.zeros_like(face.images.render)}))
    assert after_fit.keys() == {"albedo", "normals"}


def test_large_states_are_reduced(face):
    large = {
        place: np.repeat(np.repeat(part(face, place), 8, axis=0), 8, axis=1)
        for place in (
            "images.render",
            "face.maps.diffuse_albedo",
            "face.normals.specular",
            "face.mask",
        )
    }
    assert decoded(stage_pictures(changed(face, large))["render"]).shape == (512, 512, 3)


def test_kept_pictures_come_back_in_order(face, tmp_path):
    one = stage_pictures(face)
    stages = [("fit", {"albedo": one["albedo"]}), *((f"stage{k}", one) for k in range(1, 6))]
    (tmp_path / STAGES).write_bytes(pack_stages(stages))
    assert read_stages(tmp_path) == stages
    assert pack_stages(stages) == pack_stages(stages)


def test_a_result_without_them_has_none(tmp_path):
    assert read_stages(tmp_path) == []


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("../evil.webp", b"RIFF....WEBP"),
        ("00-stage9/render.webp", b"RIFF....WEBP"),
        ("00-fit/render.webp", b"<svg onload=alert(1)>"),
        ("00-fit/render.webp", b"RIFF....WEBP" + bytes(5 << 20)),
    ],
)
def test_foreign_entries_are_refused_in_one_line(tmp_path, name, content):
    with zipfile.ZipFile(tmp_path / STAGES, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
    with pytest.raises(OutputError, match=r"stages\.zip: damaged"):
        read_stages(tmp_path)


def test_damage_is_an_error_of_one_line(face, tmp_path):
    whole = pack_stages([("stage1", stage_pictures(face))])
    for spoilt in (b"", whole[: len(whole) // 2], whole[:200] + bytes(50) + whole[250:]):
        (tmp_path / STAGES).write_bytes(spoilt)
        with pytest.raises(OutputError):
            read_stages(tmp_path)
