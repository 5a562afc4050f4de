"""A linear map with the adjoint that is known for it, as one differentiable Dr.Jit operation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr

from ..machine.runtime import mitsuba

mitsuba()  # chooses the variant, before the first operation is made


def linear(apply: Callable[[Any], Any], adjoint: Callable[[Any], Any], values: Any) -> Any:
    """apply(values), differentiable: derivatives take `apply` forward and `adjoint` back."""
    return dr.custom(_Linear, (apply, adjoint), values)


class _Linear(dr.CustomOp):
    def eval(self, maps: tuple[Callable[[Any], Any], Callable[[Any], Any]], values: Any) -> Any:
        self.apply, self.adjoint = maps
        return self.apply(values)

    def forward(self) -> None:
        self.set_grad_out(self.apply(self.grad_in("values")))

    def backward(self) -> None:
        self.set_grad_in("values", self.adjoint(self.grad_out()))
