"""What `unlit relight` does: checks, reads, renders, writes one file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import SettingsError
from ..output.images import encoded, exr, png
from ..output.load import load
from ..output.save import RESULT_FILES
from ..photo.photo import read_photo
from ..progress.callbacks import StepProgress, silent
from ..storage.folder import ensure_writable, write_one
from .composite import Backdrop
from .frames import Frame, rendered_frames, sweep, turntable
from .lights import requested_light
from .video import gif, mp4, need_encoder

STILLS, VIDEOS = (".png", ".exr"), (".mp4", ".gif")
SWEEP = "sweep"
SAMPLES, VIDEO_SAMPLES = 128, 32
FRAMES, FPS = 75, 25
_MAX_SAMPLES, _MAX_FRAMES, _MAX_FPS, _MAX_STOPS = 65536, 3600, 50, 20.0
_MAX_SIDE = 4096


@dataclass(frozen=True)
class RelightRequest:
    """What is asked of a relighting; None: not given.

    light: as `lights.environment_map` takes it, or `photo`. rotate: degrees, or "sweep".
    turntable: degrees to either side, or 360. brightness: stops. samples, frames, fps: see the
    defaults above.
    """

    light: str
    rotate: float | str | None = None
    turntable: float | None = None
    brightness: float = 0.0
    fast: bool = False
    samples: int | None = None
    frames: int | None = None
    fps: int | None = None
    over_photo: Path | None = None

    def plan(self, suffix: str) -> tuple[list[Frame], int | None]:
        """The frames, and the samples (None: fast), for a file that ends in `suffix`.

        Raises SettingsError for values out of range and choices that do not go together.
        """
        video = suffix in VIDEOS
        if suffix not in (*STILLS, *VIDEOS):
            raise SettingsError(f"{suffix or 'no ending'}: give a .png, .exr, .mp4 or .gif file")
        _check("brightness", self.brightness, -_MAX_STOPS, _MAX_STOPS)
        _check("samples", self.samples, 1, _MAX_SAMPLES)
        _check("frames", self.frames, 2, _MAX_FRAMES)
        _check("fps", self.fps, 1, _MAX_FPS)
        for name in ("turntable", "frames", "fps"):
            if getattr(self, name) is not None and not video:
                raise SettingsError(f"{name} makes a video; give an .mp4 or .gif file", name)
        if self.rotate == SWEEP and not video:
            raise SettingsError("a sweep makes a video; give an .mp4 or .gif file", "rotate")
        if self.fast and self.samples is not None:
            raise SettingsError("samples has no use with fast; leave one out", "samples")
        angle = 0.0 if self.rotate is None or self.rotate == SWEEP else float(self.rotate)
        _check("rotate", angle, -360, 360)
        samples = None if self.fast else self.samples or (VIDEO_SAMPLES if video else SAMPLES)
        count = self.frames or FRAMES
        if not video:
            return [Frame(angle)], samples
        if self.turntable is None:
            if self.rotate not in (None, SWEEP):
                raise SettingsError("an angle holds the light still; use a sweep", "rotate")
            return sweep(count), samples
        _check("turntable", self.turntable, 1, 360)
        if self.rotate == SWEEP or self.over_photo is not None:
            other = "a sweep" if self.rotate == SWEEP else "over_photo"
            raise SettingsError(f"turntable and {other} do not go together; leave one out")
        return turntable(count, self.turntable, angle), samples


def _check(name: str, value: float | None, low: float, high: float) -> None:
    if value is not None and not (math.isfinite(value) and low <= value <= high):
        raise SettingsError(f"{name} {value:g}: choose {low:g} to {high:g}", name)


def relight(
    folder: Path, path: Path, request: RelightRequest, progress: StepProgress = silent
) -> Path:
    """Relight the result in `folder` into the file `path`, whole or not at all; returns `path`.

    Raises SettingsError, PictureError, PhotoError, OutputError or MachineError.
    """
    suffix = path.suffix.lower()
    frames, samples = request.plan(suffix)
    if suffix == ".mp4":
        need_encoder()
    _spare_inputs(folder, path, request)
    ensure_writable(path)
    face = load(folder)
    environment = requested_light(request.light, face.light.environment)
    environment = environment * np.float32(2**request.brightness)
    backdrop = None
    if request.over_photo is not None:
        backdrop = Backdrop(face, read_photo(request.over_photo))
        height, width = backdrop.photo.pixels.shape[:2]
        if suffix in VIDEOS and max(width, height) > _MAX_SIDE:
            raise SettingsError(
                f"{request.over_photo}: a video of {width} x {height} pixels; at most {_MAX_SIDE} "
                "a side: relight a .png, or a photo that was scaled down before its reconstruction"
            )
    linear = rendered_frames(face, environment, frames, samples, progress)
    if suffix == ".exr":
        (picture,) = linear
        content = exr(backdrop(picture) if backdrop else picture)
    else:
        shown = map(backdrop.encoded8 if backdrop else encoded, linear)
        content = _FILES[suffix](shown, request.fps or FPS)
    write_one(path, content)
    progress("done", 100, 100)
    return path


def _spare_inputs(folder: Path, path: Path, request: RelightRequest) -> None:
    """Refuse to write over the photo, the light, or a file of the result."""
    inputs = {folder / name for name in RESULT_FILES}
    inputs |= {Path(name) for name in (request.light, request.over_photo) if name is not None}
    if path.resolve() in {file.resolve() for file in inputs}:
        raise SettingsError(f"{path}: is an input or a file of the result; choose another name")


def _png(frames: Iterator[np.ndarray], fps: int) -> bytes:
    (picture,) = frames
    return png(picture)


_FILES: dict[str, Callable[[Iterator[np.ndarray], int], bytes]] = {
    ".png": _png,
    ".mp4": mp4,
    ".gif": gif,
}
