"""Errors a user can cause and mend: the command line prints their message, no traceback."""


class UnlitError(Exception):
    """Base class. The message names the input that was wrong and what to do about it.

    argument: name of the argument or setting that mends it, where there is one.

    >>> try:
    ...     unlit.load("no such folder")
    ... except unlit.UnlitError as error:
    ...     print(error)
    no such folder: ...
    """

    def __init__(self, message: str, argument: str = "") -> None:
        super().__init__(message)
        self.argument = argument


class PhotoError(UnlitError):
    """The photo cannot be read, is too large, or is no picture."""


class FaceError(UnlitError):
    """No face, or not the face that was asked for, was found in the photo."""


class ModelError(UnlitError):
    """A model file is missing, cannot be fetched, or is not the file its sha256 says."""


class SettingsError(UnlitError):
    """A setting has an unknown name or a value out of range."""


class OutputError(UnlitError):
    """Results cannot be written, or a folder of results cannot be read."""


class MachineError(UnlitError):
    """Something this machine lacks, such as an LLVM library."""


class SubjectError(UnlitError):
    """A subject's description, or a mesh or map it names, cannot be used."""


class PictureError(UnlitError):
    """A map or a photographed light cannot be read, is too large, or is no picture."""
