"""The three networks of the face landmarker bundle, run with LiteRT on one thread.

The bundle is a zip archive that holds three TFLite files (face detector, 478 landmarks, 52
blendshapes), read with `zipfile`; nothing in it is executed or unpickled. One thread makes the
results independent of the machine's core count.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
import threading
import zipfile
from collections.abc import Iterator

import numpy as np

from ..errors import ModelError
from ..machine.assets import asset

BUNDLE = "face_landmarker.task"
DETECTOR = "face_detector.tflite"
LANDMARKS = "face_landmarks_detector.tflite"
BLENDSHAPES = "face_blendshapes.tflite"

# The largest member is 2.6 MB; anything much larger is not the bundle we know.
_MEMBER_BYTES = 16 << 20


def read_member(member: str) -> bytes:
    """Bytes of one member of the bundle. Raises ModelError when the bundle is not as expected."""
    path = asset(BUNDLE)
    try:
        with zipfile.ZipFile(path) as archive:
            if archive.getinfo(member).file_size > _MEMBER_BYTES:
                raise ModelError(f"{path}: {member} is too large; fetch the model file again")
            return archive.read(member)
    except (OSError, KeyError, zipfile.BadZipFile) as error:
        raise ModelError(
            f"{path}: not a readable face landmarker bundle ({error}); delete it to fetch it again"
        ) from error


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep LiteRT's announcement of its CPU kernels, written past Python, off standard error."""
    sys.stderr.flush()
    saved = os.dup(2)
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 2)
    try:
        yield
    finally:
        os.dup2(saved, 2)
        os.close(sink)
        os.close(saved)


class Network:
    """One TFLite network with one input tensor; calls are serialised by a lock."""

    def __init__(self, member: str) -> None:
        from ai_edge_litert.interpreter import Interpreter

        content = read_member(member)
        with _quiet():
            self._interpreter = Interpreter(model_content=content, num_threads=1)
            self._interpreter.allocate_tensors()
        self._input = self._interpreter.get_input_details()[0]
        self._outputs = self._interpreter.get_output_details()
        self._lock = threading.Lock()

    def __call__(self, tensor: np.ndarray) -> list[np.ndarray]:
        """Outputs, in the file's order and with their own shapes, for one input tensor."""
        with self._lock:
            self._interpreter.set_tensor(
                self._input["index"],
                np.ascontiguousarray(tensor, np.float32).reshape(self._input["shape"]),
            )
            self._interpreter.invoke()
            return [self._interpreter.get_tensor(output["index"]) for output in self._outputs]


@functools.cache
def network(member: str) -> Network:
    """The network of that name in the bundle, loaded once per process."""
    return Network(member)
