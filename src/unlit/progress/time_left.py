"""How much of a run is done, and how long the rest will take."""

from __future__ import annotations

from collections.abc import Mapping


class TimeLeft:
    """Of a run whose steps are expected to take `plan` seconds each, in order.

    What has been measured scales the plan (`machine.cost.plan`): its sum need not be right.
    """

    def __init__(self, plan: Mapping[str, float]) -> None:
        self._plan = plan

    def share(self, step: str, part: float) -> float:
        """Estimated share of the whole run that is done, when `part` of `step` is."""
        names = list(self._plan)
        if step not in names:
            return 0.0
        before = sum(self._plan[name] for name in names[: names.index(step)])
        return (before + self._plan[step] * part) / sum(self._plan.values())

    def seconds(self, step: str, part: float, passed: float) -> float | None:
        """Seconds left after `passed`; None at the very start, when nothing can scale the plan."""
        share = self.share(step, part)
        return passed * (1 - share) / share if share > 0.02 and passed > 1 else None
