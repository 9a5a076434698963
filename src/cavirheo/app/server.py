"""The page on a port, with nothing asked from outside: no telemetry, no font, no script of others."""

from __future__ import annotations

import os
import signal
import sys
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from tempfile import TemporaryDirectory

os.environ.update(GRADIO_ANALYTICS_ENABLED="False", HF_HUB_DISABLE_TELEMETRY="1")  # before gradio is imported

import gradio as gr
import plotly  # noqa: F401  said to be missing before anything is served
from gradio import processing_utils
from starlette.middleware import Middleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cavirheo.app import words
from cavirheo.app.page import build
from cavirheo.app.session import Limits, Visitors
from cavirheo.errors import InputError
from cavirheo.physics.simulate import load_solver

_FONTS = ["system-ui", "-apple-system", "Segoe UI", "Roboto", "Helvetica Neue", "Arial", "sans-serif"]
# What the page may load: itself. Gradio's own scripts stand in the page and build functions.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; object-src 'none'; base-uri 'self'"
)


class OnlyHere:
    """Every answer tells the browser to ask nobody else."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def one(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [
                    *message["headers"],
                    (b"content-security-policy", _POLICY.encode()),
                    (b"referrer-policy", b"no-referrer"),
                    (b"x-content-type-options", b"nosniff"),
                ]
            await send(message)

        await self.app(scope, receive, one if scope["type"] == "http" else send)


async def _refuse(url: str, cache_dir: str) -> str:
    raise gr.Error("files are uploaded, not fetched from an address")


def theme() -> gr.themes.Base:
    return gr.themes.Default(
        primary_hue=gr.themes.colors.blue, neutral_hue=gr.themes.colors.slate, font=_FONTS,
        font_mono=["ui-monospace", "Menlo", "Consolas", "DejaVu Sans Mono", "monospace"],
    ).set(
        button_primary_background_fill="#0b4f7d", button_primary_background_fill_hover="#0072b2",
        body_background_fill="#f4f5f7",
    )  # fmt: skip


@contextmanager
def running(host: str = "127.0.0.1", port: int = 0, limits: Limits = Limits()) -> Iterator[tuple[str, Visitors]]:  # noqa: B008
    """(address of the page, its visitors) while the page is served; then all temporary files are gone.

    Raises:
        InputError: nothing can listen there.
    """
    processing_utils.async_ssrf_protected_download = _refuse  # a program may not make the server fetch anything
    with TemporaryDirectory(prefix="cavirheo-app-") as folder, closing(Visitors(limits)) as visitors:
        visitors.reader.start()
        os.environ["GRADIO_TEMP_DIR"] = folder
        page = build(visitors)
        try:
            _, address, _ = page.launch(
                server_name=host, server_port=port or None, prevent_thread_lock=True, quiet=True, show_error=False,
                max_file_size=int(limits.file_mb * 1e6), theme=theme(), head=f"<style>{words.style()}</style>",
                js="() => document.body.classList.remove('dark')", footer_links=[], run_history=False, ssr_mode=False,
                share=False, pwa=False, app_kwargs={"middleware": [Middleware(OnlyHere)]},
            )  # fmt: skip
        except OSError as error:
            raise InputError(f"cannot listen on {host}:{port}: {error}; give another --port") from None
        try:
            yield address, visitors
        finally:
            page.close()


def serve(host: str, port: int, *, browser: bool, limits: Limits) -> None:
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
