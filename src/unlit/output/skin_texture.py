"""Texture of the person's own skin for where the photo shows none.

Skin without its pores and blotches looks like plastic. Where it was not measured it gets a Gaussian
texture with the statistics of measured patches of the same face (Galerne, Gousseau and Morel
2011): their power at each wavelength, and how the channels go together, so that what is dark is
rough and bent as in the patches. Nothing but this photo goes into it. The noise is periodic and
lies in space, on three planes (triplanar mapping), so that the layout's seams and stretch do not
show.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..color import luminance

#: Side of a patch and of the noise's period, cm; patches at most.
_PATCH, _PERIOD, _PATCHES = 1.5, 12.0, 6
#: Standard deviation of the blur that tells texture from tone, cm.
_TONE = 0.15
#: Share of a patch that has to be good evidence, and what that is.
_GOOD, _SURE = 0.97, 0.99
#: Standard deviation of a normal distribution over the median of its absolute values.
_NORMAL = 1.48
_SEED = 20
_FINER = 2  # samples of the noise for each pixel of the crop, so that look-ups need no filter


@dataclass(frozen=True)
class SkinTexture:
    """levels: (T, T, C) noise, then the same averaged over 2 x 2 samples, and so on.

    step: cm from one sample of the first to the next.
    """

    levels: tuple[np.ndarray, ...]
    step: float

    def at(self, point: np.ndarray, normal: np.ndarray, footprint: np.ndarray) -> np.ndarray:
        """Noise (K, C) at points (K, 3), cm, of surfaces with unit normals (K, 3).

        footprint: (K,) cm, the side of what each value stands for.
        """
        out = np.empty((len(point), self.levels[0].shape[2]), dtype=np.float32)
        finest = np.log2(np.maximum(footprint / self.step, 1))
        level = np.minimum(np.rint(finest).astype(int), len(self.levels) - 1)
        steep = np.abs(normal) ** 6
        order = np.argsort(steep, axis=1)[:, ::-1]
        for number, noise in enumerate(self.levels):
            rows = np.flatnonzero(level == number)
            if not rows.size:
                continue
            cell = np.floor(point[rows] / (self.step * 2**number)).astype(np.int64) % len(noise)
            flat = noise.reshape(-1, noise.shape[2])
            total, squares = 0.0, 0.0
            for plane in (0, 1):
                axis = order[rows, plane]
                weight = np.take_along_axis(steep[rows], axis[:, None], axis=1)
                a = np.take_along_axis(cell, (axis[:, None] + 1) % 3, axis=1)[:, 0]
                b = np.take_along_axis(cell, (axis[:, None] + 2) % 3, axis=1)[:, 0]
                # Planes are moved against each other, so that edges between them do not mirror.
                place = (a + 37 * axis) % len(noise) * len(noise) + b
                total = total + weight * flat[place]
                squares = squares + weight**2
            # Independent values, so that their variance stays: not their sum is 1.
            out[rows] = total / np.sqrt(np.maximum(squares, 1e-12))
        return out


def skin_texture(
    channels: np.ndarray, evidence: np.ndarray, centimetre: float
) -> SkinTexture | None:
    """The texture of `channels` (S, S, C) where `evidence` (S, S) is 1; None without a patch.

    The first three channels are the logarithm of a colour. centimetre: its length on the face,
    pixels. Deterministic.
    """
    side = max(round(_PATCH * centimetre), 8)
    corners = _patches(evidence, side)
    if not corners:
        return None
    detail = _detail(channels, evidence, _TONE * centimetre)
    patches = [detail[a : a + side, b : b + side] for a, b in corners]
    # The calmest: wrinkles, stubble, moles and edges of make-up belong where they are.
    patches = sorted(patches, key=lambda patch: float(patch[..., 0].var()))[:_PATCHES]
    period = 1 << int(np.ceil(np.log2(_PERIOD * centimetre)))
    noise = _noise(patches, period)
    # Blind to the few pixels of wrinkles and moles that are left.
    spread = _NORMAL * np.median(np.abs(detail[evidence > _SURE]), axis=0)
    noise *= np.minimum(spread / np.maximum(noise.std(axis=(0, 1)), 1e-9), 1)
    levels = [noise]
    while len(levels[-1]) > 8:
        last = levels[-1]
        levels.append(last.reshape(len(last) // 2, 2, len(last) // 2, 2, -1).mean(axis=(1, 3)))
    return SkinTexture(tuple(levels), 1 / (centimetre * _FINER))


def _detail(channels: np.ndarray, evidence: np.ndarray, blur: float) -> np.ndarray:
    """`channels` (S, S, C) without what is broader than `blur`, pixels.

    Of the colour only what goes with its brightness is kept: other fine colour is the camera's.
    """
    share = ndimage.gaussian_filter(evidence, blur)[..., None]
    tone = ndimage.gaussian_filter(channels * evidence[..., None], (blur, blur, 0))
    detail = channels - tone / np.maximum(share, 1e-6)
    bright = luminance(detail[..., :3])
    here = evidence > _SURE
    power = max(float(np.mean(bright[here] ** 2)), 1e-12)
    for k in range(3):
        slope = float(np.mean(bright[here] * detail[here, k])) / power
        detail[..., k] = slope * bright
    return detail


def _noise(patches: list[np.ndarray], period: int) -> np.ndarray:
    """Periodic noise (T, T, C) with the patches' power and cross power at each wavelength.

    Averaged over all directions, so that it has none, nor the grid of a compressed picture.
    """
    side, _, count = patches[0].shape
    window = np.outer(*2 * [np.hanning(side + 2)[1:-1]])[..., None].astype(np.float32)
    radius = np.hypot(np.fft.fftfreq(period)[:, None], np.fft.rfftfreq(period)[None])
    ring = np.rint(radius * 2 * side).astype(int)  # finer than what a patch tells apart
    size = np.bincount(ring.ravel())
    power = np.zeros((len(size), count, count))
    for patch in patches:
        found = np.fft.rfft2(patch * window, (period, period), axes=(0, 1))
        for a in range(count):
            for b in range(a + 1):
                both = (found[..., a] * found[..., b].conj()).real
                sums = np.bincount(ring.ravel(), both.ravel()) / np.maximum(size, 1)
                power[:, a, b] += sums
                power[:, b, a] += sums * (a != b)
    power /= len(patches) * (window**2).sum()
    value, axes = np.linalg.eigh(power)
    root = (axes * np.sqrt(np.maximum(value, 0))[:, None]).astype(np.float32)
    rng = np.random.default_rng(_SEED)
    white = np.fft.rfft2(rng.standard_normal((period, period, count)), axes=(0, 1))
    spectrum = np.einsum("yxab,yxb->yxa", root[ring], white.astype(np.complex64))
    spectrum[0, 0] = 0
    fine = _FINER * period
    # More samples of the same waves; the wave at the limit of the pixels is left out.
    half = period // 2
    wide = np.zeros((fine, fine // 2 + 1, count), dtype=np.complex64)
    wide[:half, :half] = spectrum[:half, :half]
    wide[-half + 1 :, :half] = spectrum[-half + 1 :, :half]
    return np.fft.irfft2(wide, (fine, fine), axes=(0, 1)).astype(np.float32) * _FINER**2


def _patches(evidence: np.ndarray, side: int) -> list[tuple[int, int]]:
    """First row and column of squares of good evidence that do not overlap."""
    sure = ndimage.uniform_filter((evidence > _SURE).astype(np.float32), side, mode="constant")
    # The filter's value is that of the window that starts side // 2 before.
    found: list[tuple[int, int]] = []
    height, width = (extent - side for extent in sure.shape)
    while sure.max() >= _GOOD:
        row, column = divmod(int(sure.argmax()), evidence.shape[1])
        top, left = row - side // 2, column - side // 2
        if 0 <= top <= height and 0 <= left <= width:
            found.append((top, left))
        sure[max(row - side, 0) : row + side, max(column - side, 0) : column + side] = 0
    return found
