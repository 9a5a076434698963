"""Parts of the page; how an event reaches a handler, with the session of who asks; what is said where it fails."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import gradio as gr

from cavirheo.app import words
from cavirheo.app.session import Session, Visitors
from cavirheo.errors import InputError, SolverError

AT_ONCE: dict[str, Any] = {"queue": False, "show_progress": "hidden"}
LATEST: dict[str, Any] = {"trigger_mode": "always_last", "show_progress": "hidden"}
line = partial(gr.Textbox, max_lines=1)
button = partial(gr.Button, variant="primary")
plot = partial(gr.Plot, show_label=False, container=False, min_width=320)
html = partial(gr.HTML, apply_default_css=False)
Handler = Callable[..., Any]


class Events:
    """Of a page whose visitors these are; `wrong`: the component that says what was not done, and why."""

    visitors: Visitors
    wrong: Any

    def session(self, request: gr.Request) -> Session:
        return self.visitors.of(request.session_hash or "")

    def on(self, event: Any, handler: Handler, given: Any, out: Any, *, works: bool = False, **options: Any) -> Any:
        """The event, or each of a list, calls the handler with the session of who asks and the values of components.
        The session is locked; not for a handler that `works` for a while, which gets `progress` to show a bar."""

        def one(request: gr.Request, progress: gr.Progress = gr.Progress(), *values: Any) -> Any:  # noqa: B008
            session = self.session(request)
            if works:
                return self._tried(partial(handler, progress=progress), session, *values)
            with session.lock:
                return self._tried(handler, session, *values)

        begins = partial(gr.on, event) if isinstance(event, list) else event
        return self._told(begins(one, given, [*out, self.wrong], api_visibility="private", **options))

    def validated(self, wrong: Callable[..., list[str]]) -> Handler:
        """Shows at each field what is `wrong` with its value, and stops the event then."""

        def one(request: gr.Request, *values: Any) -> Any:
            session = self.session(request)
            with session.lock:
                told = [gr.validate(not why, why) for why in wrong(session, *values)]
            return told if len(told) > 1 else told[0]  # as gradio takes the answer of several fields, and of one

        return one

    def _tried(self, handler: Handler, session: Session, *values: Any) -> list[Any]:
        """What the handler returns, and that nothing is wrong; what is, is kept for the event after a failure."""
        try:
            session.said, done = "", handler(session, *values)
        except (InputError, SolverError) as error:
            session.said = words.told(error)
            raise gr.Error(session.said, visible=False, print_exception=False) from None
        return [*(done if isinstance(done, list) else [] if done is None else [done]), ""]

    def _told(self, event: Any) -> Any:
        """The event; what it fails of is said on the page, where it covers nothing and goes with the next success."""

        def why(request: gr.Request) -> str:
            return words.part("wrong", self.session(request).said)

        event.failure(why, None, [self.wrong], api_visibility="private", **AT_ONCE)
        return event
