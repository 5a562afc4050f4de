"""What a result was made from: kept beside it, and compared before it is used again."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from .keys import key


@dataclass(frozen=True)
class Identity:
    """What unlit knows to decide a result; on one machine, equal ones give the same bits.

    photo: name of the picture's file. content: key of the file, or of its pixels and what else
    is known of it. face: which one was chosen. mask: key of the user's mask, "" without one.
    settings: as text, by dotted name. head: key of the head model. release, code: version of
    unlit, and key of its source. renderer: Mitsuba's variant and version.
    """

    photo: str
    content: str
    face: str
    mask: str
    settings: dict[str, str]
    head: str
    release: str
    code: str
    renderer: str

    @property
    def key(self) -> str:
        """16 hexadecimal digits of all of it."""
        return key(asdict(self))

    def difference(self, now: Identity) -> str:
        """What this one, of an earlier result, has that `now` has not, in words; "" if nothing."""
        if (self.photo, self.content) != (now.photo, now.content):
            named = (
                f"({self.photo}, not {now.photo})" if self.photo != now.photo else "of that name"
            )
            return f"another photo {named}"
        if self.release != now.release:
            return f"another version of unlit ({self.release}, not {now.release})"
        if self.code != now.code:
            return "another version of unlit (other code)"
        if self.renderer != now.renderer:
            return f"another renderer ({self.renderer}, not {now.renderer})"
        if self.face != now.face:
            return f"another face ({self.face}, not {now.face})"
        if self.mask != now.mask:
            return "another mask"
        was, new = self.settings, now.settings
        if names := [name for name in sorted(was | new) if was.get(name) != new.get(name)]:
            shown = ", ".join(f"{name} {was.get(name)}, not {new.get(name)}" for name in names[:3])
            return f"other settings ({shown}{' and more' if len(names) > 3 else ''})"
        return "another head model" if self.head != now.head else ""
