"""The page put together."""

from __future__ import annotations

from html import escape
from importlib.metadata import version
from pathlib import Path

import tomli_w

from ..face.reconstruction import Reconstruction
from ..output.atlas import Atlas
from ..output.export import job_of
from ..output.load import load
from ..output.relit import Relit, relit
from ..output.save import LAYOUT
from ..progress.callbacks import StepProgress, silent
from ..settings.settings import as_dict
from ..storage.folder import REPORT, write_one
from . import figures
from .bundle import REMEDY, missing_because, program
from .document import document, filled, table, web
from .facts import facts
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


def report_html(
    r: Reconstruction,
    atlas: Atlas,
    stages: Stages | None = None,
    pictures: Relit | None = None,
) -> str:
    """The whole page. It loads nothing: its own policy forbids the browser to.

    stages: what `stage_pictures` took after the fit and each stage, if anything did. pictures: of
    `relit`, where they are there already.
    """
    viewer, bundle = _viewer(r, atlas)
    body = filled(
        "page.html",
        title=escape(f"{r.photo.name}, unlit"),
        version=escape(version("unlit")),
        summary=_summary(r),
        relit=figures.relit(relit(r) if pictures is None else pictures),
        photo=figures.photo(r),
        facts=table(facts(r)),
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
    scripts = [web("page.js"), *([bundle] if bundle else [])]
    return document(f"{r.photo.name}, unlit", body, scripts)


def _summary(r: Reconstruction) -> str:
    """How well it went in one line, with the way to the warnings."""
    known = facts(r)
    said = [escape(known["Match"])] if "Match" in known else []
    if "Landmarks" in known:
        said.append(escape(f"landmarks {known['Landmarks']}"))
    if count := len(r.metrics.warnings):
        plural = "" if count == 1 else "s"
        said.append(f'<a href="#warnings">{count} warning{plural}</a>')
    else:
        said.append("no warnings")
    return "; ".join(said)


def _viewer(r: Reconstruction, atlas: Atlas) -> tuple[str, str | None]:
    """The viewer's section and its script, or why there is none."""
    bundle = program()
    if bundle is None:
        why = f"This installation of unlit was built without its viewer: {missing_because()}."
        return f"<p>{escape(why)} To mend it: {escape(REMEDY)}.</p>", None
    packed = scene(r, atlas)
    section = filled("viewer.html", scene=packed.numbers, arrays=packed.arrays)
    # A script ends at the first "</script", also in a string.
    return section, bundle.replace("</script", "<\\/script")


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
