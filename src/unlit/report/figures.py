"""The page's pieces that hold pictures and curves, as HTML."""

from __future__ import annotations

import base64
import math
from html import escape

import numpy as np

from ..face.reconstruction import Reconstruction
from ..output.atlas import BLENDED, DIFFUSED, MIRRORED, PLAIN, SEEN, Atlas
from ..output.images import MAPS, bytes_of, encoded, webp, webp_exact
from ..output.montage import clay, error, light
from ..output.relit import LIGHTS, Relit
from ..output.textures import normal_bytes
from .scene import material
from .stages import Stages

_LARGEST = 1024  # pixels a side of what is only looked at

_MAPS = {
    "diffuse_albedo": "Diffuse albedo: the face with the light taken off",
    "specular_albedo": "Specular albedo, 0 to 2: how strong the gloss is",
    "roughness": "Roughness, Beckmann alpha, 0 to 1",
    "specular_normal": "Specular normals, world frame",
    "diffuse_normal": "Diffuse normals, world frame",
    "shading": "Diffuse shading: what the diffuse albedo is multiplied with",
    "specular_shading": "Specular shading: what the specular albedo is multiplied with",
    "render": "Re-rendering: the sum of both products",
    "mask": "Mask: where the maps are measured",
    "environment": "Light, latitude and longitude; its middle is light from the camera, its left "
    "half light from the picture's right",
}
_HIGHEST = 0.3  # mm
_DISPLACEMENT = f"Displacement: dark to bright is -{_HIGHEST} to {_HIGHEST} mm over the mesh"
#: Black outside the mask, where they only repeat their nearest measured value.
_FILLED = {"diffuse_albedo", "specular_albedo", "roughness"}

_LEVELS = {
    SEEN: ((253, 231, 37), "measured"),
    BLENDED: ((94, 201, 98), "measured in part: seen from the side, or beside hair or a shadow"),
    MIRRORED: ((33, 145, 140), "detail of the other half of the face, or the other eye"),
    DIFFUSED: ((59, 82, 139), "the person's skin, continued with texture of its own"),
    PLAIN: ((68, 1, 84), "a constant"),
}

_STAGES = {
    "fit": "Fit",
    "stage1": "1. Base colour and light",
    "stage2": "2. Smooth albedo",
    "stage3": "3. Shape",
    "stage4": "4. Normals",
    "stage5": "5. Fine albedo",
}
_KINDS = {"render": "re-rendering", "albedo": "diffuse albedo", "normals": "specular normals"}

#: A chart, and the room at its sides.
_WIDTH, _HEIGHT = 320, 150
_LEFT, _RIGHT, _TOP, _BOTTOM = 44, 8, 10, 24


def photo(r: Reconstruction) -> str:
    """The slider between the photo's crop and the re-rendering."""
    both = {"photo": r.photo.image, "render": r.images.render}
    before, after = (
        image(webp(encoded(pixels), _LARGEST), f"The {name}", f'id="{name}"')
        for name, pixels in both.items()
    )
    return _compare(_pair(before, after), "photo", "re-rendering", "Photo and re-rendering")


def relit(pictures: Relit) -> str:
    """The face under each of the new lights."""
    return "\n".join(
        figure(
            webp(picture, _LARGEST),
            LIGHTS[name].caption.capitalize(),
            attributes=f'id="relit-{name}"',
        )
        for name, picture in pictures.items()
    )


def overview(r: Reconstruction) -> str:
    """Error, mesh and light."""
    pictures = {
        "Error of the re-rendering, times 4": error(r),
        "Mesh": clay(r),
        "Light, seen from the camera: as a map, on a matte and on a mirror ball": light(r),
    }
    return "\n".join(figure(webp(p, _LARGEST), caption) for caption, p in pictures.items())


def maps(r: Reconstruction, atlas: Atlas) -> str:
    """All image-space maps; atlas: of `r`."""
    found = []
    for name, (array, look) in MAPS.items():
        picture = look(array(r))
        if name in _FILLED:
            inside = r.face.mask > 0
            picture = picture * (inside if picture.ndim == 2 else inside[..., None])
        found.append(figure(webp(picture, _LARGEST), _MAPS[name]))
    raised = bytes_of(0.5 + atlas.crop_displacement / (2 * _HIGHEST))
    found.append(figure(webp(raised, _LARGEST), _DISPLACEMENT))
    return "\n".join(found)


def atlas_maps(atlas: Atlas) -> str:
    """The atlas; the viewer takes its textures from these pictures, so they are exact."""
    pictures = {
        "diffuse-albedo": ("Diffuse albedo", encoded(atlas.diffuse_albedo)),
        "specular-normal": ("Specular normals, tangent space", normal_bytes(atlas.specular_normal)),
        "diffuse-normal": ("Diffuse normals, tangent space", normal_bytes(atlas.diffuse_normal)),
        "material": (
            "Red: specular albedo, 0 to 2; green: square root of alpha; blue: confidence",
            material(atlas),
        ),
    }
    return "\n".join(
        figure(webp_exact(pixels), caption, attributes=f'id="atlas-{name}"')
        for name, (caption, pixels) in pictures.items()
    )


def confidence(atlas: Atlas) -> str:
    """The confidence map in colours, and what they mean."""
    picture = np.zeros((*atlas.confidence.shape, 3), dtype=np.uint8)
    legend = []
    for level, (colour, meaning) in _LEVELS.items():
        picture[atlas.confidence == level] = colour
        code = "#{:02x}{:02x}{:02x}".format(*colour)
        square = f'<svg viewBox="0 0 1 1" aria-hidden="true"><path fill="{code}" d="M0 0h1v1H0z"/>'
        legend.append(f"<li>{square}</svg>{escape(meaning)}</li>")
    shown = image(webp_exact(picture), "Confidence of each texel of the atlas, in colours")
    return f'<div class="one">{shown}</div><ul class="legend">{"".join(legend)}</ul>'


def stages(taken: Stages) -> str:
    """A slider for each stage between the state before it and after it."""
    if not taken:
        return (
            "<p>No pictures of the stages were kept with this result. "
            "<code>unlit reconstruct</code> keeps them.</p>"
        )
    last: dict[str, str] = {"render": "photo"}  # the element that shows the state before
    store, figures = [], []
    for stage, pictures in taken:
        pairs = []
        for kind in (kind for kind in _KINDS if kind in pictures):
            name = f"{stage}-{kind}"
            shown = image(pictures[kind], "", f'id="{name}"')
            caption = f"{_STAGES[stage]}: {_KINDS[kind]}"
            store.append(f"<figure>{shown}<figcaption>{caption}</figcaption></figure>")
            if kind in last and stage != "fit":
                before, after = (_again(last[kind], "before"), _again(name, "after"))
                hidden = "" if kind == "render" else " hidden"
                said = _pair(before, after)
                pairs.append(f'<div data-kind="{kind}"{hidden}>{said}</div>')
            last[kind] = name
        if pairs:
            title = _STAGES[stage]
            figures.append(_compare("".join(pairs), "before", "after", title, f"<h3>{title}</h3>"))
    choices = "".join(
        f'<label><input type="radio" name="kind" value="{kind}"'
        f"{' checked' if kind == 'render' else ''}> {name}</label>"
        for kind, name in _KINDS.items()
    )
    return (
        '<p class="scripted">Each picture shows the state before the stage and after it; before '
        "the first there is no re-rendering, so the photo stands in for it.</p>"
        f'<fieldset class="kinds scripted"><legend>Show</legend>{choices}</fieldset>'
        f'<div class="grid stages scripted">{"".join(figures)}</div>'
        f'<div class="grid plain">{"".join(store)}</div>'
    )


def losses(curves: dict[str, list[tuple[int, float]]]) -> str:
    """A chart for each stage: (iteration, loss)."""
    charts = [
        f"<figure>{loss_chart(name, points)}<figcaption>{escape(name)}</figcaption></figure>"
        for name, points in curves.items()
        if points
    ]
    if not charts:
        return "<p>No losses were kept.</p>"
    return (
        "<p>Logarithmic, against iterations. Stages minimise different sums, so heights compare "
        f'only inside a stage.</p><div class="grid stages">{"".join(charts)}</div>'
    )


def loss_chart(title: str, points: list[tuple[int, float]]) -> str:
    """An <svg> of `points` (iteration, loss), at least one: a curve in the page's own colours."""
    xs, ys = [x for x, _ in points], [math.log10(max(y, 1e-9)) for _, y in points]
    low, high = min(ys), max(ys)
    if high - low < 0.02:  # hardly any change: leave it flat instead of blowing up noise
        low, high = low - 0.01, high + 0.01
    last = max(max(xs), 1.0)

    def at(x: float, y: float) -> str:
        across = _LEFT + (_WIDTH - _LEFT - _RIGHT) * x / last
        down = _TOP + (_HEIGHT - _TOP - _BOTTOM) * (high - y) / (high - low)
        return f"{across:.1f},{down:.1f}"

    line = " ".join(at(x, y) for x, y in zip(xs, ys, strict=True))
    floor, name = _HEIGHT - _BOTTOM, escape(title)
    said = f"{name}: loss from {points[0][1]:.3g} to {points[-1][1]:.3g} in {last:.0f} iterations"
    return (
        f'<svg class="chart" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{said}">'
        f'<path class="axis" d="M{_LEFT} {_TOP}V{floor}H{_WIDTH - _RIGHT}"/>'
        f'<polyline class="curve" points="{line}"/>'
        f'<text x="{_LEFT - 5}" y="{_TOP + 8}" class="end">{10**high:.3g}</text>'
        f'<text x="{_LEFT - 5}" y="{floor}" class="end">{10**low:.3g}</text>'
        f'<text x="{_LEFT}" y="{_HEIGHT - 8}">0</text>'
        f'<text x="{_WIDTH - _RIGHT}" y="{_HEIGHT - 8}" class="end">{last:.0f}</text></svg>'
    )


def image(content: bytes, alt: str, attributes: str = "") -> str:
    """An <img> of a WebP file."""
    address = f"data:image/webp;base64,{base64.b64encode(content).decode()}"
    return f'<img {attributes} alt="{escape(alt)}" src="{address}">'


def _again(identity: str, alt: str) -> str:
    """The picture of the element `identity` once more; the page's script fills it in."""
    return f'<img data-from="{identity}" alt="{alt}">'


def figure(content: bytes, caption: str, name: str = "", attributes: str = "") -> str:
    """A <figure> of a WebP file that a click enlarges. name: for who hears it, if not `caption`."""
    shown = image(content, "", attributes)
    return (
        f'<figure><button class="picture" type="button" aria-pressed="false" '
        f'aria-label="Enlarge: {escape(name or caption)}">{shown}</button>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _pair(before: str, after: str) -> str:
    return f'<div class="pair">{before}{after}</div>'


def _compare(pairs: str, left: str, right: str, what: str, title: str = "") -> str:
    """Pictures on top of each other with a slider that moves the cut between them."""
    label = f"{what}: where the cut lies, from all {right} to all {left}"
    return (
        f'<figure class="compare">{title}{pairs}'
        f'<input type="range" min="0" max="100" value="50" aria-label="{escape(label)}">'
        f'<figcaption class="ends"><span>{left}</span><span>{right}</span></figcaption></figure>'
    )
