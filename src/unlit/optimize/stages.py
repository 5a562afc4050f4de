"""The five stages of the guided optimisation (paper, section 3), one function each.

Every stage takes and returns an `Estimate`. What a stage minimises is written out in its body in
the order of the paper's equations; the weights and rates are the columns of Table 1
(schedule.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from ..render.transport import linearize
from ..scene.arrays import device
from ..scene.cells import Cells, grid_cells, refine
from ..scene.gather import Corners
from ..scene.light import grid_lobes
from ..scene.lobes import CellRadiance
from ..scene.maps import DIFFUSE_BLUR
from ..scene.mesh import surface, vertex_normals
from ..settings.settings import Settings
from ..settings.table1 import Stage
from .blend import Blend
from .blur import Blur
from .losses import encode, gloss_l1, image_l1, landmark_l2, normal_l2, shape_l2, total_variation
from .optimizer import Adam
from .problem import Estimate, LightSample, Problem, Shading

mi = mitsuba()

#: Iterations between two reports of the loss; reading it more often would stall the device.
REPORT = 25


def start(problem: Problem) -> Estimate:
    """The estimate before stage 1: a near-uniform light and white maps that stage 1 will set."""
    settings = problem.settings
    lobes = grid_lobes(settings.start_sharpness, 1.0)
    count = len(problem)
    return Estimate(
        device(mi.Point3f, problem.evidence.vertices),
        dr.zeros(mi.Color3f, count),
        dr.zeros(mi.Float, count),
        dr.zeros(mi.Vector3f, count),
        device(mi.Vector3f, lobes.axis),
        device(mi.Float, np.log(lobes.sharpness)),
        device(mi.Float, np.log(lobes.amplitude)),
    )


def _light_parameters(estimate: Estimate) -> dict[str, Any]:
    return {
        "axis": estimate.axis,
        "log_sharpness": estimate.log_sharpness,
        "log_amplitude": estimate.log_amplitude,
    }


def _light_rates(stage: Stage) -> dict[str, float]:
    return {
        "axis": stage.axis_rate,
        "log_sharpness": stage.sharpness_rate,
        "log_amplitude": stage.amplitude_rate,
    }


def _radiance(cells: CellRadiance, adam: Adam) -> Any:
    return cells(
        dr.normalize(adam["axis"]), dr.exp(adam["log_sharpness"]), dr.exp(adam["log_amplitude"])
    )


def _render(log_diffuse: Any, log_specular: Any, e: Any, s: Any) -> Any:
    """I = rho_d E + rho_s S, mi.Color3f."""
    return dr.exp(log_diffuse) * e + dr.exp(log_specular) * s


class _Run:
    """The bookkeeping of one stage: its optimiser, progress, and the history of its loss."""

    def __init__(
        self,
        problem: Problem,
        name: str,
        parameters: dict[str, Any],
        rates: dict[str, float],
        uniform: frozenset[str] = frozenset(),
    ) -> None:
        self.problem, self.name = problem, name
        self.settings: Settings = problem.settings
        self.stage: Stage = getattr(problem.settings, name)
        self.adam = Adam(
            parameters,
            rates,
            self.stage.iterations,
            self.settings.rate_hold,
            self.settings.rate_floor,
            self.settings.clip,
            uniform,
        )

    def step(self, iteration: int, loss: Any, light_loss: Any = None) -> None:
        """Back-propagate, take one step, keep the parameters in range, report `loss`.

        light_loss: a further loss, of parameters that `loss` does not depend on.
        """
        adam, settings = self.adam, self.settings
        dr.backward(loss if light_loss is None else loss + light_loss)
        adam.step()
        if "axis" in adam.rates:
            adam["axis"] = dr.normalize(adam["axis"])
        if "log_sharpness" in adam.rates:
            low, high = np.log(settings.min_sharpness), np.log(settings.max_sharpness)
            adam["log_sharpness"] = dr.clip(adam["log_sharpness"], low, high)
        adam["log_specular"] = dr.fmin(adam["log_specular"], np.log(settings.max_specular))
        adam["log_diffuse"] = dr.fmin(adam["log_diffuse"], np.log(settings.max_diffuse))
        iterations = self.stage.iterations
        if iteration % REPORT == 0 or iteration == iterations - 1:
            value = float(loss.numpy().item())
            self.problem.history.setdefault(self.name, []).append((iteration, value))
            self.problem.progress(self.name, iteration + 1, iterations, value)

    def expose(self, e: Any) -> None:
        """Fix the gain between light and albedo, given the diffuse shading E (see `exposed`)."""
        shift = float(np.log(_exposure(e)))
        for name, sign in (("log_diffuse", 1), ("log_specular", 1), ("log_amplitude", -1)):
            self.adam[name] = dr.detach(self.adam[name]) + dr.opaque(mi.Float, sign * shift)

    def result(self, estimate: Estimate, *names: str) -> Estimate:
        """`estimate` with the named parameters as they are now."""
        return replace(estimate, **{name: dr.detach(self.adam[name]) for name in names})


def _smoothness(
    stage: Stage, problem: Problem, log_diffuse: Any, log_specular: Any, scale: float
) -> Any:
    """Smoothness of both albedo maps per texel (section 3.2), the same at every resolution."""
    settings = problem.settings
    # The difference of neighbours falls as 1 / resolution.
    unit = dr.opaque(mi.Float, scale * problem.camera.width / 512)
    seen = encode(dr.exp(log_diffuse))
    diffuse = stage.diffuse_smoothness * total_variation(seen, problem.neighbours)
    specular = stage.specular_smoothness * total_variation(log_specular, problem.neighbours)
    diffuse *= settings.diffuse_smoothness_scale
    specular *= settings.specular_smoothness_scale
    return unit * (diffuse + specular)


def stage1(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """Base colour and light: one diffuse and one specular albedo per region (section 3.1).

    With an albedo that cannot vary inside a region, shading has to be explained by the light. A
    sample of the pixels is enough for so few unknowns.
    """
    settings, stage = problem.settings, problem.settings.stage1
    sample = LightSample(problem, shading)
    cells = CellRadiance(shading.cells)
    everywhere, sampled = Blend(problem.regions), Blend(problem.regions[sample.rows])

    diffuse, specular = _base_start(problem, sample, cells, estimate)
    run = _Run(
        problem,
        "stage1",
        {**_light_parameters(estimate), "log_diffuse": diffuse, "log_specular": specular},
        {**_light_rates(stage), "log_diffuse": stage.rate, "log_specular": stage.rate},
    )
    adam = run.adam

    def blended(blend: Blend) -> tuple[Any, Any]:
        base = blend(dr.exp(adam["log_diffuse"]), dr.exp(adam["log_specular"]))
        return dr.log(base[0]), dr.log(base[1])

    def spread() -> Estimate:
        diffuse, specular = dr.detach(blended(everywhere))
        light = run.result(estimate, *_light_parameters(estimate))
        return replace(light, log_diffuse=diffuse, log_specular=specular)

    for iteration in range(stage.iterations):
        if iteration % settings.refresh_interval == 0:
            e, _ = sample.transport.shade(dr.detach(_radiance(cells, adam)))
            run.expose(e + sample.of(shading.indirect[0]))
            shading.update(dr.detach(_radiance(cells, adam)).numpy(), problem.maps(spread()))
        radiance = _radiance(cells, adam)
        e, s = sample.transport.shade(radiance)
        e, s = e + sample.of(shading.indirect[0]), s + sample.of(shading.indirect[1])
        log_diffuse, log_specular = blended(sampled)
        image = _render(log_diffuse, log_specular, e, s)
        loss = stage.image * image_l1(image, sample.target, sample.weight)
        loss += _gloss(settings, log_specular, s, sample.weight)
        run.step(iteration, loss)
    return spread()


def _base_start(
    problem: Problem, sample: LightSample, cells: CellRadiance, estimate: Estimate
) -> tuple[Any, Any]:
    """Log base colours that give each region its median colour under the starting light."""
    e, _ = sample.transport.shade(device(mi.Float, cells.of(estimate.light())))
    image = problem.evidence.image.reshape(-1, 3)[problem.pixel[sample.rows]]
    level = float(np.median(e.numpy()))
    colours = []
    evident = sample.weight.numpy() > 0
    for share in problem.regions[sample.rows].T:
        inside = evident & (share > 0.5)
        colours.append(np.median(image[inside if inside.any() else evident], axis=0) / level)
    log_colours = np.log(np.maximum(np.array(colours), 1e-3)).astype(np.float32)
    specular = np.full(len(colours), np.log(problem.settings.nominal_specular), dtype=np.float32)
    return device(mi.Color3f, log_colours), device(mi.Float, specular)


def _gloss(settings: Settings, log_specular: Any, s: Any, weight: Any) -> Any:
    """Of two explanations that fit alike, the one with the gloss of plain skin."""
    return settings.specular_cost * gloss_l1(log_specular, settings.nominal_specular, s, weight)


def _map_loss(
    problem: Problem,
    stage: Stage,
    adam: Adam,
    e: Any,
    s: Any,
    weight: Any,
    smoothness: float = 1.0,
) -> Any:
    """What stages 2 to 5 ask of the albedo maps: the image, smoothness, plain gloss."""
    image = _render(adam["log_diffuse"], adam["log_specular"], e, s)
    loss = stage.image * image_l1(image, problem.target, weight)
    loss += _smoothness(stage, problem, adam["log_diffuse"], adam["log_specular"], smoothness)
    return loss + _gloss(problem.settings, adam["log_specular"], s, weight)


def _trusted(problem: Problem, e: Any) -> Any:
    """Weight of each pixel's evidence on the maps, sum 1: its own times (E / (E + error))^2."""
    level = dr.mean(dr.detach(e))
    weight = problem.weight * dr.square(
        level / dr.fmax(level + problem.settings.shading_error, 1e-6)
    )
    weight /= dr.sum(weight)
    dr.eval(weight)
    return weight


def _light_loss(sample: LightSample, shading: Shading, adam: Adam, e: Any, s: Any) -> Any:
    """Image loss of the sampled pixels as a function of the light alone, the maps as they are."""
    image = _render(
        sample.of(dr.detach(adam["log_diffuse"])),
        sample.of(dr.detach(adam["log_specular"])),
        e + sample.of(shading.indirect[0]),
        s + sample.of(shading.indirect[1]),
    )
    return image_l1(image, sample.target, sample.weight)


def stage2(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """Low-frequency albedo: maps under strong smoothness, jointly with the light (section 3.2).

    The light follows the image loss of a sample of the pixels at every iteration; the maps see
    its shading on all pixels, brought up to date every `refresh_interval` iterations.
    """
    settings, stage = problem.settings, problem.settings.stage2
    sample = LightSample(problem, shading)
    cells = CellRadiance(shading.cells)
    names = ("log_diffuse", "log_specular", *_light_parameters(estimate))
    run = _Run(
        problem,
        "stage2",
        {name: getattr(estimate, name) for name in names},
        {**_light_rates(stage), "log_diffuse": stage.rate, "log_specular": stage.rate},
    )
    adam = run.adam
    e: Any = None
    s: Any = None
    weight: Any = None
    for iteration in range(stage.iterations):
        if iteration % settings.refresh_interval == 0:
            if iteration:
                e, _ = sample.transport.shade(dr.detach(_radiance(cells, adam)))
                run.expose(e + sample.of(shading.indirect[0]))
            known = dr.detach(_radiance(cells, adam)).numpy()
            shading.update(known, problem.maps(run.result(estimate, *names)))
            e, s = shading.shade(known)
            weight = _trusted(problem, e)
            dr.eval(e, s)
        radiance = _radiance(cells, adam)
        loss = _map_loss(problem, stage, adam, e, s, weight)
        lit = _light_loss(sample, shading, adam, *sample.transport.shade(radiance))
        run.step(iteration, loss, stage.image * lit)
    return run.result(estimate, *names)


def stage3(problem: Problem, estimate: Estimate, shading: Shading) -> tuple[Estimate, Shading]:
    """Shape: vertices through the large-steps preconditioner, textures in image space (3.3).

    Shading is linearised in the normals and refreshed every `refresh_interval` iterations; rays
    are traced anew once a vertex has moved by `retrace_distance`. The light is followed as in
    stage 2, on transport that is corrected at each refresh for the normals' turn since then.
    """
    settings, stage = problem.settings, problem.settings.stage3
    triangles = problem.mesh.triangles
    begin = mi.Point3f(estimate.vertices)
    fitted = device(mi.Point3f, problem.evidence.vertices)
    steps = mi.ad.LargeSteps(dr.ravel(begin), dr.ravel(triangles), settings.shape_lambda)
    names = ("log_diffuse", "log_specular", *_light_parameters(estimate))
    run = _Run(
        problem,
        "stage3",
        {
            **{name: getattr(estimate, name) for name in names},
            "latent": mi.Float(steps.to_differential(dr.ravel(begin))),
        },
        {
            **_light_rates(stage),
            "log_diffuse": stage.rate,
            "log_specular": stage.rate,
            "latent": stage.rate * settings.shape_rate,
        },
        uniform=frozenset({"latent"}),
    )
    adam = run.adam
    landmarks = Landmarks(problem)
    cells = shading.cells
    of_lobes = CellRadiance(cells)
    sample = LightSample(problem, shading)
    traced = begin
    local: Any = None
    weight: Any = None
    corners: Any = None
    turned: tuple[Any, Any] = (0.0, 0.0)
    for iteration in range(stage.iterations):
        vertices = dr.unravel(mi.Point3f, steps.from_differential(adam["latent"]))
        if iteration % settings.refresh_interval == 0:
            if iteration:
                e, _ = sample.transport.shade(dr.detach(_radiance(of_lobes, adam)))
                run.expose(e + turned[0] + sample.of(shading.indirect[0]))
            moved = float(dr.max(dr.norm(dr.detach(vertices) - traced)).numpy().item())
            problem.move(vertices)
            if moved > settings.retrace_distance:
                traced = dr.detach(vertices)
                shading = Shading(problem, cells)
                sample = LightSample(problem, shading)
            else:
                shading.points = problem.points()
            corners = problem.mesh.hit_corners(problem.hits)
            known = dr.detach(_radiance(of_lobes, adam))
            shading.update(known.numpy(), problem.maps(run.result(estimate, *names)))
            local = linearize(shading.points, shading.directions, shading.bits, known.numpy())
            weight = _trusted(problem, local.diffuse + shading.indirect[0])
            e, s = sample.transport.shade(known)
            turned = (sample.of(local.diffuse) - e, sample.of(local.specular) - s)
            dr.eval(turned)
        radiance = _radiance(of_lobes, adam)
        normals = vertex_normals(vertices, problem.mesh.corners)
        _, normal, _ = surface(problem.camera, problem.hits, vertices, normals, triangles, corners)
        e, s = local.shade(normal, normal)
        e, s = e + shading.indirect[0], s + shading.indirect[1]
        loss = _map_loss(problem, stage, adam, e, s, weight)
        loss += stage.landmark * landmarks.loss(vertices)
        loss += stage.shape * shape_l2(vertices, fitted, settings.shape_unit)
        e, s = sample.transport.shade(radiance)
        lit = _light_loss(sample, shading, adam, e + turned[0], s + turned[1])
        run.step(iteration, loss, stage.image * lit)

    vertices = dr.detach(dr.unravel(mi.Point3f, steps.from_differential(adam["latent"])))
    problem.move(vertices)
    return replace(run.result(estimate, *names), vertices=vertices), Shading(problem, cells)


def _normals_and_albedo(
    problem: Problem, estimate: Estimate, shading: Shading, name: str, smoothness: float = 1.0
) -> Estimate:
    """Stages 4 and 5: albedo maps and normal perturbation under a fixed light and mesh."""
    settings: Settings = problem.settings
    stage: Stage = getattr(settings, name)
    names = ("log_diffuse", "log_specular", "perturbation")
    run = _Run(
        problem,
        name,
        {n: getattr(estimate, n) for n in names},
        dict.fromkeys(names, stage.rate),
    )
    adam = run.adam
    blur = Blur(problem.pixel, problem.camera.width, problem.camera.height, DIFFUSE_BLUR)
    mesh_normal = problem.points().specular_normal
    radiance = CellRadiance(shading.cells).of(estimate.light())
    local: Any = None
    weight: Any = None
    for iteration in range(stage.iterations):
        perturbation = adam["perturbation"]
        specular_normal = dr.normalize(mesh_normal + perturbation)
        diffuse_normal = dr.normalize(mesh_normal + blur(perturbation))
        if iteration % settings.refresh_interval == 0:
            turned = (dr.detach(diffuse_normal), dr.detach(specular_normal))
            dr.eval(*turned)
            shading.points = problem.points(*turned)
            local = linearize(shading.points, shading.directions, shading.bits, radiance)
            shading.update(radiance, problem.maps(run.result(estimate, *names)))
            weight = _trusted(problem, local.diffuse + shading.indirect[0])
        e, s = local.shade(diffuse_normal, specular_normal)
        e, s = e + shading.indirect[0], s + shading.indirect[1]
        loss = _map_loss(problem, stage, adam, e, s, weight, smoothness)
        loss += stage.normal * settings.normal_scale * normal_l2(perturbation)
        run.step(iteration, loss)
    return run.result(estimate, *names)


def stage4(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """Normals: a perturbation per texel for the specular normal, blurred for the diffuse (3.4)."""
    return _normals_and_albedo(problem, estimate, shading, "stage4")


def stage5(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """High-frequency albedo: the same unknowns under weaker smoothness (section 3.5)."""
    smoothness = problem.settings.detail_smoothness
    return _normals_and_albedo(problem, estimate, shading, "stage5", smoothness)


class Landmarks:
    """The weak keypoint loss of stage 3: points fixed on the mesh against the detected ones."""

    def __init__(self, problem: Problem) -> None:
        evidence = problem.evidence
        used = np.flatnonzero((evidence.landmark_weight > 0) & (evidence.landmark_triangle >= 0))
        corner = evidence.triangles[evidence.landmark_triangle[used]]
        self.corners = Corners(corner, len(evidence.vertices))
        self.share = device(mi.Vector3f, evidence.landmark_barycentric[used])
        self.detected = device(mi.Point2f, evidence.landmarks[used, :2])
        weight = evidence.landmark_weight[used]
        self.weight = device(mi.Float, weight / max(weight.sum(), 1e-12))
        camera = problem.camera
        self.width = camera.width
        self.pinhole = [dr.opaque(mi.Float, v) for v in (camera.focal, camera.cx, camera.cy)]

    def loss(self, vertices: Any) -> Any:
        """Mean squared distance in units of the crop's width; 0 without landmarks."""
        if not dr.width(self.weight):
            return mi.Float(0)
        focal, cx, cy = self.pinhole
        ((a, b, c),) = self.corners(vertices)
        point = a * self.share.x + b * self.share.y + c * self.share.z
        scale = focal / -point.z
        projected = mi.Point2f(cx + point.x * scale, cy - point.y * scale)
        return landmark_l2(projected, self.detected, self.weight, self.width)


@dataclass(frozen=True)
class Begin:
    """What `run_stages` begins with: the first `done` stages have left this behind.

    cells: of the light; without them the regular grid is refined for the estimate's. normals:
    diffuse and specular (mi.Vector3f, P), as the shading last had them; without them the mesh's.
    """

    done: int
    estimate: Estimate
    cells: Cells | None = None
    normals: tuple[Any, Any] = (None, None)


def run_stages(
    problem: Problem,
    after: Callable[[str, Estimate, Shading], None],
    begin: Begin | None = None,
) -> tuple[Estimate, Shading]:
    """The schedule, or what `begin` leaves of it; the problem's mesh is where `begin` has it.

    `after` is called with (stage name, estimate, shading) at the end of each stage. What one
    stage hands to the next goes through NumPy arrays, also when none of it is saved, and nothing is
    kept of a light that has been left: so a run that is resumed from a file cannot differ from one
    that was never interrupted.
    """
    settings = problem.settings
    begin = begin or Begin(0, start(problem))
    done, estimate = begin.done, begin.estimate
    regular = grid_cells(settings.cell_rows, settings.cell_columns)

    def ended(name: str, estimate: Estimate, shading: Shading) -> Estimate:
        estimate = Estimate.of(estimate.arrays())
        shading.gloss = None
        after(name, estimate, shading)
        return estimate

    def refined(estimate: Estimate) -> Cells:
        return refine(regular, estimate.light().rasterize(), limit=settings.max_cells)

    shading = Shading(problem, begin.cells or (refined(estimate) if done else regular))
    if done < 1:
        estimate = exposed(problem, stage1(problem, estimate, shading), shading)
        estimate = ended("stage1", estimate, shading)
        shading = shading.under(refined(estimate))
    if done < 2:
        estimate = exposed(problem, stage2(problem, estimate, shading), shading)
        estimate = ended("stage2", estimate, shading)
    if done < 3:
        estimate, shading = stage3(problem, estimate, shading)
        estimate = ended("stage3", exposed(problem, estimate, shading), shading)
    else:
        shading.points = problem.points(*begin.normals)
    if done < 4:
        estimate = ended("stage4", stage4(problem, estimate, shading), shading)
    if done < 5:
        estimate = exposed(problem, stage5(problem, estimate, shading), shading)
        estimate = ended("stage5", estimate, shading)
    return estimate, shading


def exposed(problem: Problem, estimate: Estimate, shading: Shading) -> Estimate:
    """Fix the gain between light and albedo, which the image hardly tells.

    Convention: the best-lit skin (99th percentile of the diffuse shading E) has E = 1, as if the
    photo were exposed for a white card held there. Albedo is then what the photo shows where the
    light is full. Inter-reflection and the result take less (exposure.py).
    """
    radiance = CellRadiance(shading.cells).of(estimate.light())
    shading.update(radiance, problem.maps(estimate))
    e, _ = shading.shade(radiance)
    return estimate.brightened(_exposure(e))


def _exposure(e: Any) -> float:
    """The diffuse shading E of the best-lit skin."""
    return float(np.percentile(dr.mean(dr.detach(e)).numpy(), 99))
