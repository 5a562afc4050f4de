"""What works on this machine, what does not, and how to mend it. Computes; prints nothing.

It needs nothing but Python itself, so that it can tell which package is broken: what is compiled
is tried in processes of their own, the rest is imported where it is looked at.
"""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..errors import UnlitError
from .cost import cores
from .runtime import kernel_cache, llvm_library

# A run at the paper's settings (512 x 512) stays below this.
NEEDED_MEMORY = 3 << 30
# Room for the models in the cache and the wheel they come in.
NEEDED_DISK = 200 << 20
#: The extras of pyproject.toml for users: their modules, and what they are for.
EXTRAS = {
    "evaluate": (("flip_evaluator",), "FLIP in `unlit evaluate`"),
    "usd": (("pxr",), "`unlit export --format usd`"),
    "video": (("av",), "MP4 of `unlit relight`"),
    "batch": (("distributed", "fsspec", "cryptography", "psutil"), "`unlit batch`"),
    "dashboard": (("bokeh",), "`unlit batch --dashboard`"),
    "parquet": (("pyarrow",), "a batch's table as Parquet"),
    "raw": (("rawpy",), "raw files of cameras"),
    "jxl": (("pillow_jxl",), "JPEG XL of 8 bits"),
}
#: What else has compiled parts: the module, its package, and a line that makes it work a little.
_LIBRARIES = {
    "numpy": ("numpy", "numpy.linalg.inv(numpy.eye(3))"),
    "scipy": ("scipy", "import scipy.sparse.linalg, scipy.ndimage"),
    "cv2": ("opencv-python-headless", "cv2.getRotationMatrix2D((1, 1), 30, 1)"),
    "PIL": ("pillow", "from PIL import Image, ImageFont; Image.new('RGB', (8, 8)).resize((4, 4))"),
    "pillow_heif": ("pillow-heif", "pillow_heif.libheif_version()"),
    "skimage": ("scikit-image", "import skimage.measure"),
    "ai_edge_litert": ("ai-edge-litert", "import ai_edge_litert.interpreter"),
    "cholespy": ("cholespy", "cholespy.MatrixType"),
    "msgspec": ("msgspec", "msgspec.json.encode([1])"),
    "platformdirs": ("platformdirs", "platformdirs.user_cache_path"),
    "rich": ("rich", "import rich.progress"),
    "threadpoolctl": ("threadpoolctl", "threadpoolctl.threadpool_info()"),
    "tomli_w": ("tomli-w", "tomli_w.dumps({})"),
}
_PYTHON = ((3, 11), (3, 14))
_PROBE_SECONDS = 120
_LLVM_REMEDY = (
    "on Linux x86-64 `pip install karellen-llvm-core`; elsewhere install your system's LLVM 16 "
    "or newer and set DRJIT_LIBLLVM_PATH to its libLLVM"
)

# Run by another process: a libLLVM that Dr.Jit cannot use may abort instead of raising.
_PROBE = """
import json
from unlit.machine.runtime import mitsuba
mi = mitsuba()
import drjit as dr
x = dr.arange(mi.Float, 5)
assert dr.sum(dr.fma(x, x, dr.minimum(x, 1)))[0] == 34
scene = mi.load_dict({"type": "scene", "shape": {"type": "sphere"}})
assert dr.all(scene.ray_test(mi.Ray3f([0, 0, -5], [0, 0, 1])))
llvm = ".".join(map(str, dr.detail.llvm_version()))
print(json.dumps({"mitsuba": mi.__version__, "drjit": dr.__version__,
                  "variant": mi.variant(), "llvm": llvm}))
"""


# Run by another process with names of modules and lines: one that crashes is the last it named.
_TRY = """
import importlib, os, sys
for name, line in zip(sys.argv[1::2], sys.argv[2::2]):
    print("trying", name, flush=True)
    try:
        exec(line, {name: importlib.import_module(name)})
    except BaseException as error:
        print("failed", type(error).__name__ + ":", " ".join(str(error).split()), flush=True)
    else:
        print("fine", flush=True)
os._exit(0)  # what libraries do on leaving is none of ours
"""


@dataclass(frozen=True)
class Check:
    """One thing looked at.

    ok: whether unlit can work with what was found.  detail: what was found, one line.
    remedy: what to do about it, one line; empty where there is nothing to do.
    """

    name: str
    ok: bool
    detail: str
    remedy: str = ""


def checks() -> list[Check]:
    """Look at Python, the system, the renderer and its back end, the models, memory and disk.

    Takes a few seconds: the renderer is tried in a process of its own. Fetches nothing.
    """
    return [
        *looked("python", lambda: [_python()]),
        Check("system", True, f"{platform.system()} {platform.machine()}"),
        *looked("renderer", _renderer),
        *looked("libraries", _libraries),
        *looked("kernels", lambda: [_kernels()]),
        *looked("models", _models),
        *looked("memory", lambda: [_memory()]),
        *looked("disk", lambda: [_disk()]),
        *looked("cores", lambda: [_cores()]),
        *looked("extras", _extras),
    ]


def report(found: list[Check]) -> str:
    """`found` for people, a line or two each."""
    width = max(len(check.name) for check in found)
    lines: list[str] = []
    for check in found:
        lines.append(f"{'ok ' if check.ok else 'BAD'}  {check.name:<{width}}  {check.detail}")
        if check.remedy:
            lines.append(f"     {'':<{width}}  -> {check.remedy}")
    return "\n".join(lines)


def looked(name: str, look: Callable[[], list[Check]]) -> list[Check]:
    """What `look` finds; where it fails, that is what was found: the other checks go on."""
    try:
        return look()
    except UnlitError as error:  # unlit's own: what is wrong, a colon, what to do
        message, _, remedy = str(error).partition(": ")
        return [Check(name, False, message, remedy)]
    except Exception as error:
        said = " ".join(f"cannot be looked at: {type(error).__name__}: {error}".split())
        return [Check(name, False, said[:300], "mend what that names; if nothing is, report it")]


def _python() -> Check:
    low, high = _PYTHON
    return Check(
        "python",
        low <= sys.version_info[:2] < high,
        f"{platform.python_version()} ({sys.executable})",
        "" if low <= sys.version_info[:2] < high else "use Python 3.11, 3.12 or 3.13",
    )


def _renderer() -> list[Check]:
    """Mitsuba and its back end, tried by tracing a ray."""
    library = llvm_library()
    llvm = str(library) if library else "left to Dr.Jit's own search"
    try:
        probe = subprocess.run(
            [sys.executable, "-c", _PROBE],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_PROBE_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        trouble = f"no answer within {_PROBE_SECONDS} s; LLVM library: {llvm}"
        return [Check("renderer", False, trouble, _LLVM_REMEDY)]
    if probe.returncode != 0:
        return [Check("renderer", False, *_trouble(probe, llvm))]
    found = json.loads(probe.stdout.splitlines()[-1])
    on_gpu = found["variant"].startswith("cuda")
    back_end = "NVIDIA GPU (CUDA)" if on_gpu else f"CPU (LLVM {found['llvm']}: {llvm})"
    return [
        Check("renderer", True, f"Mitsuba {found['mitsuba']}, Dr.Jit {found['drjit']}"),
        Check("back end", True, " ".join(back_end.split())),
    ]


def _trouble(probe: subprocess.CompletedProcess[str], llvm: str) -> tuple[str, str]:
    """Detail and remedy of a probe that failed."""
    lines = [line.strip() for line in probe.stderr.splitlines() if line.strip()]
    last = lines[-1] if lines else "no message"
    # A negative code is the number of the signal that ended the process (POSIX).
    if probe.returncode < 0:
        said = next((line for line in lines if line.startswith("LLVM ERROR")), last)
        detail = f"the LLVM library {llvm} ends the process (signal {-probe.returncode}): {said}"
        return detail, _LLVM_REMEDY
    if "MachineError: " in last:  # unlit's own: what is wrong, a colon, what to do
        detail, _, remedy = last.partition("MachineError: ")[2].partition(": ")
        return f"{detail}; LLVM library: {llvm}", remedy
    if "ModuleNotFoundError" in last or "ImportError" in last:
        return last, "install unlit with its dependencies: `pip install unlit`"
    return f"{last}; LLVM library: {llvm}", _LLVM_REMEDY


def _libraries() -> list[Check]:
    """Everything else that is imported, each tried where a crash does no harm."""
    left, broken = list(_LIBRARIES), list[Check]()
    while left:
        arguments = [word for name in left for word in (name, _LIBRARIES[name][1])]
        ran = subprocess.run(
            [sys.executable, "-c", _TRY, *arguments],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_PROBE_SECONDS,
            check=False,
        )
        name = ""
        for line in ran.stdout.splitlines():
            what, _, rest = line.partition(" ")
            if what == "trying":
                name = rest
                left.remove(name)
            elif what == "failed":
                broken.append(_broken(name, rest[:300]))
        if ran.returncode != 0:
            why = f"signal {-ran.returncode}" if ran.returncode < 0 else f"code {ran.returncode}"
            broken.append(_broken(name, f"ends the process ({why})"))
            if not name:
                break
    return broken or [Check("libraries", True, ", ".join(_LIBRARIES))]


def _broken(name: str, why: str) -> Check:
    package = _LIBRARIES[name][0] if name else "unlit"
    remedy = f"`pip install --force-reinstall {package}`"
    return Check(f"library {name}".strip(), False, f"{package}: {why}", remedy)


def _kernels() -> Check:
    """Without a place for them all else works, only slower."""
    folder = kernel_cache() if os.name == "posix" else Path("in the user's own folder")
    if folder is not None:
        return Check("kernels", True, f"kept in {folder}")
    remedy = "to keep them, set DRJIT_CACHE_DIR to a folder that can be written, on a local disk"
    return Check("kernels", True, "not kept: every run compiles them anew, some seconds", remedy)


def _cores() -> Check:
    return Check("cores", True, f"{cores()} usable{_vectors()}")


def _vectors() -> str:
    """What the processor computes with, where Linux tells; LLVM makes use of the widest."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        flags = next(line for line in lines if line.startswith("flags")).split()
    except (OSError, StopIteration):
        return ""
    widest = next((n for n in ("avx512vl", "avx2", "avx") if n in flags), None)
    return f", {widest.upper()}" if widest else ", without AVX: slower, and never tried"


def _models() -> list[Check]:
    from . import assets

    found: list[Check] = []
    for status in assets.statuses():
        if status.asset.command != "reconstruct":
            continue
        ok = status.problem is None
        detail = f"verified: {status.path}" if ok else str(status.problem)
        remedy = (
            f"`unlit models fetch` gets it ({status.asset.size / 1e6:.0f} MB), as does the first "
            f"run; or put it into {assets.cache_folder()}"
        )
        found.append(Check(f"model {status.asset.name}", ok, detail, "" if ok else remedy))
    return found


def _extras() -> list[Check]:
    """What `pip install 'unlit[...]'` adds; all else works without."""
    found: list[Check] = []
    for name, (modules, purpose) in EXTRAS.items():
        missing = [module for module in modules if importlib.util.find_spec(module) is None]
        state = f"not installed ({', '.join(missing)})" if missing else "installed"
        remedy = f"for it, `pip install 'unlit[{name}]'`" if missing else ""
        found.append(Check(f"extra {name}", True, f"{state}: {purpose}", remedy))
    return found


def _memory() -> Check:
    free = _free_memory()
    if free is None:
        return Check("memory", True, f"not known; {NEEDED_MEMORY >> 30} GB are enough")
    ok = free >= NEEDED_MEMORY
    return Check(
        "memory",
        ok,
        f"{free / (1 << 30):.1f} GB free",
        ""
        if ok
        else f"{NEEDED_MEMORY >> 30} GB may be needed: close programs or use the draft preset",
    )


def _free_memory() -> int | None:
    """Bytes that can be had without swapping, within the container's limit where there is one."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        kilobytes = next(line for line in lines if line.startswith("MemAvailable:")).split()[1]
        free = int(kilobytes) << 10
    except (OSError, StopIteration, ValueError, IndexError):
        return None
    group = Path("/sys/fs/cgroup")
    try:
        limit = int((group / "memory.max").read_text())
        used = int((group / "memory.current").read_text())
        # Files that the kernel holds in memory count as used, but give way.
        stat = dict(line.split() for line in (group / "memory.stat").read_text().splitlines())
        used -= int(stat.get("inactive_file", 0))
    except (OSError, ValueError):  # no limit is spelt "max"
        return free
    return min(free, limit - used)


def _disk() -> Check:
    from . import assets

    folder = assets.cache_folder()
    existing = next(place for place in (folder, *folder.parents) if place.exists())
    free = shutil.disk_usage(existing).free
    writable = os.access(existing, os.W_OK)
    detail = f"{free / (1 << 30):.1f} GB free for {folder}"
    if not writable:
        remedy = f"make {existing} writable, or put the models elsewhere and name the folder in "
        return Check("disk", False, f"{existing} is not writable", remedy + assets.FOLDER_VARIABLE)
    ok = free >= NEEDED_DISK
    return Check("disk", ok, detail, "" if ok else f"free {NEEDED_DISK >> 20} MB there")
