"""What moves from frame to frame, and the pictures of it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..face.face import Face
from ..face.reconstruction import Reconstruction
from ..progress.callbacks import StepProgress
from ..progress.log import clock
from ..render.relighter import Relighter, path_traced
from .lights import turned
from .pose import Turntable


@dataclass(frozen=True)
class Frame:
    """Degrees about the vertical axis by which the light and the head are turned.

    Positive turns a light in front, and the face, to the picture's right.
    """

    light: float = 0.0
    head: float = 0.0


def sweep(count: int) -> list[Frame]:
    """The light once round the head."""
    return [Frame(light=360 * k / count) for k in range(count)]


def turntable(count: int, degrees: float, light: float) -> list[Frame]:
    """The head `degrees` to one side, to the other, and back; with 360, once round."""
    share = np.arange(count) / count
    heads = 360 * share if degrees == 360 else degrees * np.sin(2 * np.pi * share)
    return [Frame(light, float(head)) for head in heads]


def rendered_frames(
    face: Reconstruction,
    environment: np.ndarray,
    frames: Sequence[Frame],
    samples: int | None,
    progress: StepProgress,
) -> Iterator[np.ndarray]:
    """The frames (S, S, 3), linear sRGB, 0 where there is no face, one after the other.

    samples: of the path tracer, per pixel; None: the transport renderer. It traces once what the
    face sees of a light that turns; a head that turns is traced anew for each frame.
    """
    report = _FrameProgress(len(frames), progress)
    table = Turntable(face) if any(frame.head for frame in frames) else None
    if samples is None and table is None:
        lit = Relighter(face.face).under(environment, [frame.light for frame in frames])
        for number in range(len(frames)):
            report(number)
            yield lit.image(number)
    else:
        for number, frame in enumerate(frames):
            report(number)
            seen: Face = table.turned(frame.head) if table else face.face
            if samples is None:
                yield Relighter(seen).under(environment, [frame.light]).image(0)
            else:
                light = turned(environment, frame.light)
                picture = path_traced(
                    seen, light, samples, progress=lambda a, b, n=number: report(n, a / b)
                )
                yield picture * (seen.mask > 0)[..., None]
    report(len(frames))


class _FrameProgress:
    """Tells how far the frames are, in hundredths, and the time left."""

    def __init__(self, count: int, progress: StepProgress) -> None:
        self.count, self.progress = count, progress
        self.start: float | None = None
        progress("preparing", 0, 100)

    def __call__(self, number: int, part: float = 0.0) -> None:
        now = time.monotonic()
        if self.start is None:  # what comes before the first frame comes once
            self.start = now
        done = (number + part) / self.count
        what = "rendering" if self.count == 1 else f"frame {min(number + 1, self.count)}"
        what += "" if self.count == 1 else f" of {self.count}"
        if 0 < done < 1:
            what += f", {clock((now - self.start) * (1 - done) / done)} left"
        # The last step is the file's.
        self.progress(what, min(int(100 * done), 99), 100)
