"""One photo of a face in; mesh, albedo, normals and light out."""

from . import _runtime

# Before any submodule imports drjit, which looks for LLVM when it is loaded.
_runtime.point_to_llvm()
