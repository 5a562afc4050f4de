"""report.html: one file that shows a whole result, with a viewer, from disk and without network.

Imports nothing by itself: `unlit doctor` asks bundle.py without loading the renderer.
"""
