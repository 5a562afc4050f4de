# Dr.Jit's own stubs resolve few of the operations on Mitsuba's run-time types.
from typing import Any

def __getattr__(name: str) -> Any: ...
