"""The parser of arguments: what argparse passes over is refused, what is misspelt gets a hint."""

from __future__ import annotations

import argparse
import difflib
import re
import sys
from collections.abc import Collection, Sequence
from typing import Any, NoReturn

from ..errors import SettingsError


class _Once(argparse.Action):
    """Stores the value of an option, and refuses a second one: argparse would take the last."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        if option_string is not None:
            given = vars(namespace).setdefault("given", [])
            if self.dest in given:
                raise argparse.ArgumentError(self, "given twice; give it once")
            given.append(self.dest)
        setattr(namespace, self.dest, values)


class _Flag(_Once):
    """The same for an option without a value."""

    def __init__(self, option_strings: Sequence[str], dest: str, **words: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, default=False, **words)

    def __call__(self, *arguments: Any) -> None:
        parser, namespace, _, option = arguments
        super().__call__(parser, namespace, True, option)


class Parser(argparse.ArgumentParser):
    """A parser whose options count once, and which knows what a misspelt word was to be.

    commands: words that may come first, if it is the parser of the whole line.
    """

    def __init__(self, *arguments: Any, commands: Collection[str] = (), **words: Any) -> None:
        super().__init__(*arguments, **words)
        self.commands = commands
        self._said: list[str] = []
        for name in (None, "store"):
            self.register("action", name, _Once)
        self.register("action", "store_true", _Flag)

    def parse_known_args(  # pyright: ignore[reportIncompatibleMethodOverride] (overloads)
        self, args: Any = None, namespace: Any = None
    ) -> Any:
        """As argparse does. An unknown option is the fault of the command's own parser."""
        self._said = list(sys.argv[1:] if args is None else args)
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return found, unknown

    def error(self, message: str) -> NoReturn:
        """Print the usage; raise SettingsError with `message` and what may have been meant."""
        self.print_usage(sys.stderr)
        raise SettingsError(message + self._hint())

    def _hint(self) -> str:
        """Options that are none, and a first word that is none, with what is like them."""
        known = [*re.findall(r"--[\w-]+", self.format_usage()), "--help"]
        for word in self._said:
            name = word.partition("=")[0]
            if name.startswith("--") and not any(option.startswith(name) for option in known):
                return _near(name, known)
            if self.commands and not word.startswith("-"):
                return "" if word in self.commands else _near(word, self.commands)
        return ""


def _near(word: str, known: Collection[str]) -> str:
    near = difflib.get_close_matches(word, known, 1)
    return f"; {word}: did you mean {near[0]}?" if near else ""


def user_path(text: str) -> str:
    """The type of an argument that is a file or folder: "~" is the user's home, if it is known.

    The shell sees to that, but not within quotes, nor after "=".
    """
    from ..machine.user_folders import expanded

    return str(expanded(text)) if text.startswith("~") else text
