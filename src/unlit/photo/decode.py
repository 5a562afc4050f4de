"""A file's bytes to its stored values, and to what the file says of their colours.

Pillow decodes JPEG, PNG, TIFF, WebP and AVIF, pillow-heif HEIC, OpenCV what has more than 8 bits,
LibRaw the raw files of cameras (raw.py), pillow-jxl-plugin JPEG XL (jxl.py).
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pillow_heif
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import TiffImageFile

from ..errors import PhotoError
from .colour_space import ADOBE_RGB, ColourSpace, coded_space
from .decoded import Decoded, check_size
from .jxl import decode_jxl, is_jxl
from .png_colours import png_code_points, png_gamma_space
from .raw import decode_raw, is_raw
from .tiff_colours import tiff_space

_FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "AVIF")
#: ISO/IEC 23008-12 and the AVIF specification; a file of the general ones may hold either codec.
_GENERAL_BRANDS = {b"mif1", b"msf1"}
_HEVC_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx"}
_AV1_BRANDS = {b"avif", b"avis"}


def decode(data: bytes, path: Path) -> Decoded:
    """Decode a file. path: its name, for messages.

    Raises PhotoError for a size out of bounds, before the pixels are decoded, and for pixels of a
    type that is not supported; ProfileError for colours that are not; and on damaged data whatever
    the decoders raise.
    """
    if is_raw(data, path):
        return decode_raw(data, path)
    if is_jxl(data):
        return decode_jxl(data, path)
    codec = _container_codec(data)
    if codec == "hevc":
        return _decode_heif(data, path)
    return _decode(data, path, container=codec == "av1")


def _container_codec(data: bytes) -> str | None:
    """ "hevc" or "av1" for the containers of HEIC and AVIF, by the brands at their beginning."""
    if data[4:8] != b"ftyp":
        return None
    size = min(int.from_bytes(data[:4]), 256)
    brands = [data[8:12], *(data[at : at + 4] for at in range(16, size, 4))]
    if brands[0] in _AV1_BRANDS or (
        brands[0] in _GENERAL_BRANDS and _AV1_BRANDS & {*brands} and not _HEVC_BRANDS & {*brands}
    ):
        return "av1"
    return "hevc" if brands[0] in _HEVC_BRANDS | _GENERAL_BRANDS else None


def _open_container(data: bytes) -> Any:
    """What libheif tells of a HEIC or AVIF file; pixels are decoded when they are asked for."""
    return pillow_heif.open_heif(data, convert_hdr_to_8bit=False)  # pyright: ignore[reportUnknownMemberType]


def _container_space(info: Mapping[str, Any]) -> ColourSpace | None:
    """The colour space of the container's code points (nclx), which an ICC profile goes before.

    Its range is of the stored YCbCr; decoders return RGB of the full one.
    """
    nclx: dict[str, int] = info.get("nclx_profile") or {}
    if not nclx or info.get("icc_profile"):
        return None
    return coded_space(int(nclx["color_primaries"]), int(nclx["transfer_characteristics"]))


def _decode_heif(data: bytes, path: Path) -> Decoded:
    file = _open_container(data)
    info: dict[str, Any] = file.info
    width, height = file.size
    check_size(width, height, path)
    space = _container_space(info)
    pixels = np.asarray(file)
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    white = 255
    if pixels.dtype == np.uint16:
        # 10 and 12 bits arrive in the upper bits of 16.
        spare = 16 - int(info.get("bit_depth", 16))
        white = 0xFFFF >> spare << spare
    alpha = pixels[..., -1] if pixels.shape[-1] in (2, 4) else None
    exif = Image.Exif()
    if info.get("exif"):
        exif.load(info["exif"])
    # The turn is part of the format and has been applied; the EXIF entry only repeats it.
    colours = pixels[..., : 1 if pixels.shape[-1] < 3 else 3]
    icc = info.get("icc_profile")
    return Decoded(colours, alpha, white, icc, space, exif, orientation=1)


def _decode(data: bytes, path: Path, container: bool) -> Decoded:
    """container: whether it is a HEIF container, as AVIF's."""
    with Image.open(io.BytesIO(data), formats=_FORMATS) as image:
        check_size(*image.size, path)
        exif = image.getexif()
        # Both decoders turn a TIFF picture upright themselves, and no other format.
        turned = image.format == "TIFF"
        orientation = 1 if turned else exif.get(ExifTags.Base.Orientation, 1)
        # Pillow keeps 8 of 16 bits, but unlike OpenCV it tells a damaged file from a good one.
        image.load()
        icc = image.info.get("icc_profile")
        space = None
        if container:
            # Pillow tells neither bits nor code points of AVIF.
            info = _open_container(data).info
            bits, space = int(info.get("bit_depth", 8)), _container_space(info)
        else:
            bits = _bits(image, data)
        if image.format == "PNG":
            space = png_code_points(data)
            icc = None if space else icc
            said: dict[Any, Any] = image.info
            space = space or (None if icc else png_gamma_space(said))
        if isinstance(image, TiffImageFile) and not icc:
            entries: Any = image.tag_v2
            space = tiff_space(entries)
        if icc is None and space is None:
            space = _exif_space(exif)
        deep = bits == 16 or (container and bits > 8)
        odd = image.mode == "CMYK" if deep else image.mode.startswith("I;16")
        if image.mode in ("F", "I", "LAB", "HSV") or odd:
            raise PhotoError(
                f"{path}: pixels of a type that is not supported ({image.mode}); "
                "save it as 8- or 16-bit RGB or grey"
            )
        pixels, alpha = _decode_deep(data) if deep else _decode_8(image)
        white = (1 << bits) - 1 if deep else 0xFF
        return Decoded(pixels, alpha, white, icc, space, exif, int(orientation))


def _exif_space(exif: Image.Exif) -> ColourSpace | None:
    """Adobe RGB as cameras mark it without a profile (DCF 2.0, the interoperability index)."""
    index: Any = exif.get_ifd(ExifTags.IFD.Interop).get(ExifTags.Interop.InteropIndex)
    text = index.decode("latin-1") if isinstance(index, bytes) else index
    return ADOBE_RGB if isinstance(text, str) and text.rstrip("\0") == "R03" else None


def _bits(image: Image.Image, data: bytes) -> int:
    """Bits a channel in the file, which Pillow's mode does not tell."""
    if image.format == "PNG":
        return data[24]
    if isinstance(image, TiffImageFile):
        return max(image.tag_v2.get(ExifTags.Base.BitsPerSample, (8,)))
    return 8


def _decode_8(image: Image.Image) -> tuple[np.ndarray, np.ndarray | None]:
    if image.mode == "1":
        image = image.convert("L")
    elif image.has_transparency_data:
        image = image.convert("RGBA")
    elif image.mode not in ("L", "CMYK"):
        image = image.convert("RGB")
    pixels = np.asarray(image)
    if image.mode == "RGBA":
        return pixels[..., :3], pixels[..., 3]
    return (pixels[..., None] if pixels.ndim == 2 else pixels), None


def _decode_deep(data: bytes) -> tuple[np.ndarray, np.ndarray | None]:
    # IMREAD_UNCHANGED keeps all bits and alpha, and leaves the EXIF orientation to us.
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype != np.uint16:
        raise ValueError("the decoder of more than 8 bits refuses it")
    if pixels.ndim == 2:
        return pixels[..., None], None
    return pixels[..., 2::-1], (pixels[..., 3] if pixels.shape[2] == 4 else None)
