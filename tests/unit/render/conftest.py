"""Import the package before Dr.Jit, which looks for LLVM when it is loaded."""

import unlit  # noqa: F401
