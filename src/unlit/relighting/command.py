"""What `unlit relight` does: checks, reads, renders, writes one file."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import SettingsError
from ..face.reconstruction import Reconstruction
from ..output.images import encoded, exr
from ..output.load import load
from ..output.save import RESULT_FILES
from ..photo.photo import read_photo
from ..progress.callbacks import StepProgress, silent
from ..storage.folder import ensure_writable, write_one, write_several
from .background import PHOTO, background, check_background
from .composite import Portrait
from .frames import Frame, rendered_frames, sweep, turntable
from .lights import requested_light
from .passes import passes_exr
from .stills import StillEncoder
from .video import gif, mp4, need_encoder

STILLS, VIDEOS = (".png", ".jpg", ".jpeg", ".exr"), (".mp4", ".gif")
SWEEP = "sweep"
SAMPLES, VIDEO_SAMPLES = 128, 32
FRAMES, FPS = 75, 25
_MAX_SAMPLES, _MAX_FRAMES, _MAX_FPS, _MAX_STOPS = 65536, 3600, 50, 20.0
_MAX_SIDE = 4096
#: The number in the names of a sequence, which stands right before the ending.
_NUMBER = re.compile(r"%0[1-9]d")
_ENDINGS = "give a .png, .jpg, .exr, .mp4 or .gif file, or numbered pictures such as out_%04d.png"


@dataclass(frozen=True)
class Plan:
    """frames: what is rendered. samples: of each pixel; None: fast. files: what `path` becomes, one
    for each frame of a sequence, none for passes only.
    """

    frames: list[Frame]
    samples: int | None
    files: list[Path]


@dataclass(frozen=True)
class RelightRequest:
    """What is asked of a relighting; None: not given.

    light: as `lights.environment_map` takes it, or `photo`. rotate: degrees, or "sweep".
    turntable: degrees to either side, or 360. brightness: stops. samples, frames, fps: see the
    defaults above. over_photo: the photo that the person is relit in; background: what is behind
    the person then, as `background.background` takes it. passes: a file for `passes.py`.
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
    background: str | None = None
    passes: Path | None = None

    def plan(self, path: Path | None) -> Plan:
        """What is to be made for a file or sequence; None: passes only.

        Raises SettingsError for values out of range and choices that do not go together.
        """
        if path is None:
            self._check_passes_only()
        suffix = ".exr" if path is None else path.suffix.lower()
        sequence = path is not None and _is_sequence(path)
        if suffix not in (*STILLS, *VIDEOS) or (sequence and suffix in VIDEOS):
            raise SettingsError(f"{suffix or 'no ending'}: {_ENDINGS}")
        video = suffix in VIDEOS or sequence
        _check("brightness", self.brightness, -_MAX_STOPS, _MAX_STOPS)
        _check("samples", self.samples, 1, _MAX_SAMPLES)
        _check("frames", self.frames, 2, _MAX_FRAMES)
        _check("fps", self.fps, 1, _MAX_FPS)
        for name in ("turntable", "frames", "fps"):
            if getattr(self, name) is not None and not video:
                raise SettingsError(f"{name} makes a video; give an .mp4 or .gif file", name)
        if self.fps is not None and sequence:
            raise SettingsError("fps has no use with numbered pictures; leave it out", "fps")
        if self.rotate == SWEEP and not video:
            raise SettingsError("a sweep makes a video; give an .mp4 or .gif file", "rotate")
        if self.fast and self.samples is not None:
            raise SettingsError("samples has no use with fast; leave one out", "samples")
        if self.passes is not None and self.passes.suffix.lower() != ".exr":
            raise SettingsError(f"{self.passes}: passes are an .exr file", "passes")
        if self.passes is not None and video:
            raise SettingsError("passes are of one light, not of a video; leave one out", "passes")
        if self.background is not None:
            if self.over_photo is None:
                raise SettingsError("a background needs over_photo; give the photo", "background")
            check_background(self.background)
        angle = 0.0 if self.rotate is None or self.rotate == SWEEP else float(self.rotate)
        _check("rotate", angle, -360, 360)
        samples = None if self.fast else self.samples or (VIDEO_SAMPLES if video else SAMPLES)
        frames = self._moves(angle) if video else [Frame(angle)]
        files = [] if path is None else [path]
        if path is not None and sequence:
            files = [path.with_name(numbered(path.name, k + 1)) for k in range(len(frames))]
        return Plan(frames, samples, files)

    def _moves(self, angle: float) -> list[Frame]:
        """The frames of a video."""
        count = self.frames or FRAMES
        if self.turntable is None:
            if self.rotate not in (None, SWEEP):
                raise SettingsError("an angle holds the light still; use a sweep", "rotate")
            return sweep(count)
        _check("turntable", self.turntable, 1, 360)
        if self.rotate == SWEEP or self.over_photo is not None:
            other = "a sweep" if self.rotate == SWEEP else "over_photo"
            raise SettingsError(f"turntable and {other} do not go together; leave one out")
        return turntable(count, self.turntable, angle)

    def _check_passes_only(self) -> None:
        """Passes come from the transport renderer, as with `fast`, and have no background."""
        if self.passes is None:
            raise SettingsError("nothing to write: give a file, or passes", "output")
        for name in ("samples", "background"):
            if getattr(self, name) is not None:
                raise SettingsError(f"{name} has no use with passes alone; leave it out", name)


def _check(name: str, value: float | None, low: float, high: float) -> None:
    if value is not None and not (math.isfinite(value) and low <= value <= high):
        raise SettingsError(f"{name} {value:g}: choose {low:g} to {high:g}", name)


def _is_sequence(path: Path) -> bool:
    """Whether the file's name asks for numbered pictures. Raises SettingsError where it is odd."""
    numbers = list(_NUMBER.finditer(path.name))
    if numbers and (len(numbers) > 1 or numbers[0].end() != len(path.stem)):
        raise SettingsError(f"{path.name}: one number, right before the ending: out_%04d.png")
    return bool(numbers)


def numbered(pattern: str, number: int) -> str:
    """The name of a sequence's picture: "out_%04d.png" to "out_0001.png"."""
    return _NUMBER.sub(lambda place: place[0] % number, pattern)


@dataclass(frozen=True)
class Written:
    """What `relight` has written: files, and sentences about what cannot be trusted in them."""

    paths: list[Path]
    warnings: list[str]


def relight(
    folder: Path, path: Path | None, request: RelightRequest, progress: StepProgress = silent
) -> Written:
    """Relight the result in `folder` into the file `path`, whole or not at all.

    path: also the pattern of a sequence's names, which then appear all at once; None for passes
    only. Raises SettingsError, PictureError, PhotoError, OutputError or MachineError.
    """
    plan = request.plan(path)
    frames, samples = plan.frames, plan.samples
    suffix = ".exr" if path is None else path.suffix.lower()
    if suffix == ".mp4":
        need_encoder()
    targets = plan.files + ([] if request.passes is None else [request.passes])
    _spare_inputs(folder, targets, request)
    ensure_writable(*targets)
    face = load(folder)
    environment = requested_light(request.light, face.light.environment)
    environment = environment * np.float32(2**request.brightness)
    written: list[Path] = []
    warnings: list[str] = []
    if path is not None:
        pictures = _Pictures(face, environment, frames, request)
        if pictures.portrait is not None and suffix in VIDEOS:
            _check_size(request, pictures.portrait)
        shown = pictures(rendered_frames(face, environment, frames, samples, progress))
        if len(frames) > 1 and suffix not in VIDEOS:
            names = [file.name for file in plan.files]
            write = pictures.still(suffix)
            write_several(path.parent, zip(names, map(write, shown), strict=True))
        else:
            write_one(path, _content(suffix, pictures, shown, request.fps or FPS))
        written += plan.files
        warnings = pictures.warnings
    if request.passes is not None:
        progress("passes", 99, 100)
        photo = None if request.over_photo is None else read_photo(request.over_photo)
        write_one(request.passes, passes_exr(face, environment, frames[0].light, photo))
        written.append(request.passes)
    progress("done", 100, 100)
    return Written(written, warnings)


class _Pictures:
    """From the relit face to the pictures that are written, linear sRGB."""

    def __init__(
        self,
        face: Reconstruction,
        environment: np.ndarray,
        frames: list[Frame],
        request: RelightRequest,
    ) -> None:
        self.frames = frames
        self.warnings: list[str] = []
        self._warned = False
        self.portrait: Portrait | None = None
        if request.over_photo is not None:
            photo = read_photo(request.over_photo)
            turns = [frame.light for frame in frames]
            self.portrait = Portrait(face, photo, environment, turns)
            behind = request.background or PHOTO
            self._behind = background(behind, face, photo, environment)
            if behind != PHOTO and self.portrait.guess is not None:
                self.warnings.append(self.portrait.guess)

    def __call__(self, relit: Iterator[np.ndarray]) -> Iterator[np.ndarray]:
        """One picture for each (S, S, 3) of `relit`."""
        for number, face in enumerate(relit):
            if self.portrait is None:
                yield face
                continue
            found = self.portrait(face, number)
            warning = self.portrait.warning(face, number)
            if warning is not None and not self._warned:  # once, also for a video
                self.warnings.append(warning)
                self._warned = True
            behind = self._behind(self.frames[number].light)
            yield found.image if behind is None else found.over(behind)

    def still(self, suffix: str) -> Callable[[np.ndarray], bytes]:
        """What makes a file of one picture."""
        if suffix == ".exr":
            return exr
        encoder = StillEncoder(None if self.portrait is None else self.portrait.photo.tags)
        lost = encoder.warning(suffix)
        if lost is not None:
            self.warnings.append(lost)
        return encoder.png if suffix == ".png" else encoder.jpeg


def _content(suffix: str, pictures: _Pictures, shown: Iterator[np.ndarray], fps: int) -> bytes:
    """The file of a single picture, or of a video."""
    if suffix not in VIDEOS:
        (picture,) = shown
        return pictures.still(suffix)(picture)
    return _FILES[suffix](map(encoded, shown), fps)


def _check_size(request: RelightRequest, portrait: Portrait) -> None:
    height, width = portrait.photo.pixels.shape[:2]
    if max(width, height) > _MAX_SIDE:
        raise SettingsError(
            f"{request.over_photo}: a video of {width} x {height} pixels; at most {_MAX_SIDE} "
            "a side: relight a .png, or a photo that was scaled down before its reconstruction"
        )


def _spare_inputs(folder: Path, targets: list[Path], request: RelightRequest) -> None:
    """Refuse to write over the photo, the light, a file of the result, or what is written, too."""
    inputs = {folder / name for name in RESULT_FILES}
    names = (request.light, request.over_photo, request.background)
    inputs |= {Path(name) for name in names if name is not None}
    taken = {file.resolve() for file in inputs}
    for path in targets:
        if path.resolve() in taken:
            raise SettingsError(f"{path}: is an input or a file of the result; choose another name")
    if len({path.resolve() for path in targets}) < len(targets):
        raise SettingsError(f"{request.passes}: picture and passes are two files; name two")


_FILES: dict[str, Callable[[Iterator[np.ndarray], int], bytes]] = {".mp4": mp4, ".gif": gif}
