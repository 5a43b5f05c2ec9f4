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
from glassgait.studies.studio.messages import read_message
from glassgait.studies.studio.studio import Studio
from glassgait.studies.studio.views import file_view, frame, panel, setup, status

TEMPLATES = Path(__file__).parent / "templates"

HOST = "127.0.0.1"
"""The studio is for the machine that it runs on alone."""

FRAME_PERIOD = 0.04
"""Time between two messages with what the robot does (s)."""

RECONNECT = 30.0
"""Time that a browser may be out of reach on a busy machine before the page is given up (s)."""

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

    async def root() -> None:
        await _page(studio, policy_name)

    # Not before: NiceGUI looks through all objects as it starts, which pydrake's look-ups in
    # another thread do not bear.
    nicegui_app.on_startup(studio.start)
    ui.run_with(
        app,
        root=root,
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
    script = (TEMPLATES / "studio.js").read_text()
    ui.add_body_html(f"<script>const SETUP = {embedded(given)};\n{script}</script>")
    connection = _Connection(studio, client)
    ui.on("studio", connection.take)
    ui.timer(FRAME_PERIOD, connection.send)


class _Connection:
    """What one browser has been sent so far."""

    def __init__(self, studio: Studio, client: Client) -> None:
        self._studio, self._client = studio, client
        self._number, self._joint = 0, 0
        self._status: dict[str, Any] | None = None
        self._place: tuple[int, ...] | None = None
        self._digested: tuple[float, ...] | None = None
        self._works: tuple[str | None, str | None] | None = None

    def take(self, event: GenericEventArguments) -> None:
        """Does what the page asks for; what is no message changes nothing."""
        try:
            given = event.args
            if isinstance(given, dict) and given.get("kind") == "joint":
                self._joint = min(max(int(given.get("joint", 0)), 0), 11)
                self._number = 0
                return
            self._studio.handle(read_message(given))
        except (InputError, TypeError, ValueError) as error:
            self._studio.notice = str(error)

    async def send(self) -> None:
        """Sends what is new in one message."""
        if not self._client.has_socket_connection:
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
        if studio.session is not None and studio.is_at_rest:
            numbers = studio.session.numbers
            works = (studio.verified_digest, studio.evaluated_digest)
            if (numbers, works) != (self._digested, self._works):
                self._digested, self._works = numbers, works
                # It writes the whole file, which takes longer than a frame.
                whole["file"] = await asyncio.to_thread(file_view, studio)
        self._client.run_javascript(f"window.studio && studio.take({json.dumps(whole)})")
