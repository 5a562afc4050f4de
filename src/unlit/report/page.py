"""The page put together."""

from __future__ import annotations

import base64
import hashlib
import math
from html import escape
from importlib.metadata import version
from pathlib import Path
from string import Template

import tomli_w

from ..conditions.illuminant import temperature
from ..evaluate.metrics import psnr
from ..face.gain import peak_luminance
from ..face.reconstruction import Reconstruction
from ..output.atlas import Atlas
from ..output.export import job_of
from ..output.load import load
from ..output.save import LAYOUT
from ..progress.callbacks import StepProgress, silent
from ..settings.conditions import AUTO
from ..settings.settings import as_dict
from ..storage.folder import REPORT, write_one
from . import figures
from .bundle import REMEDY, WEB, missing_because, program
from .scene import scene
from .stages import Stages, read_stages

_ATLAS = 1024


def write_report(folder: str | Path, progress: StepProgress = silent) -> Path:
    """Write report.html of the result saved in `folder`, and return its path.

    Raises OutputError where the folder is no result or cannot be written.
    """
    folder = Path(folder)
    stages = read_stages(folder)
    result = load(folder)
    path = folder / REPORT
    progress("baking the atlas", 0, 2)
    atlas = job_of(result, _ATLAS, LAYOUT).atlas
    progress(f"writing {path.name}", 1, 2)
    write_one(path, report_html(result, atlas, stages).encode())
    progress("done", 2, 2)
    return path


def report_html(r: Reconstruction, atlas: Atlas, stages: Stages | None = None) -> str:
    """The whole page. It loads nothing: its own policy forbids the browser to.

    stages: what `stage_pictures` took after the fit and each stage, if anything did.
    """
    viewer, bundle = _viewer(r, atlas)
    style = _web("page.css")
    scripts = [_web("page.js"), *([bundle] if bundle else [])]
    return Template(_web("page.html")).substitute(
        title=escape(f"{r.photo.name}, unlit"),
        version=escape(version("unlit")),
        policy=_policy(style, scripts),
        style=style,
        scripts="".join(f"<script>{script}</script>\n" for script in scripts),
        photo=figures.photo(r),
        facts=_table(_facts(r)),
        overview=figures.overview(r),
        warnings=_warnings(r.metrics.warnings),
        viewer=viewer,
        stages=figures.stages(stages or []),
        maps=figures.maps(r, atlas),
        atlas=figures.atlas_maps(atlas),
        confidence=figures.confidence(atlas),
        losses=figures.losses(r.metrics.losses),
        seconds=_seconds(r.metrics.seconds),
        command="unlit reconstruct PHOTO -o DIR --config settings.toml",
        settings=escape(tomli_w.dumps(as_dict(r.settings))),
    )


def _web(name: str) -> str:
    return (WEB / name).read_text(encoding="utf-8")


def _policy(style: str, scripts: list[str]) -> str:
    """A content security policy that allows this page's own parts and nothing else."""

    def digest(text: str) -> str:
        return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"

    allowed = " ".join(digest(script) for script in scripts)
    return (
        f"default-src 'none'; img-src data:; style-src {digest(style)}; script-src {allowed}; "
        "base-uri 'none'; form-action 'none'"
    )


def _viewer(r: Reconstruction, atlas: Atlas) -> tuple[str, str | None]:
    """The viewer's section and its script, or why there is none."""
    bundle = program()
    if bundle is None:
        why = f"This installation of unlit was built without its viewer: {missing_because()}."
        return f"<p>{escape(why)} To mend it: {escape(REMEDY)}.</p>", None
    packed = scene(r, atlas)
    section = Template(_web("viewer.html")).substitute(scene=packed.numbers, arrays=packed.arrays)
    # A script ends at the first "</script", also in a string.
    return section, bundle.replace("</script", "<\\/script")


def _facts(r: Reconstruction) -> dict[str, str]:
    inside = r.face.mask > 0
    metrics = r.metrics
    found = {
        "Photo": r.photo.name,
        "Crop": f"{r.face.camera.width} x {r.face.camera.height} pixels, each "
        f"{1 / r.photo.crop.scale:.2f} of the photo's",
        "Measured": f"{inside.mean():.0%} of the crop",
        "Field of view": f"{_field_of_view(r):.1f} degrees across the crop",
    }
    if inside.any():
        found["Match"] = (
            f"{psnr(r.images.render, r.photo.image, inside):.1f} dB, re-rendering against photo"
        )
    if (residual := r.head.landmark_residual) is not None:
        found["Landmarks"] = f"missed by {residual:.1%} of the eye distance on average"
    found["Time"] = f"{sum(metrics.seconds.values()):.0f} s without writing the files"
    found["Memory"] = f"{metrics.peak_memory_mb:.0f} MB at most"
    found["Light's colour"] = _light_color(r)
    found["Gain"] = _gain(r)
    found["Mesh"] = f"{len(r.face.mesh.vertices)} vertices, {len(r.face.mesh.triangles)} triangles"
    return found


def _light_color(r: Reconstruction) -> str:
    if r.light.color.min() == r.light.color.max():
        return "taken for white"
    numbers = ", ".join(f"{value:.3f}" for value in r.light.color)
    return f"{numbers} (linear RGB), nearest to {temperature(r.light.color):.0f} K"


def _gain(r: Reconstruction) -> str:
    """What the picture cannot tell, and what was done about it."""
    known = r.settings.exposure.text
    how = f"set by {known}"
    if known == AUTO:
        card = r.light.color.max() / r.gain
        how = f"by convention, a white card in full light would be {card:.2g} times as "
        how += "bright as the photo's white"
    text = f"albedo and light share one gain, which no photo tells: {how}"
    unit = r.photo.white_luminance
    inside = r.face.mask > 0
    if unit is None or not inside.any():
        return text
    lux = math.pi * unit * peak_luminance(r.images.diffuse_shading[inside])
    return f"{text}; by the photo's exposure {lux:,.0f} lux, within a stop or so, fall there"


def _field_of_view(r: Reconstruction) -> float:
    return math.degrees(2 * math.atan(0.5 * r.face.camera.width / r.face.camera.focal))


def _table(rows: dict[str, str]) -> str:
    body = "".join(
        f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>'
        for name, value in rows.items()
    )
    return f"<table>{body}</table>"


def _warnings(sentences: tuple[str, ...]) -> str:
    if not sentences:
        return "<p>None: nothing shadowed, saturated, clipped, small or misplaced was found.</p>"
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f'<ul class="warnings">{items}</ul>'


def _seconds(seconds: dict[str, float]) -> str:
    if not seconds:
        return "<p>No times were kept.</p>"
    longest = max(seconds.values())
    rows = "".join(
        f'<tr><th scope="row">{escape(name)}</th><td class="number">{value:.1f} s</td>'
        f'<td><meter min="0" max="{longest:.3f}" value="{value:.3f}" '
        f'aria-label="{escape(name)}"></meter></td></tr>'
        for name, value in seconds.items()
    )
    return f"<table>{rows}</table>"
