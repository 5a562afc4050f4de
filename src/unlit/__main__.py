"""`python -m unlit` and the command `unlit`: the command line, or in a line why it cannot start."""

import sys


def main() -> int:
    """Run the command line. Needs nothing but Python itself to say which package is broken."""
    try:
        from .cli import main as command_line
    except Exception as error:  # what a broken package raises may be anything
        if sys.argv[1:2] == ["doctor"]:
            from .machine.doctor import checks, report

            print(report(checks()))
        else:
            kind = "" if isinstance(error, ImportError) else f"{type(error).__name__}: "
            reason = " ".join(f"{kind}{error}".split())
            print(
                f"unlit: error: a package cannot be loaded ({reason}): see `unlit doctor`",
                file=sys.stderr,
            )
        return 1
    return command_line()


if __name__ == "__main__":
    sys.exit(main())
