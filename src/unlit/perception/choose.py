"""Which of the faces in a photo is meant."""

from __future__ import annotations

from ..errors import FaceError
from .landmarks import DetectedFace


def choose(faces: list[DetectedFace], which: str | int, source: str) -> DetectedFace:
    """The face that was asked for. Raises FaceError naming the photo and the remedy."""
    if not faces:
        raise FaceError(
            f"{source}: no face found; use a photo in which the face is upright, in focus and at "
            "least 80 pixels wide"
        )
    if which == "only":
        if len(faces) > 1:
            raise FaceError(
                f"{source}: {len(faces)} faces found; choose the face largest, left, right or N (0 "
                f"to {len(faces) - 1}, from large to small), or crop the photo",
                "face",
            )
        return faces[0]
    if which == "largest":
        return faces[0]
    if which in ("left", "right"):
        return (min if which == "left" else max)(faces, key=lambda face: face.box[0] + face.box[2])
    if isinstance(which, int) and 0 <= which < len(faces):
        return faces[which]
    if len(faces) == 1:
        raise FaceError(f"{source}: no face {which!r}; only one found: do not choose", "face")
    raise FaceError(
        f"{source}: no face {which!r}; {len(faces)} found: use largest, left, right or 0 to "
        f"{len(faces) - 1}",
        "face",
    )
