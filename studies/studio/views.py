"""What the page shows of a studio, as values that JSON can hold."""

from dataclasses import asdict
from typing import Any

import numpy as np

from glassgait.models.certificates.certificate import OUTCOME_WORDS
from glassgait.models.formulas.file import formula_lines
from glassgait.models.formulas.text import written_number
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import DEAD_ZONE
from glassgait.models.task.drawing import state_colors
from glassgait.studies.distillation.students import policy_title
from glassgait.studies.studio.background import ROLLOUTS, Work
from glassgait.studies.studio.live_robot import KEPT, Moment
from glassgait.studies.studio.session import EditSession
from glassgait.studies.studio.studio import Studio, known_scenarios
from glassgait.studies.studio.terms import in_groups, joint_title, open_texts, sum_of

SECOND = round(1.0 / CONTROL_PERIOD)
"""Control steps of a second."""

FIRST_SCENARIOS = ("training", "friction_0.5", "latency_20ms", "push_1.0")
"""Scenarios in which falls are counted unless others are ticked."""

SHORT_DIGEST = 12
"""Characters of a digest that the page shows."""


def setup(studio: Studio, policy_name: str) -> dict[str, Any]:
    """Returns what stays as it is while a page is open."""
    gait, policy = studio.gait, studio.original.policy
    formulas = studio.session is not None
    return {
        "gait": gait.name,
        "description": gait.description,
        "policy": policy_title(policy_name),
        "kind": policy.kind,
        "n_observations": len(policy.observation_names),
        "robot": policy.robot.full_name,
        "file": studio.file.name,
        "states": list(gait.states),
        "colors": state_colors(gait),
        "legs": list(quadruped.LEGS),
        "joints": [joint_title(joint) for joint in range(quadruped.N_JOINTS)],
        "period": CONTROL_PERIOD,
        "kept": KEPT,
        "limits": {
            "speed": gait.max_speed,
            "yaw_rate": gait.max_yaw_rate,
            "dwell": list(gait.dwell),
        },
        "dead_zone": DEAD_ZONE,
        "formulas": formulas,
        "places": [_place(place) for place in studio.places] if formulas else [],
        "definitions": [
            {"symbol": symbol, "text": text, "note": note}
            for symbol, text, note in (open_texts(studio.numbered()) if formulas else ())
        ],
        "certificate": _certificate(studio),
        "counted": f"{ROLLOUTS.n_robots} robots fall in {ROLLOUTS.n_steps * CONTROL_PERIOD:g} s",
        "plane": studio.robot.scenario.station.terrain.is_plane,
        "scenarios": [
            {"name": name, "title": title, "ticked": name in FIRST_SCENARIOS}
            for name, title in known_scenarios().items()
        ],
    }


def panel(studio: Studio) -> dict[str, Any]:
    """Returns the formula that is shown: its terms in groups."""
    reader, file = studio.reader, studio.numbered().file
    place = studio.places.index(reader.place)
    return {
        "place": place,
        "title": joint_title(reader.place[-1]),
        "acting": _acting(studio),
        "symbols": [file.vocabulary.symbols[index] for index in reader.symbols],
        "groups": [
            {"name": name, "terms": [_term(studio, index) for index in indices]}
            for name, indices in in_groups(reader.terms)
        ],
    }


def formula_view(studio: Studio) -> dict[str, Any]:
    """Returns the lines of the formula that is shown, as its file has them."""
    return {"lines": formula_lines(studio.file_now(), studio.reader.place)}


def status(studio: Studio) -> dict[str, Any]:
    """Returns what changes by what a person does, and by work in the background."""
    robot, scenario, session = studio.robot, studio.robot.scenario, studio.session
    return {
        "paused": robot.paused,
        "ghost": robot.has_ghost,
        "problem": robot.problem or studio.notice,
        "steering": asdict(robot.steering),
        "slope": scenario.station.terrain.slope,
        "latency": scenario.latency,
        "scenario": scenario.title,
        "edits": None if session is None else _edits(studio, session),
        "verification": _verification(studio),
        "evaluation": _evaluation(studio),
        "saved": None if studio.saved is None else str(studio.saved),
    }


def file_view(studio: Studio) -> dict[str, Any] | None:
    """Returns what becomes of the whole file: digest, certificate and diff."""
    session = studio.session
    if session is None:
        return None
    digest = session.digest()
    certified = studio.certified is not None
    return {
        "digest": digest[:SHORT_DIGEST],
        "changed": session.is_changed,
        "holds": certified and studio.original_digest == digest,
        "certificate": studio.original_digest[:SHORT_DIGEST] if certified else None,
        "diff": list(session.diff()),
        "verified": studio.verified_digest == digest,
        "evaluated": studio.evaluated_digest == digest,
    }


def frame(studio: Studio, after: int, joint: int) -> dict[str, Any]:
    """Returns what the robot did since, and what its formula says now.

    Args:
        studio: The studio.
        after: Number of the last moment that the page has.
        joint: Joint whose target is drawn, where there are no formulas.
    """
    moments = studio.robot.since(after)
    recent = studio.robot.latest(SECOND)
    shown: dict[str, Any] = {
        "first": after == 0,
        "number": moments[-1].number if moments else after,
    }
    if recent:
        now = recent[-1].robot
        if studio.session is not None:
            # The line stays that of one joint, whichever the formula acts on at the moment.
            joint = studio.reader.place[-1]
            shown["terms"] = _live_terms(studio, recent[-1])
        shown["state"] = int(now.rm_state.argmax())
        shown["steps"] = [_step(moment, joint) for moment in moments]
        shown |= _tiles(recent)
    shown["count"] = asdict(studio.robot.count)
    return shown


def _acting(studio: Studio) -> list[dict[str, Any]]:
    """Returns on which joint the formula acts in each state of the machine in which it does."""
    return [
        {"state": state, "joint": joint_title(own.joint), "mirrored": own.mirrored}
        for state in range(studio.gait.n_states)
        for own in studio.reader.acting(state)
    ]


def _place(place: tuple[int, ...]) -> dict[str, Any]:
    leg, part = quadruped.JOINTS[place[-1]].split("_")
    return {"state": place[0] if len(place) > 1 else None, "leg": leg, "part": part}


def _certificate(studio: Studio) -> dict[str, Any] | None:
    if studio.certified is None:
        return None
    outcomes = [*studio.certified.values()]
    return {"counts": {one: outcomes.count(one) for one in OUTCOME_WORDS}, "total": len(outcomes)}


def _term(studio: Studio, index: int) -> dict[str, Any]:
    term, symbols = studio.reader.terms[index], studio.numbered().file.vocabulary.symbols
    start = term.coefficient(studio.numbered().start)
    return {
        "index": index,
        "number": term.own,
        "start": start,
        "factors": list(term.factors),
        "symbols": [symbols[own] for own in term.symbols],
    }


def _edits(studio: Studio, session: EditSession) -> dict[str, Any]:
    changed = set(session.changed())
    terms = studio.reader.terms
    return {
        "undo": session.can_undo,
        "redo": session.can_redo,
        "last": session.version.change,
        "count": len(changed),
        "coefficients": [written_number(studio.coefficient(term)) for term in terms],
        "off": [term.own in session.version.off for term in terms],
        "changed": [term.own in changed for term in terms],
        "numbers": {
            index: written_number(session.shown(index)) for index in range(_n_defined(session))
        },
        "changed_numbers": sorted(index for index in changed if index < _n_defined(session)),
        "changed_places": _changed_places(session, changed),
    }


def _n_defined(session: EditSession) -> int:
    """Returns how many numbers definitions hold, which stand before those of formulas."""
    return session.numbered.spans[0].start


def _changed_places(session: EditSession, changed: set[int]) -> list[int]:
    spans = session.numbered.spans
    return [i for i, span in enumerate(spans) if changed & set(range(span.start, span.stop))]


def _verification(studio: Studio) -> dict[str, Any] | None:
    work = studio.verification
    if work is None:
        return None
    lost, baseline = set(studio.lost()), studio.baseline
    rows = [
        {
            "name": own["name"],
            "outcome": own["outcome"],
            "word": OUTCOME_WORDS[own["outcome"]],
            "where": own["where"],
            "lost": own["name"] in lost,
            "before": None if baseline is None else baseline.get(own["name"]),
        }
        for own in work.found
        if own["outcome"] is not None
    ]
    rows.sort(key=lambda row: (not row["lost"], row["outcome"] == "proved"))
    return {**_work(work), "rows": rows, "lost": len(lost), "compared": baseline is not None}


def _evaluation(studio: Studio) -> dict[str, Any] | None:
    work = studio.evaluation
    if work is None:
        return None
    rows: dict[str, dict[str, Any]] = {}
    for own in work.found:
        row = rows.setdefault(own["title"], {"title": own["title"], "robots": own["robots"]})
        row["original" if own["original"] else "edited"] = own["falls"]
    return {**_work(work), "rows": list(rows.values())}


def _work(work: Work) -> dict[str, Any]:
    last = work.found[-1] if work.found else {"number": 0, "total": 0}
    return {
        "runs": work.runs,
        "problem": work.problem,
        "number": last["number"],
        "total": last["total"],
    }


def _live_terms(studio: Studio, moment: Moment) -> dict[str, Any]:
    reader, robot = studio.reader, moment.robot
    acting = next(iter(reader.acting(int(robot.rm_state.argmax()))), None)
    mirrored = acting is not None and acting.mirrored
    values, symbols = reader.evaluate(robot.observation, mirrored=mirrored)
    return {
        "values": _rounded(values, 4),
        "symbols": _rounded(symbols, 3),
        "asked": round(reader.sign(mirrored=mirrored) * sum_of(values), 4),
        "sent": None if acting is None else round(float(robot.target[acting.joint]), 4),
    }


def _step(moment: Moment, joint: int) -> list[float]:
    robot, ghost = moment.robot, moment.ghost
    return [
        int(robot.rm_state.argmax()),
        *(int(touches > 0.5) for touches in robot.foot_contact),
        round(float(robot.target[joint]), 3),
        round(float(robot.joints[joint]), 3),
        *([] if ghost is None else [round(float(ghost.joints[joint]), 3)]),
    ]


def _tiles(recent: list[Moment]) -> dict[str, Any]:
    """Returns what the tiles show: of the last second."""
    ghosts = [moment.ghost for moment in recent if moment.ghost is not None]
    robots = [moment.robot for moment in recent]
    return {"robot": _second(robots), "ghost": _second(ghosts) if ghosts else None}


def _second(samples: list) -> dict[str, float]:
    return {
        "reward": round(sum(own.reward for own in samples) * SECOND / len(samples), 2),
        "rhythm": round(sum(own.served_dwell for own in samples) / len(samples), 2),
        "speed": round(float(np.mean([own.speed for own in samples])), 2),
    }


def _rounded(values: np.ndarray, digits: int) -> list[float]:
    return np.round(np.nan_to_num(values, posinf=0.0, neginf=0.0), digits).tolist()
