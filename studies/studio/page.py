"""The studio's page: NiceGUI's elements around Meshcat's picture."""

import asyncio
import logging
import secrets
import socket
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import uvicorn
from fastapi import FastAPI
from nicegui import app as nicegui_app
from nicegui import core, ui
from starlette.middleware.trustedhost import TrustedHostMiddleware

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.visualization import webgl_note
from glassgait.models.errors import InputError
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.studies.studio.live_robot import LiveRobot
from glassgait.studies.studio.session import EditSession

HOST = "127.0.0.1"  # the studio serves only the machine that it runs on
REFRESH = 0.2  # time between two updates of the page (s)

RECONNECT = 30.0
"""Timeout of building the page on a busy machine, and of a browser's reconnection (s)."""

SWITCH_INTERVAL = 1e-3  # time after which the robot's thread yields to waiting messages (s)

SECOND = round(1.0 / CONTROL_PERIOD)

PUSHES = {"ahead": (1.0, 0.0), "left": (0.0, 1.0), "back": (-1.0, 0.0), "right": (0.0, -1.0)}
"""Velocity that each push adds, forward and to the left (m/s)."""

MONOSPACE = "font-family: ui-monospace, Menlo, Consolas, monospace; font-size: 13px;"


def serve(
    robot: LiveRobot, session: EditSession, gait: Gait, save_as: Path, listening: socket.socket
) -> None:
    """Serves the page until Ctrl-C; edits are saved to the folder and stem `save_as`."""
    # A separate application serves NiceGUI's page and has no other routes. It accepts only this
    # machine's name, and sockets only from this page, so that other sites cannot reach it.
    app = FastAPI(openapi_url=None)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=[HOST, "localhost"])
    core.sio.eio.cors_allowed_origins = None
    # Invalid messages fail inside the servers; turn off their logs.
    core.sio.async_handlers = False
    core.sio.eio.logger.setLevel(logging.CRITICAL)

    @ui.page("/", response_timeout=RECONNECT)
    async def root() -> None:
        await _Page(robot, session, gait, save_as).build()

    # NiceGUI iterates over all objects as it starts; start the robot, which calls pydrake, later.
    nicegui_app.on_startup(robot.start)
    ui.run_with(
        app,
        title="GlassGait studio",
        favicon="🐾",
        tailwind=False,
        storage_secret=secrets.token_hex(),
        show_welcome_message=False,
        reconnect_timeout=RECONNECT,
    )
    # Let Python's threads switch more often, so that messages do not wait for the robot.
    config = uvicorn.Config(app, log_level="critical", access_log=False, lifespan="on")
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        uvicorn.Server(config).run(sockets=[listening])
    finally:
        sys.setswitchinterval(before)


class _Page:
    def __init__(self, robot: LiveRobot, session: EditSession, gait: Gait, save_as: Path) -> None:
        self._robot, self._session = robot, session
        self._gait, self._save_as = gait, save_as
        self._place = session.places[0]
        self._shown: tuple[Any, Any] | None = None
        self._texts: list[str] = []

    async def build(self) -> None:
        ui.query("html").props('lang="en"')
        # Quasar's default blue is too light behind text.
        ui.colors(primary="#005a8c", negative="#a40000")
        address = await asyncio.wrap_future(self._robot.address)
        with ui.element("main").classes("row").style("width: 100%; gap: 1rem"):
            with ui.column().style("flex: 1 1 22rem; min-width: 0"):
                with ui.element("h1").style("font-size: 1.4rem; line-height: 1.2; margin: 0"):
                    ui.label(f"Studio: {self._gait.name}")
                scene = ui.element("iframe").style("width: 100%; height: 45vh; border: 0")
                scene.props('title="The robot, and its ghost in grey"')
                scene.props["srcdoc"] = webgl_note(f'location.replace("{address}");')
                self._build_controls()
                self._status = ui.label().props('role="status"')
                self._chart = ui.echart(_chart_options()).style("width: 100%; height: 180px")
            with ui.column().style("flex: 1 1 22rem; min-width: 0"):
                self._build_editor()
        self._refresh()
        ui.timer(REFRESH, self._refresh)

    def _build_controls(self) -> None:
        # Sliders of the command, over the gait's range.
        gait, steering = self._gait, self._robot.steering
        ranges = {
            "forward speed (m/s)": (-gait.max_speed, gait.max_speed, 0.05, steering.speed),
            "yaw rate (rad/s)": (-gait.max_yaw_rate, gait.max_yaw_rate, 0.05, steering.yaw_rate),
            "control steps in a state": (*gait.dwell, 1, steering.dwell),
        }
        self._sliders = []
        with ui.grid(columns="9rem 1fr 3rem").style("width: 100%; align-items: center"):
            for name, (least, most, step, value) in ranges.items():
                ui.label(name)
                slider = ui.slider(
                    min=least, max=most, step=step, value=value, on_change=self._steer
                )
                slider.props(f'aria-label="{name}"')
                ui.label().bind_text_from(slider, "value", lambda value: f"{value:g}")
                self._sliders.append(slider)

        # Buttons for both robots.
        with ui.row().style("align-items: center"):
            ui.label("push by 1 m/s")
            for name, velocity in PUSHES.items():
                push = partial(self._robot.push, np.array([*velocity, 0.0]))
                ui.button(name, on_click=push).props("dense")
            ui.button("stand again", on_click=self._robot.restart).props("dense outline")
            pause = ui.switch("pause", on_change=lambda event: self._robot.pause(bool(event.value)))
            self._pause = pause

    def _build_editor(self) -> None:
        # Choice of a formula, and buttons for versions.
        titles = {index: self._title(place) for index, place in enumerate(self._session.places)}
        with ui.row().style("align-items: center"):
            choice = ui.select(titles, value=0, label="formula", on_change=self._choose)
            choice.style("min-width: 14rem")
            for name in ("undo", "redo", "reset"):
                act = getattr(self._session, name)
                ui.button(name, on_click=partial(self._change, act)).props("dense outline")
            ui.button("save", on_click=self._save).props("dense")

        # The formula's text, its terms, and the changed lines of the file.
        self._text = ui.textarea().props('outlined rows=8 aria-label="formula"')
        self._text.style("width: 100%; " + MONOSPACE)
        ui.button("apply", on_click=self._edit).props("dense")
        self._sum = ui.label()
        columns = [
            {"name": name, "label": name, "field": name, "align": align}
            for name, align in (("term", "left"), ("adds (rad)", "right"))
        ]
        self._terms = ui.table(columns=columns, rows=[], row_key="term", pagination=12)
        self._terms.props("dense")
        self._terms.style("width: 100%; " + MONOSPACE)
        with ui.expansion("Changed lines of the file").style("width: 100%"):
            self._diff = ui.code("", language="diff").style("width: 100%")

    def _title(self, place: tuple[int, ...]) -> str:
        joint = quadruped.JOINTS[place[-1]].replace("_", " ")
        return joint if len(place) == 1 else f"{joint} in {self._gait.states[place[0]]}"

    def _steer(self) -> None:
        speed, yaw_rate, dwell = (slider.value for slider in self._sliders)
        self._robot.steer(FixedCommand(float(speed), float(yaw_rate), round(dwell)))

    def _choose(self, event: Any) -> None:
        self._place = self._session.places[event.value]
        self._refresh()

    async def _change(self, act: Any) -> None:
        """Edits in another thread, and gives the result to the robot."""
        try:
            await asyncio.to_thread(act)
        except InputError as error:
            ui.notify(str(error), type="negative")
            return
        self._robot.act_by(self._session.policy)
        self._refresh()

    async def _edit(self) -> None:
        place, text = self._place, str(self._text.value or "")
        await self._change(lambda: self._session.replace(place, text))

    def _save(self) -> None:
        path = self._session.save(self._save_as.parent, self._save_as.name)
        ui.notify(f"saved to {path}; every command takes it with --policy")

    def _show_formula(self) -> None:
        session = self._session
        self._shown = (self._place, session.policy)
        terms = session.terms(self._place)
        self._tape = Tape([term for term, _ in terms], len(session.policy.vocabulary.symbols))
        self._texts = [text for _, text in terms]
        self._text.set_value(session.text(self._place))
        self._diff.set_content("\n".join(session.diff()) or "nothing has changed")

    def _refresh(self) -> None:
        if self._shown != (self._place, self._session.policy):
            self._show_formula()

        # Update the switch, since the robot pauses if an action is not finite.
        samples = self._robot.samples()
        self._pause.set_value(self._robot.paused)
        if not samples:
            return
        robot = samples[-1][0]
        observations = np.stack([sample.observation for sample, _ in samples[-SECOND:]])
        values = self._tape(self._session.policy.quantities(observations))
        # Rank by the mean over the last second, so that rows do not move within a stride.
        ranked = np.argsort(-np.abs(values).mean(axis=0), kind="stable")
        self._terms.rows[:] = [
            {"term": self._texts[index], "adds (rad)": f"{values[-1, index]:+.4f}"}
            for index in ranked
        ]
        self._terms.update()

        # Show whether the formula acts, and the scores and angles of robot and ghost.
        state, joint = int(robot.rm_state.argmax()), self._place[-1]
        acts = len(self._place) == 1 or self._place[0] == state
        self._sum.set_text(
            f"The terms add up to {values[-1].sum():+.3f} rad. The RM state is "
            f"{self._gait.states[state]}, in which this formula {'acts' if acts else 'is unused'}."
        )
        self._status.set_text(self._robot.problem or self._measures(samples[-SECOND:]))
        joints = (quadruped.JOINT_POSITION.start or 0) + joint
        actions = np.stack([sample.action for sample, _ in samples])
        targets = self._session.policy.robot.joint_targets(actions)[:, joint]
        angles = [[pair[index].state[joints] for pair in samples] for index in (0, 1)]
        lines = [targets, *angles]
        for series, line in zip(self._chart.options["series"], lines, strict=True):
            series["data"] = [round(float(value), 3) for value in line]
        self._chart.update()

    def _measures(self, samples: list) -> str:
        texts = []
        for name, index in (("robot", 0), ("ghost", 1)):
            chosen = [pair[index] for pair in samples]
            speed = np.mean([kinematics.base_velocity(sample.state)[0][0] for sample in chosen])
            reward = np.mean([sample.reward for sample in chosen]) / CONTROL_PERIOD
            texts.append(
                f"{name}: {speed:.2f} m/s, reward {reward:.1f} a second, "
                f"{self._robot.falls[index]} falls"
            )
        return f"{'; '.join(texts)}; {100 * self._robot.late:.0f} % of steps late"


def _chart_options() -> dict[str, Any]:
    line = {"type": "line", "showSymbol": False, "data": []}
    styles: dict[str, dict] = {
        "target": {"type": "dashed"},
        "robot": {},
        "ghost": {"type": "dotted"},
    }
    return {
        "animation": False,
        "legend": {"data": list(styles), "top": 0},
        "grid": {"left": 50, "right": 10, "top": 30, "bottom": 25},
        "xAxis": {"type": "category", "show": False},
        "yAxis": {"type": "value", "scale": True, "name": "joint (rad)"},
        "series": [{**line, "name": name, "lineStyle": style} for name, style in styles.items()],
    }
