"""The schedule (paper, Table 1) and every choice the paper leaves open, as typed settings.

Two presets, `paper` and `draft`, are instances of one dataclass. Any field can be overridden by
its dotted name, e.g. `stage2.iterations=500` or `refresh_interval=10`.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, replace
from typing import Any, get_type_hints

from ..conditions import illuminant
from ..errors import SettingsError
from ..face import gain as exposure
from ..scene.brdf import ROUGHNESS


@dataclass(frozen=True)
class Stage:
    """One column of Table 1: iterations, loss weights, learning rates."""

    iterations: int
    image: float = 1.0
    specular_smoothness: float = 0.0
    diffuse_smoothness: float = 0.0
    landmark: float = 0.0
    shape: float = 0.0
    normal: float = 0.0
    axis_rate: float = 0.0
    sharpness_rate: float = 0.0
    amplitude_rate: float = 0.0
    rate: float = 0.05


# fmt: off
#: Table 1 of the paper. A weight that does not apply to a stage is 0.
TABLE_1 = {
    #                        N     image spec  diff  landm shape normal  xi     lambda mu
    "stage1": Stage(         2000, 1.0,  0.0,  0.0,  0.0,  0.0,  0.0,    0.01,  0.05,  0.05),
    "stage2": Stage(         2000, 1.0, 10.0,  1.0,  0.0,  0.0,  0.0,    0.01,  0.05,  0.05),
    "stage3": Stage(          750, 1.0, 10.0,  1.0,  1.0, 50.0,  0.0,    0.005, 0.01,  0.01),
    "stage4": Stage(          500, 1.0, 10.0,  1.0,  1.0, 50.0,  0.1,    0.0,   0.0,   0.0),
    "stage5": Stage(          100, 1.0,  1.0,  0.1,  1.0, 50.0,  0.1,    0.0,   0.0,   0.0),
}
# fmt: on


#: Values of the setting `cast_shadows`.
CAST_SHADOWS = ("auto", "keep")


@dataclass(frozen=True)
class Settings:
    """Everything that decides a reconstruction besides the photo.

    The first five fields are Table 1; the others are readings of what the paper leaves open;
    docs/method.md tells which were measured and how.
    """

    stage1: Stage = TABLE_1["stage1"]
    stage2: Stage = TABLE_1["stage2"]
    stage3: Stage = TABLE_1["stage3"]
    stage4: Stage = TABLE_1["stage4"]
    stage5: Stage = TABLE_1["stage5"]

    #: Side of the square crop, pixels (256 to 2048).
    resolution: int = 512
    #: Kept with the result; nothing is drawn at random so far, so it changes nothing.
    seed: int = 0

    #: Head model that is fitted: makehuman, one that was added, or an .npz file (head/library.py).
    head_model: str = "makehuman"
    #: Colour of the light: white, auto, 2700K, a grey card's pixel X,Y, R,G,B or #rrggbb
    #: (illuminant.py).
    light_color: str = "white"
    #: What fixes the gain between albedo and light: auto (a convention), skin=ALBEDO, X,Y=ALBEDO,
    #: or 500lux (exposure.py).
    exposure: str = "auto"
    #: What to do with skin in the shadow of something else (optimize/cast_shadow.py): auto, fill
    #: its maps in from around; keep, take the photo as it is.
    cast_shadows: str = "auto"

    #: Share of each stage at the full learning rates (in the paper they are constant), below 1, and
    #: share of them that is left at the stage's end, reached on a cosine curve.
    rate_hold: float = 0.5
    rate_floor: float = 0.02
    #: Every element of every gradient is clipped to [-clip, clip] (paper, section 4).
    clip: float = 1.0

    #: Starting sharpness of the 648 lobes; 46: half the peak at the neighbour's axis.
    start_sharpness: float = 46.0
    #: Bounds of the sharpness during the optimisation.
    min_sharpness: float = 4.0
    max_sharpness: float = 600.0
    #: Specular albedo of a clean skin surface, from which every region starts; before the gain of
    #: what is saved (exposure.py).
    nominal_specular: float = 1.0
    #: Cost of gloss that departs from it, |rho_s - nominal| S: under an even light a veil of gloss
    #: can hardly be told from paler albedo. Weak, so that highlights decide where there are any.
    specular_cost: float = 0.2
    #: Upper bound of the specular albedo, far above any skin's: dark skin in a bright exposure has
    #: a high one, since albedo is relative to the best-lit skin.
    max_specular: float = 20.0
    #: Upper bound of the diffuse albedo during a stage, where the best-lit skin has E = 1: no skin
    #: returns more light than falls on it, and that convention of E may be off by so much. What is
    #: saved has another gain (exposure.py).
    max_diffuse: float = 1.6
    #: Error of the shading E that the model is believed to make, where full light is E = 1. The
    #: albedo maps trust a pixel by (E / (E + shading_error))^2: what is seen in the shadows says
    #: little about albedo.
    shading_error: float = 0.2
    #: Factors on Table 1's weights of smoothness (at 512 pixels; in proportion at others) and of
    #: the normal perturbation: how the paper normalises these terms is not given.
    diffuse_smoothness_scale: float = 6.0
    specular_smoothness_scale: float = 2.0
    normal_scale: float = 30.0
    #: Further factor on the smoothness of stage 5, which is to bring back the finest detail.
    detail_smoothness: float = 0.4

    #: Pixels, evenly spread, from which the light's gradient is taken.
    light_points: int = 4000
    #: Cells of the light: rows, columns of the regular grid; split further where the light is
    #: steep, up to `max_cells`, after stage 1.
    cell_rows: int = 18
    cell_columns: int = 36
    max_cells: int = 1000

    #: Inter-reflections that are rendered.
    bounces: int = 3
    #: Iterations between two updates of what is held constant in between: the shading that the
    #: maps see, its linearisation in the normals, the indirect light.
    refresh_interval: int = 50
    #: Share of the light that may come from elsewhere before the highlights that inter-reflection
    #: carries are computed anew.
    gloss_change: float = 0.1
    #: Largest vertex motion (cm) before visibility is traced anew in stage 3.
    retrace_distance: float = 0.05

    #: Preconditioning strength of the shape's gradient (Nicolet et al. 2021).
    shape_lambda: float = 19.0
    #: Factor on the vertices' rate, which then is in cm.
    shape_rate: float = 1.0
    #: Unit of length, cm, in which the shape's L2 distance is measured.
    shape_unit: float = 1.0

    #: Beckmann roughness by region.
    skin_roughness: float = ROUGHNESS["skin"]
    lips_roughness: float = ROUGHNESS["lips"]
    eyes_roughness: float = ROUGHNESS["eyes"]
    eyebrows_roughness: float = ROUGHNESS["eyebrows"]

    def stages(self) -> tuple[Stage, Stage, Stage, Stage, Stage]:
        """The five stages in order."""
        return self.stage1, self.stage2, self.stage3, self.stage4, self.stage5

    def iterations(self, done: int = 0) -> dict[str, int]:
        """Iterations by stage of what is left after the first `done` stages."""
        counts = {name: s.iterations for name, s in zip(TABLE_1, self.stages(), strict=True)}
        return {name: counts[name] for name in list(counts)[done:]}


def _shorter(settings: Settings, factor: float) -> Settings:
    """Stages 1 to 4 with fewer iterations; stage 5 is short already."""

    def less(stage: Stage) -> Stage:
        return replace(stage, iterations=round(stage.iterations * factor))

    return replace(
        settings,
        stage1=less(settings.stage1),
        stage2=less(settings.stage2),
        stage3=less(settings.stage3),
        stage4=less(settings.stage4),
    )


PRESETS = {
    "paper": Settings(),
    "draft": replace(_shorter(Settings(), 0.15), resolution=256, refresh_interval=25),
}


def override(settings: Settings, changes: dict[str, Any]) -> Settings:
    """Copy of `settings` with dotted names replaced; values may be text or of the right type.

    Raises SettingsError that names the field when it is unknown or the value does not fit.
    """
    for name, value in changes.items():
        settings = _set(settings, name.split("."), value, name)
    if not 256 <= settings.resolution <= 2048:
        raise SettingsError(f"resolution={settings.resolution}: choose 256 to 2048 pixels")
    illuminant.parse(settings.light_color)
    exposure.parse(settings.exposure)
    if settings.cast_shadows not in CAST_SHADOWS:
        raise SettingsError(
            f"cast_shadows={settings.cast_shadows!r}: choose {' or '.join(CAST_SHADOWS)}"
        )
    for name, least in (("light_points", 1), ("refresh_interval", 1), ("bounces", 0)):
        if getattr(settings, name) < least:
            raise SettingsError(f"{name}={getattr(settings, name)}: must be {least} or more")
    if not 0 <= settings.rate_hold < 1:
        raise SettingsError(f"rate_hold={settings.rate_hold}: must be at least 0 and below 1")
    for name, stage in zip(TABLE_1, settings.stages(), strict=True):
        if stage.iterations < 0:
            raise SettingsError(f"{name}.iterations={stage.iterations}: must be 0 or more")
    return settings


def _set(target: Any, path: list[str], value: Any, full: str) -> Any:
    kinds = get_type_hints(type(target))
    if path[0] not in kinds:
        known = ", ".join(sorted(kinds))
        raise SettingsError(f"{full}: no such setting; known here: {known}")
    kind = kinds[path[0]]
    if dataclasses.is_dataclass(kind):
        if len(path) == 1 and not isinstance(value, dict):
            raise SettingsError(f"{full}: name one of its fields, e.g. {full}.iterations")
        inner = getattr(target, path[0])
        for key, part in value.items() if len(path) == 1 else [(".".join(path[1:]), value)]:
            inner = _set(inner, key.split("."), part, f"{path[0]}.{key}")
        return replace(target, **{path[0]: inner})
    if len(path) > 1:
        raise SettingsError(f"{full}: {path[0]} has no fields")
    try:
        if kind in (int, float) and not math.isfinite(float(value)):
            raise ValueError
        if kind is int and float(value) != int(float(value)):
            raise ValueError
        return replace(
            target, **{path[0]: kind(float(value)) if kind in (int, float) else kind(value)}
        )
    except (TypeError, ValueError, OverflowError):
        raise SettingsError(f"{full}={value!r}: expected {kind.__name__}") from None


def as_dict(settings: Settings) -> dict[str, Any]:
    """Nested plain values, for the log and the saved reconstruction."""
    return dataclasses.asdict(settings)
