"""The relit face in place in its photo."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy import ndimage

from ..color import encode_srgb
from ..errors import PhotoError
from ..face.reconstruction import Reconstruction
from ..output.images import encoded
from ..photo.photo import Photo
from ..scene.maps import fill

#: Greatest root-mean-square difference, sRGB-encoded, of the photo's crop from the one that the
#: result was made from: a photo that was only saved again as a JPEG is far below it.
_SAME = 0.05
#: Width of the fade at the rim of the face, over the square root of the face's area: wide enough
#: that a dark face and a bright neck do not meet in a line.
_FADE = 0.1


def feathered(mask: np.ndarray) -> np.ndarray:
    """`mask` (S, S) faded to 0 towards the outline of the face and the crop's border, float32.

    Holes and slots in it (eyes, glasses) keep their sharp rims: the light around them is the same.
    """
    inside = mask > 0.5
    width = max(round(_FADE * float(np.sqrt(inside.sum()))), 1)
    room = np.pad(inside, width + 1)
    closed = _depth(_depth(~room) <= width) > width
    outline = np.asarray(ndimage.binary_fill_holes(closed | room))[width:-width, width:-width]
    depth = np.minimum(_depth(outline)[1:-1, 1:-1] / width, 1)
    return (mask * depth**2 * (3 - 2 * depth)).astype(np.float32)


def _depth(region: np.ndarray) -> np.ndarray:
    """Distance in pixels of each pixel of `region` from what is outside of it; 0 there."""
    return np.asarray(ndimage.distance_transform_edt(region))


class Backdrop:
    """A photo that relit faces are put into. Raises PhotoError if it is not the result's own."""

    def __init__(self, reconstruction: Reconstruction, photo: Photo) -> None:
        self.face, self.photo = reconstruction, photo
        crop = np.maximum(reconstruction.photo.crop.image(photo.pixels), 0)
        difference = np.clip(encode_srgb(crop), 0, 1)
        difference -= np.clip(encode_srgb(reconstruction.photo.image), 0, 1)
        error = float(np.sqrt(np.mean(difference**2)))
        if error > _SAME:
            height, width = photo.pixels.shape[:2]
            raise PhotoError(
                f"{photo.source}: not the picture that this result was made from "
                f"({reconstruction.photo.name}): at {width} x {height} pixels its crop differs by "
                f"{error:.2f}; give that photo, at its own size and not edited"
            )

    def __call__(self, relit: np.ndarray) -> np.ndarray:
        """The photo (H, W, 3), linear sRGB, with `relit` (S, S, 3) blended in by `feathered`.

        Where the mask is 0 the photo's values come back to the bit.
        """
        # Beyond the mask the relit face is black, which resampling must not draw in at its rim.
        return self.face.photo.crop.paste(
            fill(relit, self.face.face.mask > 0), self.photo.pixels, self._weight
        )

    @cached_property
    def _weight(self) -> np.ndarray:
        return feathered(self.face.face.mask)

    @cached_property
    def _encoded(self) -> np.ndarray:
        return self.photo.encoded8()

    def encoded8(self, relit: np.ndarray) -> np.ndarray:
        """The same as (H, W, 3) uint8 sRGB."""
        linear = self(relit)
        changed = (linear != self.photo.pixels).any(axis=-1)
        out = self._encoded.copy()
        out[changed] = encoded(linear[changed])
        return out
