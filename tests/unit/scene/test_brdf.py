"""The reflectance model, held against Mitsuba's own microfacet code, and its physics."""

import drjit as dr
import numpy as np
import pytest

from unlit.machine.runtime import mitsuba
from unlit.scene.brdf import (
    IOR,
    beckmann,
    fresnel,
    reflectance_table,
    smith_g1,
    specular,
    specular_with_gradient,
)

mi = mitsuba()

ALPHAS = (0.1, 0.15, 0.3, 0.6)


def directions(count: int, seed: int, lowest: float = 0.05) -> np.ndarray:
    """Random unit directions (3, count) of the upper hemisphere with cosines above `lowest`."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(lowest, 1, count)
    phi = rng.uniform(0, 2 * np.pi, count)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z]).astype(np.float32)


def test_fresnel_is_mitsubas() -> None:
    """Exact dielectric Fresnel, and skin's 2.5 % at normal incidence."""
    cosine = mi.Float(np.linspace(0, 1, 101).astype(np.float32))
    expected = mi.fresnel(cosine, IOR)[0].numpy()
    assert fresnel(cosine).numpy() == pytest.approx(expected, abs=2e-6)
    assert fresnel(mi.Float(1)).numpy() == pytest.approx(((IOR - 1) / (IOR + 1)) ** 2, rel=1e-5)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_distribution_and_masking_are_mitsubas(alpha: float) -> None:
    """D and the rational G1 equal mi.MicrofacetDistribution's Beckmann."""
    facets = mi.MicrofacetDistribution(mi.MicrofacetType.Beckmann, alpha, False)
    h = mi.Vector3f(directions(500, 1, 0.2))
    ours, theirs = beckmann(h.z, mi.Float(alpha)).numpy(), facets.eval(h).numpy()
    strong = theirs > 1e-6 * theirs.max()
    assert ours[strong] == pytest.approx(theirs[strong], rel=2e-3)
    v = mi.Vector3f(directions(500, 2, 0.01))
    expected = facets.smith_g1(v, mi.Vector3f(0, 0, 1)).numpy()
    assert smith_g1(v.z, mi.Float(alpha)).numpy() == pytest.approx(expected, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_reciprocity(alpha: float) -> None:
    """f(wi, wo) = f(wo, wi): the lobe without its cosine is symmetric."""
    n = mi.Vector3f(0, 0, 1)
    a, b = mi.Vector3f(directions(1000, 3)), mi.Vector3f(directions(1000, 4))
    forth = (specular(n, a, b, mi.Float(alpha)) / a.z).numpy()
    back = (specular(n, b, a, mi.Float(alpha)) / b.z).numpy()
    assert forth == pytest.approx(back, rel=2e-4, abs=1e-9)


def test_nothing_from_or_to_below() -> None:
    """No light arrives from, or leaves, below the surface; grazing values are finite."""
    n, up = mi.Vector3f(0, 0, 1), mi.Vector3f(0.6, 0, 0.8)
    down = mi.Vector3f(0.6, 0, -0.8)
    assert specular(n, down, up, mi.Float(0.3)).numpy() == 0
    assert specular(n, up, down, mi.Float(0.3)).numpy() == 0
    opposite, graze = mi.Vector3f(-1, 0, 1e-6), mi.Vector3f(1, 0, 1e-6)
    assert np.isfinite(specular(n, opposite, graze, mi.Float(0.15)).numpy()).all()


def test_white_furnace() -> None:
    """Under a uniform light the unit lobe never reflects more than it receives."""
    alphas = np.array([0.1, 0.15, 0.2, 0.3, 0.45, 0.65])
    cosines = np.array([0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0])
    table = reflectance_table(alphas, cosines, polar=512, azimuth=256)
    assert table.shape == (6, 7)
    assert (table > 0).all()
    assert table.max() < 1
    # What an energy-conserving pair of lobes may have: a diffuse albedo of 1 - R at most.
    assert table[:, cosines >= 0.4].max() < 0.13


def test_reflectance_table() -> None:
    """Brighter at grazing angles; near Fresnel's value for a smooth surface seen from above."""
    cosines = np.array([0.1, 0.3, 0.6, 1.0])
    table = reflectance_table(np.array([0.1, 0.3]), cosines, polar=512, azimuth=256)
    assert (np.diff(table, axis=1) < 0).all()
    assert table[0, -1] == pytest.approx(((IOR - 1) / (IOR + 1)) ** 2, rel=0.05)
    coarse = reflectance_table(np.array([0.3]), cosines)
    assert coarse[0] == pytest.approx(table[1], rel=0.02)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_gradient_with_the_normal(alpha: float) -> None:
    """The written-out gradient equals central differences of `specular` along any tangent."""
    wi, wo = mi.Vector3f(directions(2000, 5, 0.2)), mi.Vector3f(directions(2000, 6, 0.2))
    n = dr.normalize(mi.Vector3f(0, 0, 1) + 0.3 * mi.Vector3f(directions(2000, 7)))
    rough = mi.Float(alpha)
    value, gradient = specular_with_gradient(n, wi, wo, rough)
    assert value.numpy() == pytest.approx(specular(n, wi, wo, rough).numpy(), rel=1e-6)
    tangent = dr.normalize(dr.cross(n, mi.Vector3f(0.3, 0.8, -0.5)))
    step = 2e-3
    ahead = specular(dr.normalize(n + step * tangent), wi, wo, rough)
    behind = specular(dr.normalize(n - step * tangent), wi, wo, rough)
    numeric = ((ahead - behind) / (2 * step)).numpy()
    slope = dr.dot(gradient, tangent).numpy()
    assert np.linalg.norm(slope - numeric) < 0.01 * np.linalg.norm(numeric)


def test_differentiable() -> None:
    """Automatic differentiation with respect to roughness matches central differences."""
    n, wi = mi.Vector3f(0, 0, 1), mi.Vector3f(directions(200, 8, 0.2))
    wo = mi.Vector3f(directions(200, 9, 0.2))
    alpha = mi.Float(0.3)
    dr.enable_grad(alpha)
    dr.backward(dr.sum(specular(n, wi, wo, alpha)))
    low, high = (dr.sum(specular(n, wi, wo, mi.Float(a))).numpy().item() for a in (0.299, 0.301))
    assert dr.grad(alpha).numpy().item() == pytest.approx((high - low) / 0.002, rel=0.01)
