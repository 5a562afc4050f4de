"""Choose and initialise Dr.Jit's back end once, before Mitsuba is first imported.

`cuda_ad_rgb` where a usable GPU answers, else `llvm_ad_rgb`. LLVM is loaded by Dr.Jit at run
time from `DRJIT_LIBLLVM_PATH`; the wheel `karellen-llvm-core` carries it on Linux x86-64.
"""

from __future__ import annotations

import contextlib
import functools
import os
import re
from collections.abc import Generator
from pathlib import Path
from types import ModuleType

from ..errors import MachineError

VARIANT_VARIABLE = "UNLIT_VARIANT"
_KERNELS_VARIABLE = "DRJIT_CACHE_DIR"
_LLVM_PACKAGE = "karellen-llvm-core"
_LLVM_HELP = (
    "no usable LLVM library was found: install one with `pip install karellen-llvm-core` "
    "(Linux x86-64) or your system's LLVM 16 or newer, and set DRJIT_LIBLLVM_PATH to its libLLVM"
)


def llvm_library() -> Path | None:
    """Path of the libLLVM to load: the user's own choice first, then the wheel's, else None.

    The wheel's own list of files tells where pip has put it: into a virtual environment, the
    user's folder (--user), a folder of its own (--target), or /usr/local, as Debian's does for
    root. None leaves the search to Dr.Jit, which looks in the system's usual places.
    """
    chosen = os.environ.get("DRJIT_LIBLLVM_PATH")
    if chosen:
        return Path(chosen)
    import importlib.metadata

    try:
        files = importlib.metadata.files(_LLVM_PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:
        return None
    named = (file for file in files if re.fullmatch(r"libLLVM(-\d+)?\.so(\.[\d.]+)?", file.name))
    found = {Path(str(file.locate())).resolve() for file in named}
    return max((path for path in found if path.is_file()), default=None)


def prepare() -> None:
    """Tell Dr.Jit which libLLVM to load and where kernels are kept, before anything imports it."""
    library = llvm_library()
    if library is not None:
        os.environ["DRJIT_LIBLLVM_PATH"] = str(library)
    posix = os.name == "posix"  # elsewhere Dr.Jit has a place of its own
    if posix and _KERNELS_VARIABLE not in os.environ and (folder := kernel_cache()) is not None:
        os.environ[_KERNELS_VARIABLE] = str(folder)


def kernel_cache() -> Path | None:
    """Where compiled kernels are kept from run to run; None where no folder can be written to.

    The user's own choice; else Dr.Jit's folder in the home; else, as in containers whose home is
    read-only, one in XDG_CACHE_HOME.
    """
    if chosen := os.environ.get(_KERNELS_VARIABLE):
        places = [Path(chosen)]
    else:
        kept = {"HOME": ".drjit", "XDG_CACHE_HOME": "unlit/kernels"}
        named = ((os.environ.get(variable), name) for variable, name in kept.items())
        places = [Path(folder, name) for folder, name in named if folder]
    return next((place for place in places if _writable(place)), None)


def _writable(folder: Path) -> bool:
    """Whether `folder` can be written to, or made."""
    there = next((place for place in (folder, *folder.parents) if place.exists()), None)
    return there is not None and there.is_dir() and os.access(there, os.W_OK | os.X_OK)


@functools.cache
def mitsuba() -> ModuleType:
    """Import Mitsuba with a variant set, and return the module.

    The environment variable `UNLIT_VARIANT` overrides the choice. Raises MachineError when
    neither back end can be used.
    """
    import drjit as dr
    import mitsuba as mi

    wanted = os.environ.get(VARIANT_VARIABLE)
    known = ("cuda_ad_rgb", "llvm_ad_rgb")
    if wanted is not None and wanted not in known:
        raise MachineError(f"{VARIANT_VARIABLE}={wanted}: choose one of {', '.join(known)}")
    backends = {"cuda_ad_rgb": dr.JitBackend.CUDA, "llvm_ad_rgb": dr.JitBackend.LLVM}
    version = tuple(map(int, dr.detail.llvm_version()))  # pyright: ignore
    if (0,) < version < (16,):
        raise MachineError(
            f"LLVM {version[0]} was loaded, which crashes on these kernels: "
            "import unlit before drjit and mitsuba, or set DRJIT_LIBLLVM_PATH to LLVM 16 or newer"
        )
    for variant in (wanted,) if wanted else known:
        if dr.has_backend(backends[variant]):
            mi.set_variant(variant)
            mi.set_log_level(mi.LogLevel.Error)
            return mi
    raise MachineError(_LLVM_HELP)


@contextlib.contextmanager
def second_thread() -> Generator[None]:
    """Let Dr.Jit have two threads at least, as it has not on one core or in a worker of a batch.

    Mitsuba's OpenEXR hands its work to Dr.Jit's pool and waits, without lending a hand: with the
    caller's thread alone it would wait for ever.
    """
    import drjit as dr

    threads = dr.thread_count()
    if threads < 2:
        dr.set_thread_count(2)
    try:
        yield
    finally:
        if threads < 2:
            dr.set_thread_count(threads)
