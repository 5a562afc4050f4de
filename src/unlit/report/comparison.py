"""Two results side by side on one page: what differs in words, then in pictures and numbers.

Pictures that belong to the same crop of the same photo are also compared pixel by pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SettingsError
from ..evaluate.metrics import psnr_linear
from ..face.reconstruction import Reconstruction
from ..output.images import MAPS, bytes_of, encoded, normals, webp
from ..output.load import load
from ..output.montage import clay, error, light
from ..output.relit import LIGHTS, Relit, relit
from ..output.save import RESULT_FILES
from ..progress.callbacks import StepProgress, silent
from ..scene.light import RASTER, latlong_directions, latlong_solid_angles
from ..settings.settings import as_dict
from ..storage.folder import ensure_writable, write_one
from ..storage.names import readable
from .document import document, filled, web
from .facts import facts
from .figures import figure

_LARGEST = 768  # pixels a side
#: A difference of encoded values, and an angle in degrees, that are shown as white.
_MOST, _ANGLE = 0.25, 20.0
#: Settings that are named in the list of differences.
_NAMED = 6


@dataclass(frozen=True)
class Side:
    """One of the two: what it is called on the page, the result, its relit pictures."""

    name: str
    result: Reconstruction
    relit: Relit


#: A line of pictures: its caption, a picture (H, W[, 3]) uint8 of a side, and what is compared.
Line = tuple[str, Callable[[Side], np.ndarray], str]


def write_comparison(
    folders: tuple[Path, Path], path: Path, progress: StepProgress = silent
) -> Path:
    """Write the page that compares the results in `folders` to `path`, and return it.

    Raises OutputError where a folder is no result or `path` cannot be written, SettingsError where
    it is a file of one of the results.
    """
    if path.resolve() in {(folder / name).resolve() for folder in folders for name in RESULT_FILES}:
        raise SettingsError(f"{path}: is a file of a result; choose another name")
    ensure_writable(path)
    names = _names(folders)
    sides = []
    for number, (name, folder) in enumerate(zip(names, folders, strict=True)):
        progress(f"relighting {name}", number, 3)
        result = load(folder)
        sides.append(Side(name, result, relit(result)))
    progress(f"writing {readable(path.name)}", 2, 3)
    write_one(path, comparison_html(*sides).encode())
    progress("done", 3, 3)
    return path


def _names(folders: tuple[Path, Path]) -> tuple[str, str]:
    """The folders' own names where these tell them apart, else as they were given; readable."""
    a, b = (readable(folder.resolve().name) for folder in folders)
    return (a, b) if a != b else (readable(str(folders[0])), readable(str(folders[1])))


def comparison_html(a: Side, b: Side) -> str:
    """The whole page, one file that loads nothing."""
    same = same_crop(a.result, b.result)
    title = f"{a.name} and {b.name}, unlit"
    body = filled(
        "comparison.html",
        title=escape(title),
        version=escape(version("unlit")),
        differences=_list(differences(a, b)),
        relit=_pictures(a, b, _relit_lines(), same),
        photo=_pictures(a, b, _PHOTO_LINES, same),
        maps=_pictures(a, b, _MAP_LINES, same),
        warnings=_warnings(a, b),
        numbers=_table(a, b, _numbers(a.result), _numbers(b.result)),
        settings=_settings(a, b),
    )
    return document(title, body, [web("page.js")])


def same_crop(a: Reconstruction, b: Reconstruction) -> bool:
    """Whether a pixel of one is the same pixel of the other: the same photo, cut out alike."""
    one, other = a.photo, b.photo
    return one.image.shape == other.image.shape and bool(
        np.abs(one.image - other.image).mean() < 0.01
        and np.allclose(one.crop.matrix, other.crop.matrix, atol=0.5)
    )


def differences(a: Side, b: Side) -> list[str]:
    """In words, the largest matters first: light, albedo, gloss, normals, fit, warnings."""
    one, other = a.result, b.result
    found = []
    if not same_crop(one, other):
        found.append(
            "The crops differ (another photo, resolution or face), so pictures are not compared "
            "pixel by pixel."
        )
    angle = _angle(_main_direction(one), _main_direction(other))
    found.append(f"The mean direction of the light differs by {angle:.0f} degrees.")
    means = {
        "Diffuse albedo": lambda r: r.face.maps.diffuse_albedo,
        "Specular albedo": lambda r: r.face.maps.specular_albedo,
        "Roughness": lambda r: r.face.maps.roughness,
    }
    for what, array in means.items():
        first, second = (float(array(r)[r.face.mask > 0.5].mean()) for r in (one, other))
        found.append(f"{what}, mean: {first:.3g} and {second:.3g}{_percent(first, second)}.")
    if same_crop(one, other):
        inside = (one.face.mask > 0.5) & (other.face.mask > 0.5)
        for what, n in {"Specular": "specular", "Diffuse": "diffuse"}.items():
            angles = _angles(getattr(one.face.normals, n), getattr(other.face.normals, n))[inside]
            found.append(f"{what} normals differ by {angles.mean():.1f} degrees on average.")
        for name, new in LIGHTS.items():
            decibels = psnr_linear(a.relit[name] / 255, b.relit[name] / 255, inside)
            found.append(f"Relit, {new.caption}: {decibels:.1f} dB from each other.")
    for name, (first, second) in _changed(_numbers(one), _numbers(other)).items():
        if name in ("Match", "Landmarks", "Light's colour"):
            found.append(f"{name}: {first}; {second}.")
    found.append(_changed_settings(one, other))
    return found


def _changed_settings(a: Reconstruction, b: Reconstruction) -> str:
    names = list(_changed(_flat(as_dict(a.settings)), _flat(as_dict(b.settings))))
    if not names:
        return "No settings differ."
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"Settings that differ: {', '.join(names[:_NAMED])}{more}."


def _percent(first: float, second: float) -> str:
    if first <= 0 or abs(second / first - 1) < 0.005:
        return ""
    return f", {abs(second / first - 1):.0%} {'more' if second > first else 'less'}"


def _main_direction(r: Reconstruction) -> np.ndarray:
    """(3,) mean of the light's directions, weighted by its power; not normalised."""
    environment = r.light.environment
    radiance = environment if environment.ndim == 2 else environment.mean(axis=-1)
    weight = radiance * latlong_solid_angles(*RASTER)
    return np.einsum("ij,ijc->c", weight, latlong_directions(*RASTER))


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    cosine = a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-12)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(H, W) degrees between unit normals (H, W, 3); 90 where there is none."""
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=-1), -1, 1)))


def _inside(r: Reconstruction) -> np.ndarray:
    return (r.face.mask > 0)[..., None]


_PHOTO_LINES: tuple[Line, ...] = (
    ("Photo", lambda side: encoded(side.result.photo.image), ""),
    ("Re-rendering", lambda side: encoded(side.result.images.render), "colour"),
    ("Error of the re-rendering, times 4", lambda side: error(side.result), ""),
    ("Mesh", lambda side: clay(side.result), ""),
    ("Light: as a map, on a matte and on a mirror ball", lambda side: light(side.result), ""),
)
_MAP_LINES: tuple[Line, ...] = (
    (
        "Diffuse albedo",
        lambda side: encoded(side.result.face.maps.diffuse_albedo * _inside(side.result)),
        "colour",
    ),
    (
        "Specular albedo, 0 to 2",
        lambda side: MAPS["specular_albedo"][1](
            side.result.face.maps.specular_albedo * _inside(side.result)[..., 0]
        ),
        "colour",
    ),
    ("Specular normals", lambda side: normals(side.result.face.normals.specular), "specular"),
    ("Diffuse normals", lambda side: normals(side.result.face.normals.diffuse), "diffuse"),
    ("Diffuse shading", lambda side: encoded(side.result.images.diffuse_shading), "colour"),
)


def _relit_lines() -> Iterator[Line]:
    for name, new in LIGHTS.items():
        yield new.caption.capitalize(), lambda side, name=name: side.relit[name], "colour"


def _pictures(a: Side, b: Side, lines: Any, same: bool) -> str:
    """A row for each line: of `a`, of `b`, and where they can be compared the difference."""
    rows = []
    for caption, picture, compared in lines:
        shown = [(side.name, picture(side)) for side in (a, b)]
        if same and compared:
            shown.append(_difference(a, b, [pixels for _, pixels in shown], compared))
        cells = "".join(
            figure(webp(pixels, _LARGEST), said, f"{caption}, {said}") for said, pixels in shown
        )
        rows.append(f'<h3>{escape(caption)}</h3><div class="grid three">{cells}</div>')
    return "\n".join(rows)


def _difference(a: Side, b: Side, pictures: list[np.ndarray], kind: str) -> tuple[str, np.ndarray]:
    inside = (a.result.face.mask > 0) & (b.result.face.mask > 0)
    if kind == "colour":
        one, other = (picture.astype(np.float32) / 255 for picture in pictures)
        apart = np.abs(one - other)
        inside = inside if apart.ndim == 2 else inside[..., None]
        return f"difference, white is {_MOST:g}", bytes_of(apart / _MOST * inside)
    angles = _angles(*(getattr(side.result.face.normals, kind) for side in (a, b)))
    return f"angle between, white is {_ANGLE:g} degrees", bytes_of(angles / _ANGLE * inside)


def _list(sentences: list[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(sentence)}</li>' for sentence in sentences)}</ul>"


def _warnings(a: Side, b: Side) -> str:
    one, other = a.result.metrics.warnings, b.result.metrics.warnings
    groups = {
        f"Only in {a.name}": [text for text in one if text not in other],
        f"Only in {b.name}": [text for text in other if text not in one],
        "In both": [text for text in one if text in other],
    }
    said = "".join(
        f'<h3>{escape(name)}</h3><ul class="warnings">'
        + "".join(f"<li>{escape(text)}</li>" for text in texts)
        + "</ul>"
        for name, texts in groups.items()
        if texts
    )
    return said or "<p>None in either.</p>"


def _numbers(r: Reconstruction) -> dict[str, str]:
    found = facts(r)
    for stage, points in r.metrics.losses.items():
        if points:
            found[f"Last loss of {stage}"] = f"{points[-1][1]:.4g}"
    return found


def _settings(a: Side, b: Side) -> str:
    one, other = (_flat(as_dict(side.result.settings)) for side in (a, b))
    changed = _changed(one, other)
    if not changed:
        return f"<p>All {len(one)} settings are the same.</p>"
    rows = _table(a, b, *({name: pair[k] for name, pair in changed.items()} for k in (0, 1)))
    return f"{rows}<p>The other {len(one) - len(changed)} are the same.</p>"


def _flat(values: Mapping[str, Any], before: str = "") -> dict[str, str]:
    """Nested settings by their dotted names."""
    found: dict[str, str] = {}
    for name, value in values.items():
        inner = isinstance(value, Mapping)
        found |= _flat(value, f"{before}{name}.") if inner else {before + name: str(value)}
    return found


def _changed(a: Mapping[str, str], b: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """What is not the same, by name; "none" where it is missing."""
    pairs = {name: (a.get(name, "none"), b.get(name, "none")) for name in {**a, **b}}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _table(a: Side, b: Side, one: Mapping[str, str], other: Mapping[str, str]) -> str:
    """Names, and what each side says; what differs is marked and said to."""
    rows = []
    for name in {**one, **other}:
        first, second = one.get(name, "none"), other.get(name, "none")
        differs = first != second
        mark = "<td>differs</td></tr>" if differs else "<td></td></tr>"
        rows.append(
            f'<tr{" class=differs" if differs else ""}><th scope="row">{escape(name)}</th>'
            f"<td>{escape(first)}</td><td>{escape(second)}</td>{mark}"
        )
    names = "".join(f'<th scope="col">{escape(side.name)}</th>' for side in (a, b))
    head = f"<td></td>{names}<td></td>"
    lines = f"<thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody>"
    return f'<div class="scroll" tabindex="0"><table>{lines}</table></div>'
