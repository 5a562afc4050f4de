"""The relit face in place in its photo."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..color import encode_srgb
from ..errors import PhotoError
from ..output.images import encoded
from ..photo import Photo
from ..reconstruction import Reconstruction
from ..scene.maps import fill

#: Greatest root-mean-square difference, sRGB-encoded, of the photo's crop from the one that the
#: result was made from: a photo that was only saved again as a JPEG is far below it.
_SAME = 0.05


class Backdrop:
    """A photo that relit faces are put into. Raises PhotoError if it is not the result's own."""

    def __init__(self, reconstruction: Reconstruction, photo: Photo) -> None:
        self.face, self.photo = reconstruction, photo
        crop = np.maximum(reconstruction.crop.image(photo.pixels), 0)
        difference = np.clip(encode_srgb(crop), 0, 1)
        difference -= np.clip(encode_srgb(reconstruction.image), 0, 1)
        error = float(np.sqrt(np.mean(difference**2)))
        if error > _SAME:
            height, width = photo.pixels.shape[:2]
            raise PhotoError(
                f"{photo.source}: not the picture that this result was made from "
                f"({reconstruction.photo_name}): at {width} x {height} pixels its crop differs by "
                f"{error:.2f}; give that photo, at its own size and not edited"
            )

    def __call__(self, relit: np.ndarray) -> np.ndarray:
        """The photo (H, W, 3), linear sRGB, with `relit` (S, S, 3) blended in by the soft mask.

        Where the mask is 0 the photo's values come back to the bit.
        """
        mask = self.face.mask
        # Beyond the mask the relit face is black, which resampling must not draw in at its rim.
        return self.face.crop.paste(fill(relit, mask > 0), self.photo.pixels, mask)

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
