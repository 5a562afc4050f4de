"""The schedule of the five stages: the paper's Table 1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from .ranges import Weight

Rate = Annotated[float, Meta(ge=0, le=10)]


@dataclass(frozen=True)
class Stage:
    """One column of Table 1: iterations, loss weights, learning rates.

    iterations: of the optimiser, at most.
    image: weight of the image loss. specular_smoothness, diffuse_smoothness: of the total variation
        of the albedo maps, before `specular_smoothness_scale` and `diffuse_smoothness_scale`.
    landmark: of the landmarks' distance, without effect where the mesh stands still (stages 4, 5).
    shape: of the distance from the fitted mesh, likewise.
    normal: of the normal perturbation, before `normal_scale`.
    axis_rate, sharpness_rate, amplitude_rate: learning rates of the light's lobes; 0 holds them.
    rate: learning rate of all else that follows by Adam.
    """

    iterations: Annotated[int, Meta(ge=0, le=1_000_000)]
    image: Weight = 1.0
    specular_smoothness: Weight = 0.0
    diffuse_smoothness: Weight = 0.0
    landmark: Weight = 0.0
    shape: Weight = 0.0
    normal: Weight = 0.0
    axis_rate: Rate = 0.0
    sharpness_rate: Rate = 0.0
    amplitude_rate: Rate = 0.0
    rate: Rate = 0.05


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
LAST_STAGE = list(TABLE_1)[-1]
