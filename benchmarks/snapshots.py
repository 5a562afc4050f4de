"""What a camera makes of a rendered head: a background, exposure, a tone curve, noise, JPEG.

Path-traced heads are kinder than photos; this takes some of that back.
"""

from __future__ import annotations

import cv2
import numpy as np

from unlit.color import encode_srgb
from unlit.scene.light import disc, flash, latlong_directions, uniform


def _grey(environment: np.ndarray) -> np.ndarray:
    return np.repeat(environment[..., None], 3, axis=2).astype(np.float32)


def _from(x: float, y: float, z: float, half_angle: float, fill: float) -> np.ndarray:
    """A white disc in that direction, and an even light of `fill` besides."""
    return _grey(disc((x, y, z), irradiance=1.0, half_angle=half_angle) + uniform(fill / np.pi))


def _window() -> np.ndarray:
    """A large window to the right, a room that gives some of it back."""
    d = latlong_directions(90, 180)
    lit = (d[..., 0] > 0.5) & (np.abs(d[..., 1] - 0.2) < 0.5)
    sky = np.where(lit[..., None], (1.6, 1.8, 2.1), (0.16, 0.14, 0.12))
    return sky.astype(np.float32)


def _sun() -> np.ndarray:
    from unlit.output.relit import outdoors  # needs the renderer, which the rest does without

    return outdoors()


#: Environment maps (H, W, 3) in the camera's frame, by name; the first four are the benchmark's.
LIGHTS = {
    "uniform": lambda: _grey(uniform(0.3)),
    "flash": lambda: _grey(flash()),
    "side": lambda: _from(0.87, 0.2, 0.45, 4.0, 0.06),
    "sun": _sun,
    "window": _window,
    "above": lambda: _from(-0.3, 0.9, 0.35, 8.0, 0.15),
}


def random_light(rng: np.random.Generator) -> np.ndarray:
    """(64, 128, 3): an even light and one to four others of random place, size and colour."""
    d = latlong_directions(64, 128)
    warm = rng.normal() * 0.25
    tint = np.exp(np.array([warm, 0.0, -warm]))
    total = np.ones((64, 128, 1)) * rng.choice([0.02, 0.08, 0.2, 0.5]) * tint
    total = total * (1 + rng.uniform(-0.6, 0.9) * d[..., 1:2])
    for _ in range(rng.integers(1, 5)):
        axis = rng.standard_normal(3) * (1.0, 0.7, 1.0) + (0, 0.3, 0.5)
        axis /= np.linalg.norm(axis)
        sharpness = np.exp(rng.uniform(np.log(2.0), np.log(600.0)))
        lobe = np.exp(sharpness * (d @ axis - 1)) * sharpness / 6
        colour = tint * np.exp(rng.normal(0, 0.15, 3))
        total = total + rng.uniform(0.05, 1.0) * lobe[..., None] * colour
    return total.astype(np.float32)


def background(size: int, rng: np.random.Generator) -> np.ndarray:
    """(S, S, 3) linear: a gradient, blurred blocks and grain, as of a room or a garden."""
    corner = np.exp(rng.normal(-1.2, 0.9, (2, 2, 3)))
    colour = np.exp(rng.normal(-1.2, 0.8, (1, 1, 1)) + rng.normal(0, 0.25, (1, 1, 3)))
    grid = np.repeat(colour, 2, axis=0).repeat(2, axis=1) if rng.random() < 0.5 else corner
    picture = cv2.resize(grid.astype(np.float32), (size, size), interpolation=cv2.INTER_LINEAR)
    for _ in range(rng.integers(0, 40)):
        a, b = rng.integers(-size // 4, size, 2)
        w, h = rng.integers(size // 20, size, 2)
        tone = np.exp(rng.normal(-1.2, 0.9) + rng.normal(0, 0.3, 3))
        if rng.random() < 0.5:
            cv2.rectangle(picture, (int(a), int(b)), (int(a + w), int(b + h)), tone.tolist(), -1)
        else:
            axes = (int(w // 2), int(h // 2))
            cv2.ellipse(picture, (int(a), int(b)), axes, 0, 0, 360, tone.tolist(), -1)
    blur = rng.choice([0.0, 0.004, 0.012, 0.04]) * size
    if blur:
        picture = cv2.GaussianBlur(picture, (0, 0), blur)
    return picture * np.exp(rng.normal(0, rng.choice([0, 0.05, 0.2]), (size, size, 1)))


def developed(
    render: np.ndarray, behind: np.ndarray, rng: np.random.Generator, light: float = 1.0
) -> np.ndarray:
    """(S, S, 3) uint8, sRGB: `render` (S, S, 4), linear and its coverage, over `behind` (S, S, 3).

    light: how bright the background is beside the head. The exposure looks at the head.
    """
    covered = render[..., 3:]
    head = render[..., :3]
    inside = covered[..., 0] > 0.9
    level = np.percentile(head[inside].mean(axis=1), 90) if inside.any() else 1.0
    exposure = np.exp(rng.normal(np.log(0.55), 0.35)) / max(float(level), 1e-4)
    linear = head * exposure + (1 - covered) * behind * light
    linear = cv2.GaussianBlur(linear.astype(np.float32), (0, 0), rng.uniform(0.3, 0.9))
    noise = rng.choice([0.001, 0.003, 0.008])
    linear = linear + rng.standard_normal(linear.shape) * noise * np.sqrt(np.maximum(linear, 0.01))
    encoded = encode_srgb(np.clip(linear, 0, 1).astype(np.float32))
    contrast = rng.uniform(0.0, 0.6)  # of an S-curve, as cameras have
    curve = encoded * encoded * (3 - 2 * encoded)
    encoded = encoded + contrast * (curve - encoded)
    return jpeg(encoded, int(rng.integers(70, 97)))


def jpeg(encoded: np.ndarray, quality: int) -> np.ndarray:
    """(H, W, 3) uint8 of sRGB-encoded values, as a JPEG of that quality gives them back."""
    picture = np.round(255 * np.clip(encoded, 0, 1)).astype(np.uint8)
    _, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.ascontiguousarray(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))[..., ::-1])
