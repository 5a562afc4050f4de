"""Image metrics inside a mask, and distances of surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from ..color import encode_srgb
from ..errors import MachineError
from .lpips import lpips


def psnr(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """Peak signal-to-noise ratio, dB, of sRGB-encoded values clipped to [0, 1], inside `mask`.

    image, truth: (H, W, 3) linear; mask: (H, W) bool.
    """
    return psnr_linear(encode_srgb(image), encode_srgb(truth), mask)


def psnr_linear(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """The same of the values as they are, clipped to [0, 1]."""
    a, b = (np.clip(x[mask], 0, 1).astype(np.float64) for x in (image, truth))
    return float(-10 * np.log10(max(np.mean((a - b) ** 2), 1e-12)))


def best_gain(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """The one factor on linear `image` (H, W, 3) that brings it nearest to `truth` in `mask`.

    Nearest in encoded values: the light and the albedo of one photo share an unknown gain.
    """
    a, b = image[mask], truth[mask]
    gain = float(b.sum() / max(a.sum(), 1e-12))
    for _ in range(3):
        trial = gain * np.geomspace(0.8, 1.25, 41)
        errors = [np.mean((encode_srgb(a * g) - encode_srgb(b)) ** 2) for g in trial]
        gain = float(trial[int(np.argmin(errors))])
    return gain


def channel_gains(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """`best_gain` of each channel by itself, (3,): what a coloured light leaves is taken off."""
    each = [best_gain(image[..., [c]], truth[..., [c]], mask) for c in range(3)]
    return np.array(each, dtype=np.float32)


def ssim(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """Structural similarity (Wang et al. 2004) of encoded (H, W, 3) in [0, 1], mean in `mask`."""
    from skimage.metrics import structural_similarity

    local: Any = structural_similarity(
        image,
        truth,
        data_range=1.0,
        channel_axis=2,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )[1]
    return float(local[mask].mean())


def flip(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """FLIP (Andersson et al. 2020) of encoded (H, W, 3) in [0, 1], mean in `mask`.

    At the default of 67 pixels a degree. Raises MachineError where its package is missing.
    """
    local, _, _ = flip_package().evaluate(truth, image, "LDR", applyMagma=False)
    return float(np.asarray(local)[..., 0][mask].mean())


def flip_package() -> Any:
    """What measures FLIP. Raises MachineError where it is missing."""
    try:
        import flip_evaluator
    except ImportError as error:
        raise MachineError(
            "the package flip-evaluator is missing: pip install 'unlit[evaluate]'"
        ) from error
    return flip_evaluator


def compare(image: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> dict[str, Any]:
    """All metrics of a relit face, linear (H, W, 3), raw and after one global gain.

    Both pictures are black outside `mask` (H, W). `face` are means inside it, `crop` means over
    the whole picture, as for any picture on a black ground.
    """
    gain = best_gain(image, truth, mask)
    everywhere = np.ones_like(mask)
    result: dict[str, Any] = {"gain": gain}
    for name, factor in (("raw", 1.0), ("gained", gain)):
        a, b = (np.where(mask[..., None], x, 0) for x in (image * factor, truth))
        x, y = (np.clip(encode_srgb(z), 0, 1) for z in (a, b))
        result[name] = {
            where: {
                "psnr": psnr(a, b, area),
                "psnr_linear": psnr_linear(a, b, area),
                "ssim": ssim(x, y, area),
                "lpips": lpips(x, y, area),
                "flip": flip(x, y, area),
            }
            for where, area in (("face", mask), ("crop", everywhere))
        }
    return result


def angle(normals: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """Mean angle, degrees, between unit normals (H, W, 3) inside `mask`."""
    cosine = np.clip((normals[mask] * truth[mask]).sum(axis=-1), -1, 1)
    return float(np.degrees(np.arccos(cosine)).mean())


def surface_distance(
    points: np.ndarray, truth: np.ndarray, normals: np.ndarray, rounds: int = 30
) -> dict[str, float]:
    """Distances from `points` (N, 3) to a surface after the best rigid motion, in their unit.

    truth: (M, 3) samples of the surface, denser than the errors; normals: (M, 3) unit. Iterated
    closest points with the distance to the tangent plane (Chen and Medioni 1992), the farthest
    tenth left out of the alignment. Returns mean, median, and 95th percentile of all points.
    """
    tree: Any = KDTree(truth)
    moved = points.astype(np.float64)
    for _ in range(rounds):
        distance, near = tree.query(moved)
        kept = distance <= np.percentile(distance, 90)
        x, n = moved[kept], normals[near[kept]]
        centre = x.mean(axis=0)
        rows = np.concatenate([np.cross(x - centre, n), n], axis=1)
        gap = ((truth[near[kept]] - x) * n).sum(axis=1)
        motion = np.linalg.lstsq(rows, gap, rcond=None)[0]
        moved = (
            (moved - centre) @ Rotation.from_rotvec(motion[:3]).as_matrix().T + centre + motion[3:]
        )
    _, near = tree.query(moved)
    gap = np.abs(((truth[near] - moved) * normals[near]).sum(axis=1))
    return {
        "mean": float(gap.mean()),
        "median": float(np.median(gap)),
        "p95": float(np.percentile(gap, 95)),
    }
