"""Choose and initialise Dr.Jit's back end once, before Mitsuba is first imported.

`cuda_ad_rgb` where a usable GPU answers, else `llvm_ad_rgb`. LLVM is loaded by Dr.Jit at run
time from `DRJIT_LIBLLVM_PATH`; the wheel `karellen-llvm-core` carries it on Linux x86-64.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from collections.abc import Generator
from pathlib import Path
from types import ModuleType

from ..errors import MachineError

VARIANT_VARIABLE = "UNLIT_VARIANT"
_LLVM_HELP = (
    "no usable LLVM library was found: install one with `pip install karellen-llvm-core` "
    "(Linux x86-64) or your system's LLVM 16 or newer, and set DRJIT_LIBLLVM_PATH to its libLLVM"
)


def llvm_library() -> Path | None:
    """Path of the libLLVM to load: the user's own choice first, then the wheel's, else None.

    None leaves the search to Dr.Jit, which looks in the system's usual places.
    """
    chosen = os.environ.get("DRJIT_LIBLLVM_PATH")
    if chosen:
        return Path(chosen)
    for prefix in (sys.prefix, sys.base_prefix):
        found = sorted(Path(prefix, "lib").glob("libLLVM.so.*")) or sorted(
            Path(prefix, "lib").glob("libLLVM*.so")
        )
        if found:
            return found[-1]
    return None


def point_to_llvm() -> None:
    """Tell Dr.Jit which libLLVM to load; has to happen before anything imports drjit."""
    library = llvm_library()
    if library is not None:
        os.environ["DRJIT_LIBLLVM_PATH"] = str(library)


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
