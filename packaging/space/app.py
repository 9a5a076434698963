"""The page as a hosted Gradio Space: `make space` puts the package beside this file (docs/how-to/app.md)."""

import os

from cavirheo.app.server import serve
from cavirheo.app.session import VisitorLimits

if __name__ == "__main__":  # the reading process imports this file, too
    port = int(os.environ.get("GRADIO_SERVER_PORT", "7860"))
    serve("0.0.0.0", port, browser=False, limits=VisitorLimits(file_mb=20, files=20, visitors=30))
