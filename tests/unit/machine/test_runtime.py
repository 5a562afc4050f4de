"""One core is enough: nothing waits for a second thread."""

import subprocess
import sys

SCRIPT = """
import sys, unlit, drjit, numpy
from pathlib import Path
from unlit.machine.runtime import mitsuba
mitsuba()
drjit.set_thread_count(1)
from unlit.output.images import exr
from unlit.storage.pictures import read_picture
image = numpy.random.default_rng(0).random((200, 200, 3)).astype("f4")
path = Path(sys.argv[1])
path.write_bytes(exr(image))
assert (read_picture(path) == image).all()
assert drjit.thread_count() == 1
"""


def test_pictures_are_written_and_read_with_one_thread(tmp_path):
    """Mitsuba's OpenEXR hangs without a second thread, as on one core; so in a process."""
    command = [sys.executable, "-c", SCRIPT, str(tmp_path / "x.exr")]
    subprocess.run(command, check=True, timeout=120)
