"""Many photos: one result each, on this machine's cores or on a cluster, by Dask.

`run.run_batch` is what `unlit batch` calls. A photo's task (task.py) may be run any number of
times: what is done it does not do again, and what it writes is there whole or not at all.
"""

import importlib.util

from ..errors import MachineError

_PACKAGES = ("distributed", "fsspec", "cryptography", "psutil")


def require_extra(dashboard: bool = False) -> None:
    """Raise MachineError, naming the extra, where a package that only a batch needs is missing."""
    packages = (*_PACKAGES, "bokeh") if dashboard else _PACKAGES
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        raise MachineError(
            f"a batch needs {', '.join(missing)}: install with "
            f"`pip install 'unlit[{'batch,dashboard' if dashboard else 'batch'}]'`"
        )
