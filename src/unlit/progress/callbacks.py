"""What long work calls while it lasts, to tell how far it is."""

from collections.abc import Callable

#: Called with (step or stage, iteration, iterations, loss).
StageProgress = Callable[[str, int, int, float], None]
#: Called with (what is done now, steps done, steps in all).
StepProgress = Callable[[str, int, int], None]
#: Called with (passes done, passes in all).
PassProgress = Callable[[int, int], None]


def silent(*_: object) -> None:
    """Tells nobody; it may stand for each of them."""
