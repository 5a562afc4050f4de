"""Maps of a saved result that were edited since, found by holding the files against the arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..color import decode_srgb
from ..errors import OutputError
from ..face.reconstruction import Reconstruction
from ..perception.mask import painted
from ..storage.pictures import read_picture
from .images import MAPS

#: What stages can start from: by name, the values of a preview's levels, 0 to 1.
_VALUES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "diffuse_albedo": decode_srgb,
    "specular_albedo": lambda levels: 2 * levels,
    "mask": lambda levels: levels,
}


def edited(
    reconstruction: Reconstruction, folder: Path, stage: int
) -> tuple[Reconstruction, list[str]]:
    """The result that was loaded from `folder`, with the maps that were edited there since.

    stage: the first that is to run on it. Of a map only the pixels that differ are taken: by more
    than one level of a PNG, or 0.1 % of an EXR. A file that is missing counts as not edited. Also
    returns the names of the files taken. Raises OutputError when both files of a map were edited,
    or one that the stages make anew; PictureError when a file cannot be read.
    """
    taken: dict[str, np.ndarray] = {}
    files: list[str] = []
    for name, (array, look) in MAPS.items():
        saved = array(reconstruction)
        found = {
            path.name: values
            for path in (folder / f"{name}.png", folder / f"{name}.exr")
            if path.exists() and (values := _values(path, name, saved, look)) is not None
        }
        if len(found) > 1:
            raise OutputError(
                f"{folder}: {' and '.join(found)} were both edited; remove the one not to be used"
            )
        for file, values in found.items():
            if name not in _VALUES:
                raise OutputError(
                    f"{folder}: {file} was edited, but it is a result only; edit "
                    f"{', '.join(_VALUES)}, and remove {file}"
                )
            if name != "mask" and stage == 1:
                raise OutputError(
                    f"{folder}: {file} was edited, but stage 1 makes it anew; go on from stage 2 "
                    "or later"
                )
            files.append(file)
            taken[name] = values
    return _changed(reconstruction, taken) if taken else reconstruction, files


def _changed(r: Reconstruction, maps: dict[str, np.ndarray]) -> Reconstruction:
    """`r` with the maps given by name; a mask changes the regions, too."""
    face, photo = r.face, r.photo
    if (mask := maps.pop("mask", None)) is not None:
        share = np.where(mask == face.mask, photo.regions.face, mask)
        photo = replace(photo, regions=painted(photo.regions, share))
        face = replace(face, mask=mask)
    return replace(r, photo=photo, face=replace(face, maps=replace(face.maps, **maps)))


def _values(
    path: Path, name: str, saved: np.ndarray, look: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray | None:
    """The map as it is in the file, or None if that is `saved`."""
    pixels = read_picture(path)
    if pixels.shape[:2] != saved.shape[:2]:
        sizes = [f"{image.shape[1]} x {image.shape[0]}" for image in (pixels, saved)]
        raise OutputError(f"{path}: {sizes[0]} pixels instead of {sizes[1]}; keep the size")
    if saved.ndim == 2:
        pixels = np.median(pixels, axis=2)
    if path.suffix == ".png":
        differ = np.abs(255 * pixels - look(saved)) > 1.01
        pixels = _VALUES.get(name, lambda levels: levels)(pixels)
    else:
        differ = np.abs(pixels - saved) > 1e-3 * np.abs(saved) + 1e-6
    if saved.ndim == 3:
        differ = differ.any(axis=2, keepdims=True)
    if not differ.any():
        return None
    top = 1 if name == "mask" else np.inf
    return np.where(differ, np.clip(pixels, 0, top), saved).astype(np.float32)
