"""Every choice that decides a reconstruction besides the photo, as typed settings with ranges.

The presets are instances of one dataclass: `paper` is Table 1 as printed; `standard`, the default,
minimises nearly the same loss by other steps in far fewer iterations; `draft` is the same, coarser.
Any field can be overridden by its dotted name, e.g. `stage2.iterations=500`.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, cast, get_type_hints

from msgspec import Meta, ValidationError

from ..errors import SettingsError
from .conditions import AUTO, CastShadow, KnownExposure, LightColorEstimate, LightColorRequest
from .detail import FineDetail
from .fit import LandmarkFit, OutlineFit, ShadingFit
from .ranges import Count, Positive, Share, Weight, converted, expected, is_table
from .regions import RoughnessByRegion, SpecularByRegion
from .sun import SunSearch, SunShadow
from .table1 import TABLE_1, Stage
from .tint import TintSearch

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Group = TypeVar("Group", bound="DataclassInstance")
Sharpness = Annotated[float, Meta(ge=1e-3, le=1e5)]

#: Kept as the text that the user wrote.
_REQUESTS = (LightColorRequest, KnownExposure)


@dataclass(frozen=True)
class Settings:
    """Everything that decides a reconstruction besides the photo.

    The first five fields are Table 1; the others are readings of what the paper leaves open;
    docs/lab/method-notes.md tells which were measured. `override` holds every value to its range;
    the constructor and `dataclasses.replace` only see that bounds are in order.

    >>> unlit.PRESETS["draft"].resolution
    256
    """

    stage1: Stage = TABLE_1["stage1"]
    stage2: Stage = TABLE_1["stage2"]
    stage3: Stage = TABLE_1["stage3"]
    stage4: Stage = TABLE_1["stage4"]
    stage5: Stage = TABLE_1["stage5"]

    #: Side of the square crop, pixels.
    resolution: Annotated[int, Meta(ge=256, le=2048)] = 512

    #: Head model that is fitted: makehuman, one that was added, or an .npz file.
    head_model: str = "makehuman"
    landmark_fit: LandmarkFit = field(default_factory=LandmarkFit)
    outline_fit: OutlineFit = field(default_factory=OutlineFit)
    shading_fit: ShadingFit = field(default_factory=ShadingFit)

    #: Colour of the light: white, auto, 2700K, a grey card's pixel X,Y, R,G,B or #rrggbb.
    light_color: LightColorRequest = field(default_factory=partial(LightColorRequest, "white"))
    light_color_estimate: LightColorEstimate = field(default_factory=LightColorEstimate)
    #: What fixes the gain between albedo and light: auto (a convention), skin=ALBEDO, X,Y=ALBEDO,
    #: or 500lux (face/gain.py).
    exposure: KnownExposure = field(default_factory=partial(KnownExposure, AUTO))
    sun: SunSearch = field(default_factory=SunSearch)
    sun_shadow: SunShadow = field(default_factory=SunShadow)
    tint: TintSearch = field(default_factory=TintSearch)
    detail: FineDetail = field(default_factory=FineDetail)
    cast_shadow: CastShadow = field(default_factory=CastShadow)
    #: Of the short stage 1 that an estimate of the light's colour and cast shadows are seen in.
    first_stage_iterations: Count = 100

    #: How the albedo maps and the normals follow the loss: adam, as in the paper, or primal-dual
    #: (optimize/primal_dual.py). Light, mesh and stage 1 follow it by Adam.
    solver: Literal["adam", "primal-dual"] = "adam"
    #: A stage ends before its last iteration when its loss has changed by less than this share over
    #: REPORT iterations (optimize/stage_run.py); 0: never.
    tolerance: Annotated[float, Meta(ge=0, lt=1)] = 0.0
    #: Share of each stage's iterations at the full learning rates of Adam; in the paper they are
    #: constant.
    rate_hold: Annotated[float, Meta(ge=0, lt=1)] = 0.5
    #: Share of the rates that is left at the last iteration, reached on a cosine curve.
    rate_floor: Share = 0.02
    #: Every element of every gradient of Adam's is clipped to [-clip, clip] (paper, section 4).
    clip: Positive = 1.0

    #: Starting sharpness of the 648 lobes; 46: half the peak at the neighbour's axis.
    start_sharpness: Sharpness = 46.0
    #: Bounds of the sharpness during the optimisation.
    min_sharpness: Sharpness = 4.0
    max_sharpness: Sharpness = 600.0
    #: Specular albedo of a clean skin surface, from which every region starts; before the gain of
    #: what is saved (face/gain.py).
    nominal_specular: Positive = 1.0
    #: Cost of gloss that departs from it, |rho_s - nominal| S: under an even light a veil of gloss
    #: can hardly be told from paler albedo. Weak, so that highlights decide where there are any.
    specular_cost: Weight = 0.2
    #: Upper bound of the specular albedo, far above any skin's: dark skin in a bright exposure has
    #: a high one, since albedo is relative to the best-lit skin.
    max_specular: Positive = 20.0
    #: Most of the weakest channel, in the median of the pixels, that gloss may take: so that a warm
    #: light, or a dim photo, does not leave an albedo without blue.
    gloss_share: Annotated[float, Meta(gt=0, le=1)] = 0.6
    #: Upper bound of the diffuse albedo during a stage, where the best-lit skin has E = 1: no skin
    #: returns more light than falls on it, and that convention of E may be off by so much. What is
    #: saved has another gain (face/gain.py).
    max_diffuse: Positive = 1.6
    #: Error of the shading E that the model is believed to make, where full light is E = 1. The
    #: albedo maps trust a pixel by (E / (E + shading_error))^2: what is seen in the shadows says
    #: little about albedo.
    shading_error: Weight = 0.2
    #: The same for stage 5, which is to bring back the finest detail in the shadows, too.
    detail_shading_error: Weight = 0.2
    #: Cost, with the primal-dual solver, of leaving what a stage began with, |rho_d - begin|
    #: (encoded), where the photo says little: times 1 - (E / (E + shading_error))^2.
    unseen_cost: Weight = 0.0
    #: Factors on Table 1's weights of smoothness (at 512 pixels; in proportion at others) and of
    #: the normal perturbation: how the paper normalises these terms is not given.
    diffuse_smoothness_scale: Weight = 6.0
    specular_smoothness_scale: Weight = 2.0
    normal_scale: Weight = 30.0
    #: Further factor on the smoothness of stage 5, which is to bring back the finest detail.
    detail_smoothness: Weight = 0.4

    #: Pixels, evenly spread, from which the light's gradient is taken.
    light_points: Annotated[int, Meta(ge=1, le=2048 * 2048)] = 4000
    #: Steps of the light for each step of the maps in stage 2.
    light_steps: Count = 1
    #: Cells of the light: rows and columns of the regular grid, and how many it is split into at
    #: most, where the light is steep, after stage 1.
    cell_rows: Annotated[int, Meta(ge=2, le=500)] = 18
    cell_columns: Annotated[int, Meta(ge=2, le=1000)] = 36
    max_cells: Annotated[int, Meta(ge=4, le=100_000)] = 1000

    #: Inter-reflections that are rendered.
    bounces: Annotated[int, Meta(ge=0, le=100)] = 3
    #: Iterations between two updates of what is held constant in between: the shading that the
    #: maps see, its linearisation in the normals, the indirect light.
    refresh_interval: Count = 50
    #: Share of the light that may come from elsewhere before the highlights that inter-reflection
    #: carries are computed anew.
    gloss_change: Share = 0.1
    #: Largest vertex motion (cm) before visibility is traced anew in stage 3.
    retrace_distance: Weight = 0.05

    #: Preconditioning strength of the shape's gradient (Nicolet et al. 2021).
    shape_lambda: Weight = 19.0
    #: Factor on the vertices' rate, which then is in cm.
    shape_rate: Weight = 1.0
    #: Unit of length, cm, in which the shape's L2 distance is measured.
    shape_unit: Positive = 1.0

    roughness: RoughnessByRegion = field(default_factory=RoughnessByRegion)
    specular_level: SpecularByRegion = field(default_factory=SpecularByRegion)

    def __post_init__(self) -> None:
        if self.min_sharpness > self.max_sharpness:
            raise SettingsError(
                f"min_sharpness={self.min_sharpness:g}: max_sharpness is less, "
                f"{self.max_sharpness:g}",
                "min_sharpness",
            )

    def stages(self) -> tuple[Stage, Stage, Stage, Stage, Stage]:
        """The five stages in order."""
        return self.stage1, self.stage2, self.stage3, self.stage4, self.stage5

    def iterations(self, done: int = 0) -> dict[str, int]:
        """Iterations by stage of what is left after the first `done` stages."""
        counts = {name: s.iterations for name, s in zip(TABLE_1, self.stages(), strict=True)}
        return {name: counts[name] for name in list(counts)[done:]}


#: The weights of Table 1, but the shape is held a quarter as hard (`shape_unit`) and albedo that is
#: not seen is held, too (`unseen_cost`); other steps, a twelfth of the iterations. Stage 1 has few
#: unknowns and takes larger steps. Stages 2 to 4 end before they have converged: longer ones gain
#: on some inputs and lose on others.
STANDARD = replace(
    Settings(),
    stage1=replace(
        TABLE_1["stage1"],
        iterations=200,
        rate=0.1,
        axis_rate=0.04,
        sharpness_rate=0.2,
        amplitude_rate=0.2,
    ),
    stage2=replace(TABLE_1["stage2"], iterations=80),
    stage3=replace(TABLE_1["stage3"], iterations=60),
    stage4=replace(TABLE_1["stage4"], iterations=40),
    stage5=replace(TABLE_1["stage5"], iterations=50),
    solver="primal-dual",
    light_steps=4,
    tolerance=0.005,
    rate_hold=0.3,
    refresh_interval=25,
    gloss_change=0.3,
    retrace_distance=0.4,
    shape_unit=2.0,
    detail_shading_error=0.05,
    unseen_cost=0.03,
)

PRESETS = {
    "paper": Settings(),
    "standard": STANDARD,
    "draft": replace(STANDARD, resolution=256),
}


def override(settings: Settings, changes: dict[str, Any]) -> Settings:
    """Copy of `settings` with some values replaced, by their dotted names or in nested tables.

    Values may be text or of the right type. Raises SettingsError that names the field when it is
    unknown or the value does not fit.

    >>> changed = unlit.override(unlit.PRESETS["draft"], {"stage2.iterations": "20"})
    >>> changed.stage2.iterations
    20
    """
    return _changed(settings, changes, "")


def _changed(group: Group, changes: dict[str, Any], prefix: str) -> Group:
    kinds = get_type_hints(type(group), include_extras=True)
    new: dict[str, Any] = {}
    for name, value in changes.items():
        first, dot, rest = name.partition(".")
        kind, full = kinds.get(first), prefix + name
        if kind is None:
            near = difflib.get_close_matches(first, kinds, 1)
            hint = f"did you mean {prefix}{near[0]}? " if near else ""
            known = ", ".join(kinds)
            raise SettingsError(f"{full}: no such setting; {hint}known here: {known}", full)
        if is_dataclass(kind) and kind not in _REQUESTS:
            inner = {rest: value} if dot else value
            if not is_table(inner):
                example = fields(kind)[0].name
                raise SettingsError(f"{full}: name one of its fields, e.g. {full}.{example}", full)
            new[first] = _changed(new.get(first, getattr(group, first)), inner, f"{prefix}{first}.")
        elif dot:
            raise SettingsError(f"{full}: {first} has no fields", full)
        else:
            new[first] = _value(full, value, kind)
    return replace(group, **new)


def _value(name: str, value: Any, kind: Any) -> Any:
    request = kind in _REQUESTS
    if request and isinstance(value, str | kind):
        return kind(value) if isinstance(value, str) else value
    try:
        if not request:
            return converted(value, kind)
    except ValidationError:
        pass
    said = "text" if request else expected(kind)
    raise SettingsError(f"{name}={_shown(value)}: expected {said}", name)


def _shown(value: Any) -> str:
    try:
        return repr(value)
    except ValueError:  # Python writes no numbers of thousands of digits
        return "a long number"


def as_dict(settings: Any) -> dict[str, Any]:
    """Nested plain values, for the log and the saved reconstruction; `override` reads them."""
    return {f.name: _plain(getattr(settings, f.name)) for f in fields(settings)}


def _plain(value: Any) -> Any:
    if isinstance(value, _REQUESTS):
        return value.text
    if is_dataclass(value):
        return as_dict(value)
    return list(cast("tuple[Any, ...]", value)) if isinstance(value, tuple) else value


def flat(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested plain settings by their dotted names."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        table = is_table(value)
        found |= flat(value, f"{prefix}{name}.") if table else {f"{prefix}{name}": value}
    return found
