"""report.html: one file that shows a whole result, with a viewer, from disk and without network."""

from .page import REPORT, report_html, write_report
from .stages import STAGES, Stages, pack_stages, read_stages, stage_pictures

__all__ = [
    "REPORT",
    "STAGES",
    "Stages",
    "pack_stages",
    "read_stages",
    "report_html",
    "stage_pictures",
    "write_report",
]
