"""`python -m unlit` is the command `unlit`."""

import sys

from .cli import main

if __name__ == "__main__":
    sys.exit(main())
