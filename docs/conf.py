"""How the documentation is built: Markdown through MyST, the furo theme."""

from __future__ import annotations

import importlib.metadata

project = "gcs_sysid"
author = "The gcs_sysid authors"
project_copyright = "2026, The gcs_sysid authors"
release = importlib.metadata.version("gcs-sysid")

extensions = ["myst_parser"]
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]

html_theme = "furo"
html_title = f"gcs_sysid {release}"
