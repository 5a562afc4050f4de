"""Pictures as their photo's file was: its ICC profile, its EXIF block, and its depth.

The pixels are upright, so the EXIF block says so. A photo whose colours were read in another way
than by a profile of curves and a matrix comes back as sRGB.
"""

from __future__ import annotations

import io
import struct
import zlib
from functools import cached_property

import cv2
import numpy as np
from PIL import ExifTags, Image

from ..color import encode_srgb
from ..photo.icc import Profile, ProfileError, matrix_profile
from ..photo.photo import FileTags

_LEVELS = 1 << 16
_SRGB = 1  # of the EXIF entry ColorSpace
_QUALITY = 95
_JPEG_EXIF = 65533  # bytes of a JPEG file's EXIF block at most
PLAIN = FileTags(None, b"", False)


class StillEncoder:
    """Linear pictures to PNG and JPEG files; tags: of the photo they are made from."""

    def __init__(self, tags: FileTags | None) -> None:
        self.tags = tags or PLAIN
        self.profile: Profile | None = None
        if self.tags.icc:
            try:
                self.profile = matrix_profile(self.tags.icc, _LEVELS)
            except ProfileError:
                self.profile = None
            if self.profile is not None and len(self.profile.curves) != 3:  # of grey
                self.profile = None

    def encoded(self, linear: np.ndarray) -> np.ndarray:
        """Values in [0, 1] of linear sRGB (..., 3), clipped, as the profile encodes them."""
        if self.profile is None:
            return np.clip(np.nan_to_num(encode_srgb(linear)), 0, 1)
        if self.profile.matrix is not None:
            inverse = np.linalg.inv(self.profile.matrix.astype(np.float64))
            linear = linear @ inverse.T.astype(np.float32)
        levels = np.linspace(0, 1, _LEVELS)
        curves = np.maximum.accumulate(self.profile.curves, axis=1)
        channels = [np.interp(linear[..., c], curves[c], levels) for c in range(3)]
        return np.stack(channels, axis=-1)

    def png(self, linear: np.ndarray) -> bytes:
        """A PNG file of linear sRGB (H, W, 3), with 16 bits a channel if the photo has over 8."""
        if not self.tags.deep:
            return self._saved(linear, "PNG")
        values = np.rint(65535 * self.encoded(linear)).astype(np.uint16)
        # Pillow writes no colours of 16 bits.
        _, data = cv2.imencode(".png", np.ascontiguousarray(values[..., ::-1]))
        extra = _chunk(b"eXIf", self._exif.removeprefix(b"Exif\0\0")) if self._exif else b""
        if self._icc:
            extra = _chunk(b"iCCP", b"icc\0\0" + zlib.compress(self._icc)) + extra
        header = 8 + 25  # the signature, and the chunk IHDR, which comes first
        content = data.tobytes()
        return content[:header] + extra + content[header:]

    def jpeg(self, linear: np.ndarray) -> bytes:
        """A JPEG file of linear sRGB (H, W, 3)."""
        return self._saved(linear, "JPEG", quality=_QUALITY, subsampling=0)

    def warning(self, suffix: str) -> str | None:
        """One sentence where a file of that ending cannot carry on all that the photo's does."""
        if suffix not in (".jpg", ".jpeg") or len(self._exif) <= _JPEG_EXIF:
            return None
        return (
            f"the photo's EXIF block, {len(self._exif) >> 10} kB, is left out: a JPEG file holds "
            f"{_JPEG_EXIF >> 10}; write a .png to keep it"
        )

    def _saved(self, linear: np.ndarray, kind: str, **options: int) -> bytes:
        pixels = np.rint(255 * self.encoded(linear)).astype(np.uint8)
        stream = io.BytesIO()
        # An empty profile is left out, as is an empty EXIF block.
        exif = self._exif if kind != "JPEG" or len(self._exif) <= _JPEG_EXIF else b""
        tags = {"icc_profile": self._icc, "exif": exif}
        given = {name: value for name, value in tags.items() if value}
        Image.fromarray(pixels).save(stream, kind, **given, **options)
        return stream.getvalue()

    @property
    def _icc(self) -> bytes | None:
        return self.tags.icc if self.profile is not None else None

    @cached_property
    def _exif(self) -> bytes:
        """The photo's EXIF block for upright pixels; one that said Adobe RGB says sRGB."""
        if not self.tags.exif:
            return b""
        exif = Image.Exif()
        exif.load(self.tags.exif)
        exif[ExifTags.Base.Orientation] = 1
        if self._icc is None:
            exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.ColorSpace] = _SRGB
            exif.get_ifd(ExifTags.IFD.Interop).clear()
        return exif.tobytes()


def _chunk(kind: bytes, content: bytes) -> bytes:
    """A chunk of a PNG file."""
    check = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", check)
