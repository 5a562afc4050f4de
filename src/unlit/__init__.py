"""One photo of a face in; mesh, albedo, normals and light out.

    import unlit

    result = unlit.reconstruct("portrait.jpg")          # a minute; NumPy arrays, linear sRGB
    result.face.maps.diffuse_albedo                     # what belongs to the person
    result.light                                        # and to the moment of the photo
    picture = result.relight(unlit.lights.flash())      # (512, 512, 3), under another light
    result.save("portrait")                             # maps, mesh, light, montage.png
    result = unlit.load("portrait")                     # the same again, to the bit

Names are imported when first used, so that `import unlit` costs nothing: the renderer alone takes
a second to load.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from .machine import runtime

# Before anything imports drjit, which looks for LLVM and its cache when it is loaded.
runtime.prepare()

if TYPE_CHECKING:
    from .api import Result, batch, export, load, reconstruct, relight, resume, save
    from .errors import (
        FaceError,
        MachineError,
        ModelError,
        OutputError,
        PhotoError,
        PictureError,
        SettingsError,
        SubjectError,
        UnlitError,
    )
    from .photo.photo import Photo, read_photo
    from .relighting import lights
    from .settings.settings import PRESETS, Settings, override

    __version__: str

__all__ = [
    "PRESETS",
    "FaceError",
    "MachineError",
    "ModelError",
    "OutputError",
    "Photo",
    "PhotoError",
    "PictureError",
    "Result",
    "Settings",
    "SettingsError",
    "SubjectError",
    "UnlitError",
    "__version__",
    "batch",
    "export",
    "lights",
    "load",
    "override",
    "read_photo",
    "reconstruct",
    "relight",
    "resume",
    "save",
]

_MODULES = {
    "api": ("Result", "batch", "export", "load", "reconstruct", "relight", "resume", "save"),
    "errors": tuple(name for name in __all__ if name.endswith("Error")),
    "photo.photo": ("Photo", "read_photo"),
    "settings.settings": ("PRESETS", "Settings", "override"),
}
_MODULE = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("unlit")
    elif name == "lights":
        value = importlib.import_module(".relighting.lights", __name__)
    elif name in _MODULE:
        value = getattr(importlib.import_module(f".{_MODULE[name]}", __name__), name)
    else:
        raise AttributeError(f"module 'unlit' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
