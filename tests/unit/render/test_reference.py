"""The Mitsuba plugin: sampling, weights, energy, reciprocity."""

from typing import Any

import drjit as dr
import numpy as np
import pytest

from bumpy_head import ball, camera, view
from unlit.machine.runtime import mitsuba
from unlit.render.reference import PLUGIN, path_trace
from unlit.scene.brdf import reflectance_table
from unlit.scene.camera import Camera
from unlit.scene.light import uniform
from unlit.scene.maps import Maps

mi = mitsuba()

SIZE = 33


def bsdf(
    alpha: float,
    bend: tuple[float, float, float] = (0, 0, 0),
    diffuse: float = 0.5,
    gloss: float = 1.0,
) -> Any:
    """The plugin with one material around the image's centre.

    bend: perturbation of the specular normal there, two pixels wide, so that the blurred one
    differs: the two lobes stand apart.
    """
    perturbation = np.zeros((SIZE, SIZE, 3), np.float32)
    perturbation[SIZE // 2, SIZE // 2] = bend
    face = mi.load_dict({"type": PLUGIN})
    full = np.ones((SIZE, SIZE), np.float32)
    maps = Maps(
        np.full((SIZE, SIZE, 3), diffuse, np.float32), gloss * full, alpha * full, perturbation
    )
    face.set_maps(Camera(SIZE, SIZE, 100.0, SIZE / 2, SIZE / 2), maps)
    return face


def interaction(wi: tuple[float, float, float], count: int) -> Any:
    """Surface interactions at the point the central pixel sees; wi: local, to the viewer."""
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.p = mi.Point3f(0, 0, -60)
    si.n = mi.Normal3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.wi = dr.normalize(mi.Vector3f([float(x) for x in wi]))
    return si


#: Roughness, bend of the normal, direction to the viewer; the last looks at a facet turned away.
CASES = [
    (0.3, (0.0, 0.0, 0.0), (0, 0, 1)),
    (0.15, (0.0, 0.0, 0.0), (0.6, 0.2, 0.7)),
    (0.3, (0.4, -0.2, 0.0), (-0.3, 0.4, 0.8)),
    (0.3, (0.0, 0.0, 0.0), (0.95, 0.0, 0.15)),
    (0.5, (0.9, 0.0, 0.0), (-0.97, 0.0, 0.2)),
]


@pytest.mark.parametrize(("alpha", "bend", "wi"), CASES)
def test_samples_follow_their_density(alpha: float, bend: Any, wi: Any) -> None:
    """Pearson's chi-square test of sample() against pdf(), as Mitsuba tests its own materials."""
    face, context = bsdf(alpha, bend), mi.BSDFContext()

    def sample(u: Any) -> tuple[Any, Any]:
        si = interaction(wi, dr.width(u))
        bs, _ = face.sample(context, si, u.x, mi.Point2f(u.y, u.z))
        return bs.wo, dr.select(bs.pdf > 0, mi.Float(1), 0)

    def density(wo: Any) -> Any:
        return face.pdf(context, interaction(wi, dr.width(wo)), wo)

    test = mi.chi2.ChiSquareTest(
        mi.chi2.SphericalDomain(), sample, density, sample_dim=3, sample_count=400_000, ires=16
    )
    assert test.run(0.01, test_count=len(CASES), quiet=True), test.messages


@pytest.mark.parametrize(("alpha", "bend", "wi"), CASES)
def test_weights_are_value_over_density(alpha: float, bend: Any, wi: Any) -> None:
    """The sample's weight times its density is the value; their mean is the reflectance.

    The mean is checked against a uniform sampling of the sphere, which would expose a density
    that does not belong to the samples.
    """
    face, context = bsdf(alpha, bend), mi.BSDFContext()
    count = 200_000
    u = mi.Point3f(np.random.default_rng(0).random((3, count)).astype(np.float32))
    si = interaction(wi, count)
    bs, weight = face.sample(context, si, u.x, mi.Point2f(u.y, u.z))
    value, density = face.eval_pdf(context, si, bs.wo)
    np.testing.assert_allclose(bs.pdf.numpy(), density.numpy(), rtol=1e-4)
    np.testing.assert_allclose((weight * bs.pdf).numpy(), value.numpy(), rtol=1e-3, atol=1e-6)
    assert weight.numpy().max() < 6
    even = face.eval(context, si, mi.warp.square_to_uniform_sphere(mi.Point2f(u.y, u.z)))
    expected = 4 * np.pi * even.numpy()[0].mean()
    assert weight.numpy()[0].mean() == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("cosine", [0.2, 0.6, 1.0])
def test_white_furnace(cosine: float) -> None:
    """Energy leaving: the lobe's tabulated reflectance, plus the diffuse albedo, within 1."""
    count = 400_000
    u = mi.Point3f(np.random.default_rng(1).random((3, count)).astype(np.float32))
    si = interaction((np.sqrt(1 - cosine**2), 0, cosine), count)
    context = mi.BSDFContext()
    for alpha in (0.15, 0.3):
        lobe = bsdf(alpha, diffuse=0.0).sample(context, si, u.x, mi.Point2f(u.y, u.z))[1]
        table = reflectance_table(np.array([alpha]), np.array([cosine]), 512, 256)[0, 0]
        assert lobe.numpy()[0].mean() == pytest.approx(table, rel=0.01)
        both = bsdf(alpha, diffuse=0.6).sample(context, si, u.x, mi.Point2f(u.y, u.z))[1]
        assert both.numpy()[0].mean() == pytest.approx(0.6 + table, rel=0.01)
        assert 0.6 + table < 1


def test_reciprocity() -> None:
    """Light and viewer can be exchanged (with one normal: the value over its cosine)."""
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal((2, 3, 300))
    a[2], b[2] = np.abs(a[2]) + 0.1, np.abs(b[2]) + 0.1
    a, b = (dr.normalize(mi.Vector3f(x.astype(np.float32))) for x in (a, b))
    face, context, si = bsdf(0.3), mi.BSDFContext(), interaction((0, 0, 1), 300)
    si.wi = a
    forth = face.eval(context, si, b).numpy()[0] / b.z.numpy()
    si.wi = b
    back = face.eval(context, si, a).numpy()[0] / a.z.numpy()
    assert forth == pytest.approx(back, rel=1e-4)


def test_path_traced_furnace() -> None:
    """A white Lambertian ball under a uniform light is as bright as the light; beside it is 0."""
    unit, triangles = ball(3)
    size = 32
    flat = np.zeros((size, size, 3), np.float32)
    maps = Maps(flat + 1, flat[..., 0], flat[..., 0] + 0.3, flat)
    scene = view((unit * 8 + (0, 0, -70)).astype(np.float32), triangles, camera(size), maps)
    image = path_trace(scene.mesh, scene.camera, maps, uniform(0.7), 64, bounces=0)
    assert image.shape == (size, size, 3)
    assert image[scene.inside(2)].mean() == pytest.approx(0.7, rel=0.003)
    assert image[0, 0].max() == 0
