"""Serve the page on a port, without requests to other servers: no telemetry, no external fonts or scripts."""

from __future__ import annotations

import ctypes
import os
import signal
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
from cavirheo.writing.terminal import say

_THEME = gr.themes.Default(
    primary_hue=gr.themes.colors.blue,
    neutral_hue=gr.themes.colors.slate,
    font=["system-ui", "sans-serif"],
    font_mono=["ui-monospace", "monospace"],
).set(
    button_primary_background_fill="#0b4f7d",
    button_primary_background_fill_hover="#0072b2",
    body_background_fill="#f4f5f7",
)
MAX_EVENTS = 8  # largest number of events of one kind that run at the same time, over all visitors
# The page may load from its own server only. Gradio's scripts are inline, and create functions from text.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; object-src 'none'; base-uri 'self'"
)
_HEADERS = [
    (b"content-security-policy", _POLICY.encode()),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
]


def _add_security_headers(app: ASGIApp) -> ASGIApp:
    """Return middleware that adds _HEADERS to each response: the browser must not load from other servers."""

    async def answer(scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_HEADERS]
            await send(message)

        await app(scope, receive, send_with_headers)

    return answer


async def _refuse_url(url: str, cache_dir: str) -> str:
    raise gr.Error("files are uploaded, not fetched from an address")


class _Upload(getattr(route_utils, "GradioUploadFile", object)):  # type: ignore[misc]
    """An upload into a new folder. Gradio names folders by the content alone: visitors with the same file share one."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        if hasattr(self, "sha"):
            self.sha.update(token_bytes(16))


@contextmanager
def running_server(
    host: str = "127.0.0.1", port: int = 0, limits: VisitorLimits | None = None
) -> Iterator[tuple[str, Visitors]]:
    """Serve the page; yield (its address, its visitors). At the end, all temporary files are removed. Raises
    InputError: the port cannot be opened."""
    # by these private names gradio calls what downloads for clients, and what stores their uploads
    processing_utils.async_ssrf_protected_download = _refuse_url
    route_utils.GradioUploadFile = _Upload  # type: ignore[misc]
    with (
        TemporaryDirectory(prefix="cavirheo-app-") as temporary,
        closing(Visitors(limits or VisitorLimits())) as visitors,
    ):
        os.environ["GRADIO_TEMP_DIR"] = temporary
        page = Page(visitors).blocks.queue(default_concurrency_limit=MAX_EVENTS)
        try:
            _, address, _ = page.launch(
                server_name=host,
                server_port=port or None,
                prevent_thread_lock=True,
                quiet=True,
                show_error=True,
                max_file_size=int(visitors.limits.file_mb * 2**20),
                theme=_THEME,
                head=words.page_head(),
                js=words.read_file("page.js"),
                footer_links=[],
                run_history=False,
                ssr_mode=False,
                share=False,
                pwa=False,
                app_kwargs={"middleware": [Middleware(_add_security_headers)]},
            )
        except OSError:
            message = f"cannot listen on {host}:{port}: give another --port, or as --host an address of this machine"
            raise InputError(message, "app.port_taken") from None
        with closing(page):
            yield address, visitors


def _call_glibc(name: str, *arguments: int) -> None:
    """Call a memory function of glibc; no effect with another C library."""
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None)[name](*arguments)


def serve(host: str, port: int, *, browser: bool, limits: VisitorLimits | None = None) -> None:
    """Serve the page until SIGINT or SIGTERM. Raises InputError."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    _call_glibc("mallopt", -8, 2)  # M_ARENA_MAX: by default, each of many threads keeps a separate heap
    with suppress(KeyboardInterrupt), running_server(host, port, limits) as (address, visitors):
        say(f"cavirheo app: {address}   (Ctrl+C ends it)")
        threading.Thread(target=load_solver, daemon=True).start()
        if browser:
            webbrowser.open(address)
        while not threading.Event().wait(60.0):
            visitors.forget_absent()
            _call_glibc("malloc_trim", 0)
    say("ended; temporary files are removed")
