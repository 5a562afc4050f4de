"""The reflectance model (paper, section 2.2).

    f(wi, wo) = rho_d / pi + rho_s * D(h) F(wi . h) G(wi, wo) / (4 cos_i cos_o)

Lambert plus one Beckmann microfacet lobe with separable Smith masking and exact unpolarised
dielectric Fresnel at index of refraction 1.38. The diffuse and the specular lobe may have
different normals. Everything here works on Dr.Jit arrays of any back end, differentiably, and is
shared by the transport renderer and the path-traced reference, so that they cannot disagree; the
unit tests hold it against Mitsuba's own microfacet and Fresnel code.

References: Walter et al. 2007, "Microfacet models for refraction through rough surfaces"
(D, G, and the rational fit of G1); Weyrich et al. 2006 for roughness per region of the face.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from ..machine.runtime import mitsuba
from .arrays import at_least

#: Index of refraction of skin (paper, section 2.2); normal-incidence Fresnel value 0.0255.
IOR = 1.38


def fresnel(cosine: Any, ior: float = IOR) -> Any:
    """Unpolarised Fresnel reflectance of a dielectric seen from outside, `cosine` in [0, 1]."""
    transmitted = dr.sqrt(dr.fma(cosine, cosine, ior * ior - 1)) / ior
    s = (cosine - ior * transmitted) / (cosine + ior * transmitted)
    p = (transmitted - ior * cosine) / (transmitted + ior * cosine)
    return 0.5 * dr.fma(s, s, p * p)


def beckmann(cosine: Any, alpha: Any) -> Any:
    """Beckmann distribution D(h) per steradian; `cosine` = n . h in (0, 1]."""
    cos2 = dr.square(cosine)
    alpha2 = dr.square(alpha)
    slope2 = (1 - cos2) / (cos2 * alpha2)
    return dr.exp(-slope2) / (dr.pi * alpha2 * dr.square(cos2))


def smith_g1(cosine: Any, alpha: Any) -> Any:
    """Smith masking of the Beckmann distribution, rational fit (Walter et al. 2007, eq. 27)."""
    sine = dr.sqrt(at_least(1 - dr.square(cosine), 1e-12))
    a = cosine / (alpha * sine)
    fit = a * (3.535 + 2.181 * a) / (1 + a * (2.276 + 2.577 * a))
    return dr.select(a >= 1.6, 1.0, fit)


def _log_beckmann_slope(cosine: Any, alpha: Any) -> Any:
    """Derivative of ln D(h) with respect to n . h."""
    return dr.rcp(cosine) * (2 / dr.square(cosine * alpha) - 4)


def _log_smith_slope(cosine: Any, alpha: Any) -> Any:
    """Derivative of ln G1 with respect to the cosine it is taken at."""
    sine2 = at_least(1 - dr.square(cosine), 1e-12)
    sine = dr.sqrt(sine2)
    a = cosine / (alpha * sine)
    top, bottom = a * (3.535 + 2.181 * a), 1 + a * (2.276 + 2.577 * a)
    slope = (3.535 + 4.362 * a) / top - (2.276 + 5.154 * a) / bottom
    return dr.select(a >= 1.6, 0.0, slope / (alpha * sine2 * sine))


def specular(n: Any, wi: Any, wo: Any, alpha: Any) -> Any:
    """Specular lobe for unit specular albedo times the cosine: D F G / (4 cos_o), per steradian.

    n: unit normal; wi: unit direction to the light; wo: unit direction to the viewer (Dr.Jit
    3-vectors in one frame); alpha: roughness. Zero where light or viewer is below the surface.
    """
    return _lobe(n, wi, wo, alpha)[0]


def specular_with_gradient(n: Any, wi: Any, wo: Any, alpha: Any) -> tuple[Any, Any]:
    """`specular`, and its gradient (a 3-vector) with respect to the normal, taken as free."""
    value, half, ch, ci, co = _lobe(n, wi, wo, alpha)
    gradient = _log_beckmann_slope(ch, alpha) * half + _log_smith_slope(ci, alpha) * wi
    gradient += (_log_smith_slope(co, alpha) - dr.rcp(co)) * wo
    return value, value * gradient


def _lobe(n: Any, wi: Any, wo: Any, alpha: Any) -> tuple[Any, ...]:
    cos_i = dr.dot(n, wi)
    cos_o = dr.dot(n, wo)
    half = dr.normalize(wi + wo)
    above = (cos_i > 0) & (cos_o > 0)
    # Clamped before dividing: a masked lane must not carry a NaN into the gradient.
    ch = at_least(dr.dot(n, half), 1e-4)
    ci = at_least(cos_i, 1e-4)
    co = at_least(cos_o, 1e-4)
    value = (
        beckmann(ch, alpha)
        * fresnel(at_least(dr.dot(wi, half), 0.0))
        * smith_g1(ci, alpha)
        * smith_g1(co, alpha)
        / (4 * co)
    )
    return dr.select(above, value, 0.0), half, ch, ci, co


def reflectance_table(alphas: Any, cosines: Any, polar: int = 128, azimuth: int = 64) -> Any:
    """Directional-hemispherical reflectance (len(alphas), len(cosines)) of the unit specular lobe.

    The share of a uniform light that the lobe sends towards a viewer at `cosines` (in (0, 1])
    from the normal and, by reciprocity, the share of a beam from there that it reflects at all.
    NumPy arrays; hemisphere integrated by the midpoint rule, in z and azimuth.
    """
    mi = mitsuba()
    z = (np.arange(polar) + 0.5) / polar
    phi = (np.arange(azimuth) + 0.5) * (2 * np.pi / azimuth)
    r = np.sqrt(1 - z * z)
    incident = np.stack(
        np.broadcast_arrays(r[:, None] * np.cos(phi), r[:, None] * np.sin(phi), z[:, None]), axis=0
    ).reshape(3, -1)
    alpha, cosine = (g.ravel() for g in np.meshgrid(alphas, cosines, indexing="ij"))
    viewer = np.stack([np.sqrt(1 - cosine**2), np.zeros_like(cosine), cosine])
    count, n = incident.shape[1], len(cosine)
    wi = mi.Vector3f(np.tile(incident, (1, n)).astype(np.float32))
    wo = mi.Vector3f(np.repeat(viewer, count, axis=1).astype(np.float32))
    value = specular(mi.Vector3f(0, 0, 1), wi, wo, mi.Float(np.repeat(alpha, count)))
    mean = value.numpy().reshape(n, count).mean(axis=1)
    return (2 * np.pi * mean).reshape(len(alphas), len(cosines)).astype(np.float32)
