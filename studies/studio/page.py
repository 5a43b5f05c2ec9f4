"""The studio's page: NiceGUI carries messages between a browser and the studio, and no more."""

import asyncio
import json
import secrets
import socket
import sys
from pathlib import Path
from typing import Any

import uvicorn
from fastapi import FastAPI
from nicegui import Client, ui
from nicegui import app as nicegui_app
from nicegui.events import GenericEventArguments

from glassgait.models.errors import InputError
from glassgait.studies.common.pages import embedded, page_template
from glassgait.studies.studio.messages import Joint, Shown, read_message
from glassgait.studies.studio.session import EditSession
from glassgait.studies.studio.studio import Studio
from glassgait.studies.studio.views import file_view, formula_view, frame, panel, setup, status

TEMPLATES = Path(__file__).parent / "templates"

SCRIPTS = ("gamepad.js", "studio.js")

HOST = "127.0.0.1"
"""The studio is for the machine that it runs on alone."""

FRAME_PERIOD = 0.04
"""Time between two messages with what the robot does (s)."""

MOST_AHEAD = 3
"""Messages that a page has not taken yet from which on it is sent no more: else those of a page
that is slower than the robot would wait in an ever longer line."""

RECONNECT = 30.0
"""Time that a busy machine has to build the page, and that a browser may be out of reach (s)."""

SWITCH_INTERVAL = 1e-3
"""How long the robot's thread may keep Python to itself while messages wait (s)."""


def serve(studio: Studio, policy_name: str, listening: socket.socket) -> None:
    """Serves the page until Ctrl-C.

    Args:
        studio: The studio; its robot begins to walk once the page can be opened.
        policy_name: What the page calls the policy.
        listening: A socket that listens at `HOST`.
    """
    app = FastAPI(openapi_url=None)

    @ui.page("/", response_timeout=RECONNECT)
    async def root() -> None:
        await _page(studio, policy_name)

    # Not before: NiceGUI looks through all objects as it starts, which pydrake's look-ups in
    # another thread do not bear.
    nicegui_app.on_startup(studio.start)
    ui.run_with(
        app,
        title="GlassGait studio",
        favicon="🐾",
        tailwind=False,
        storage_secret=secrets.token_hex(),
        show_welcome_message=False,
        reconnect_timeout=RECONNECT,
    )
    config = uvicorn.Config(app, log_level="error", access_log=False, lifespan="on")
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        uvicorn.Server(config).run(sockets=[listening])
    finally:
        sys.setswitchinterval(before)


async def _page(studio: Studio, policy_name: str) -> None:
    """Builds the page, once for each browser that opens it."""
    client = ui.context.client
    ui.query(".nicegui-content").classes("studio-content")
    ui.add_head_html(f"<style>{(TEMPLATES / 'studio.css').read_text()}</style>")
    given = setup(studio, policy_name)
    given["meshcat"] = await asyncio.wrap_future(studio.robot.address)
    ui.html(page_template(TEMPLATES, "studio.html").render(**given), sanitize=False)
    script = "\n".join((TEMPLATES / name).read_text() for name in SCRIPTS)
    ui.add_body_html(f"<script>const SETUP = {embedded(given)};\n{script}</script>")
    connection = _Connection(studio, client)
    ui.on("studio", connection.take)
    ui.timer(FRAME_PERIOD, connection.send)


class _Connection:
    """What one browser has been sent so far."""

    def __init__(self, studio: Studio, client: Client) -> None:
        self._studio, self._client = studio, client
        self._number, self._joint = 0, 0
        self._sent, self._shown = 0, 0
        self._status: dict[str, Any] | None = None
        self._place: tuple[int, ...] | None = None
        self._formula: tuple[tuple[int, ...], tuple[float, ...]] | None = None
        self._digested: tuple[float, ...] | None = None
        self._works: tuple[str | None, str | None] | None = None

    def take(self, event: GenericEventArguments) -> None:
        """Does what the page asks for; what is no message changes nothing."""
        try:
            message = read_message(event.args)
            match message:
                case Shown(number=number):
                    self._shown = max(self._shown, min(number, self._sent))
                case Joint(joint=joint):
                    self._joint, self._number = joint, 0
                case _:
                    self._studio.handle(message)
        except InputError as error:
            self._studio.notice = str(error)

    async def send(self) -> None:
        """Sends what is new in one message."""
        if not self._client.has_socket_connection or self._sent - self._shown >= MOST_AHEAD:
            return
        studio = self._studio
        studio.look()
        whole: dict[str, Any] = {"frame": frame(studio, self._number, self._joint)}
        self._number = whole["frame"]["number"]
        if studio.session is not None and self._place != studio.reader.place:
            self._place = studio.reader.place
            whole["panel"] = panel(studio)
            self._status = None
            # Of the joint that is drawn now the page has nothing yet.
            whole["frame"] = frame(studio, 0, self._joint)
        now = status(studio)
        if now != self._status:
            whole["status"] = self._status = now
        if studio.session is not None:
            await self._send_file(whole, studio.session)
        self._sent += 1
        shown = json.dumps({"kind": Shown.title, "number": self._sent})
        self._client.run_javascript(
            f"emitEvent('studio', {shown}); window.studio && studio.take({json.dumps(whole)})"
        )

    async def _send_file(self, whole: dict[str, Any], session: EditSession) -> None:
        """Adds the formula's lines, and what becomes of the file, once numbers are at rest.

        Both are of the whole file with its numbers, which takes longer than a frame to make.
        """
        studio, numbers = self._studio, session.numbers
        if not studio.is_at_rest and "panel" not in whole:
            return
        formula = (studio.reader.place, numbers)
        if formula != self._formula:
            self._formula = formula
            whole["formula"] = await asyncio.to_thread(formula_view, studio)
        works = (studio.verified_digest, studio.evaluated_digest)
        if (numbers, works) != (self._digested, self._works):
            self._digested, self._works = numbers, works
            whole["file"] = await asyncio.to_thread(file_view, studio)
