"""The page on a port, with nothing asked from outside: no telemetry, no font, no script of others."""

from __future__ import annotations

import os
import signal
import sys
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from secrets import token_bytes
from tempfile import TemporaryDirectory
from typing import Any

os.environ.update(GRADIO_ANALYTICS_ENABLED="False", HF_HUB_DISABLE_TELEMETRY="1")  # before gradio is imported

import gradio as gr
from gradio import processing_utils, route_utils
from starlette.middleware import Middleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cavirheo.app import words
from cavirheo.app.page import Page
from cavirheo.app.session import VisitorLimits, Visitors
from cavirheo.errors import InputError
from cavirheo.physics.simulate import load_solver

_FONTS = ["system-ui", "-apple-system", "Segoe UI", "Roboto", "Helvetica Neue", "Arial", "sans-serif"]
_THEME = gr.themes.Default(
    primary_hue=gr.themes.colors.blue, neutral_hue=gr.themes.colors.slate, font=_FONTS,
    font_mono=["ui-monospace", "Menlo", "Consolas", "DejaVu Sans Mono", "monospace"],
).set(
    button_primary_background_fill="#0b4f7d", button_primary_background_fill_hover="#0072b2",
    body_background_fill="#f4f5f7",
)  # fmt: skip
# What the page may load: itself. Gradio's own scripts stand in the page and build functions.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; object-src 'none'; base-uri 'self'"
)
_HEADERS = [
    (b"content-security-policy", _POLICY.encode()),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
]


def _only_here(app: ASGIApp) -> ASGIApp:
    """Every answer tells the browser to ask nobody else."""

    async def answer(scope: Scope, receive: Receive, send: Send) -> None:
        async def one(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_HEADERS]
            await send(message)

        await app(scope, receive, one)

    return answer


async def _refuse(url: str, cache_dir: str) -> str:
    raise gr.Error("files are uploaded, not fetched from an address")


class _Upload(route_utils.GradioUploadFile):
    """Has a folder of its own. Gradio's are named by the content alone: two visitors who send one file share it."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.sha.update(token_bytes(16))


@contextmanager
def running(
    host: str = "127.0.0.1", port: int = 0, limits: VisitorLimits | None = None
) -> Iterator[tuple[str, Visitors]]:
    """(address of the page, its visitors) while the page is served; then all temporary files are gone.

    Raises:
        InputError: nothing can listen there.
    """
    processing_utils.async_ssrf_protected_download = _refuse  # a program may not make the server fetch anything
    route_utils.GradioUploadFile = _Upload  # type: ignore[misc]
    with TemporaryDirectory(prefix="cavirheo-app-") as folder, closing(Visitors(limits or VisitorLimits())) as visitors:
        os.environ["GRADIO_TEMP_DIR"] = folder
        page = Page(visitors).blocks
        try:
            _, address, _ = page.launch(
                server_name=host, server_port=port or None, prevent_thread_lock=True, quiet=True, show_error=False,
                max_file_size=int(visitors.limits.file_mb * 1e6), theme=_THEME, head=f"<style>{words.style()}</style>",
                js="() => document.body.classList.remove('dark')", footer_links=[], run_history=False, ssr_mode=False,
                share=False, pwa=False, app_kwargs={"middleware": [Middleware(_only_here)]},
            )  # fmt: skip
        except OSError as error:
            said = f"cannot listen on {host}:{port}: {error}; give another --port"
            raise InputError(said, "app.port_taken") from None
        try:
            yield address, visitors
        finally:
            page.close()


def serve(host: str, port: int, *, browser: bool, limits: VisitorLimits) -> None:
    """Serve the page until it is interrupted or terminated. Raises InputError if nothing can listen there."""
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    with running(host, port, limits) as (address, _):
        print(f"cavirheo app: {address}   (Ctrl+C ends it)", file=sys.stderr)
        threading.Thread(target=load_solver, daemon=True).start()
        if browser:
            webbrowser.open(address)
        with suppress(KeyboardInterrupt):
            ended.wait()
    print("ended; temporary files are removed", file=sys.stderr)
