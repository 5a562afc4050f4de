"""The folder of results: written whole or not at all, loaded again to the bit."""

from ..storage.folder import CHECKPOINT, REPORT, STAGES, reserve, write_one
from .edits import edited
from .export import FORMATS, export
from .load import load
from .montage import montage, montage_png, preview_png
from .save import FILES, RESULT_FILES, needed_bytes, save

__all__ = [
    "CHECKPOINT",
    "FILES",
    "FORMATS",
    "REPORT",
    "RESULT_FILES",
    "STAGES",
    "edited",
    "export",
    "load",
    "montage",
    "montage_png",
    "needed_bytes",
    "preview_png",
    "reserve",
    "save",
    "write_one",
]
