"""`cavirheo app`: the browser app on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cavirheo.errors import InputError, require
from cavirheo.verbs.options import option

NEEDS = 'the browser app needs {}: pip install "cavirheo[app]"'


def app(
    host: Annotated[str, option("address to listen on; 0.0.0.0 is open to the network, without a password")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, option("port; 0: any free one", min=0, max=65535)] = 7860,
    live: Annotated[
        Path | None, option("folder of results of `cavirheo watch`, whose page is served at /live", readable=False)
    ] = None,
    browser: Annotated[bool, option("open the page in the browser", None, "--browser/--no-browser")] = True,
    max_file_mb: Annotated[float, option("largest file that may be uploaded, MB", min=0.001)] = 50.0,
    max_files: Annotated[int, option("largest number of files of one visitor", min=1)] = 50,
) -> None:
    """The same in the browser: upload files, look, infer, compare with the simulation, download everything as a zip."""
    message = f"--live must be the folder into which `cavirheo watch` writes (its -o), got {live}: start `watch` first"
    require(live is None or live.is_dir(), message, "option.live")
    try:
        from cavirheo.app.server import serve
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] not in ("gradio", "plotly"):
            raise
        raise InputError(NEEDS.format(error.name)) from None
    from cavirheo.app.session import VisitorLimits

    serve(host, port, browser=browser, limits=VisitorLimits(file_mb=max_file_mb, files=max_files), folder=live)
