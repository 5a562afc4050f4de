"""One photo of a face in; mesh, albedo, normals and light out.

    import unlit

    face = unlit.reconstruct("portrait.jpg")         # minutes; a Reconstruction of NumPy arrays
    face.save("portrait")                            # maps, mesh, light, montage.png
    picture = face.relight(unlit.lights.flash())     # (S, S, 3) linear sRGB
    face = unlit.load("portrait")                    # the same again, to the bit

Names are imported when first used, so that `import unlit` costs nothing: the renderer alone takes
a second to load.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from .machine import runtime as _runtime

# Before anything imports drjit, which looks for LLVM when it is loaded.
_runtime.point_to_llvm()

if TYPE_CHECKING:
    from .errors import UnlitError
    from .face.reconstruction import Reconstruction
    from .output import load
    from .photo.photo import Photo, read_photo
    from .pipeline.chain import reconstruct
    from .scene import light as lights
    from .settings.settings import PRESETS, Settings, override

    __version__: str

__all__ = [
    "PRESETS",
    "Photo",
    "Reconstruction",
    "Settings",
    "UnlitError",
    "__version__",
    "lights",
    "load",
    "override",
    "read_photo",
    "reconstruct",
]

_MODULE = {
    "PRESETS": "settings.settings",
    "Photo": "photo.photo",
    "Reconstruction": "face.reconstruction",
    "Settings": "settings.settings",
    "UnlitError": "errors",
    "load": "output",
    "override": "settings.settings",
    "read_photo": "photo.photo",
    "reconstruct": "pipeline.chain",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("unlit")
    elif name == "lights":
        value = importlib.import_module(".scene.light", __name__)
    elif name in _MODULE:
        value = getattr(importlib.import_module(f".{_MODULE[name]}", __name__), name)
    else:
        raise AttributeError(f"module 'unlit' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
