"""A policy with its estimator as one ONNX file, compared with Python by ONNX Runtime."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.export.controller import refuse_other_than_names
from glassgait.models.export.graphs.policy_graph import write_graph
from glassgait.models.export.graphs.runtime import LoadedGraph
from glassgait.models.export.language import Real
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.command import sample_commands
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import N_ESTIMATED, OVERDUE, proprioception
from glassgait.models.task.odometry import Odometry
from glassgait.studies.common.console import say
from glassgait.studies.export.agreement import (
    SEQUENCE_STEPS,
    random_readings,
    recorded_observations,
)
from glassgait.studies.export.closed_loop import by_graph
from glassgait.studies.export.files import Deployment, Effort, Exported

MOST = 1e-6
"""Greatest difference of a joint target (rad), or of an estimate, with which a graph is written."""


@dataclass(frozen=True)
class GraphAgreement:
    """How far a graph and Python are apart on the same observations.

    Attributes:
        rows: Observations.
        target: Greatest difference of a joint target (rad).
        estimate: Greatest difference of the estimated velocity (0.5 m/s) or of a foot's height (m).
    """

    rows: int
    target: float
    estimate: float


def compare_graph(
    graph: LoadedGraph, policy: Policy, expert: Policy, rows: Array
) -> GraphAgreement:
    """Lets both act on the same rows, rounded to what the graph reads.

    Args:
        graph: The graph.
        policy: The policy that acts.
        expert: Its estimator observes, unless the graph reads the estimate.
        rows: Proprioception (m, 40 + n_states), and behind it the estimate if the graph reads one.
    """
    rounded = rows.astype(graph.dtype).astype(float)
    if graph.reads_estimate:
        own, estimate = np.split(rounded, [-N_ESTIMATED], axis=1)
    else:
        assert callable(expert.estimator)
        own, estimate = rounded, expert.estimator(rounded)
    action, acted = policy(np.concatenate([own, estimate], axis=-1)), graph(own, estimate)
    return GraphAgreement(
        len(rows),
        expert.robot.action_scale * _apart(acted.action, action),
        _apart(acted.estimate, estimate),
    )


def check_graph(
    graph: LoadedGraph, policy: Policy, expert: Policy, rows: Mapping[str, Array]
) -> pd.DataFrame:
    """Compares a graph with Python on rows from several sources, by their names.

    Raises:
        InputError: if they differ by more than `MOST`.
    """
    found = {name: compare_graph(graph, policy, expert, own) for name, own in rows.items()}
    greatest = max(max(one.target, one.estimate) for one in found.values())
    if greatest > MOST:
        raise InputError(
            f"the ONNX graph of this {policy.kind} policy differs from Python by {greatest:.2g}, "
            f"more than {MOST:g}; nothing was written, so export it with --precision double or "
            "--format c"
        )
    return pd.DataFrame({"observations": name, **asdict(one)} for name, one in found.items())


def recorded_rows(gait: Gait, controller: AlternatingController, n_rows: int, seed: int) -> Array:
    """Records what a graph reads (m, n) of robots that the controller moves."""
    n_robots = max(1, round(n_rows / SEQUENCE_STEPS))
    n_steps = -(-n_rows // n_robots)
    observations = recorded_observations(gait, controller, n_robots, n_steps, seed)
    has_odometry = isinstance(controller.estimator, Odometry)
    return observations[:n_rows, : None if has_odometry else -N_ESTIMATED]


def random_rows(
    robot: Robot,
    gait: Gait,
    n_rows: int,
    seed: int,
    *,
    imu: bool = False,
    estimate: bool = False,
) -> Array:
    """Draws what a graph reads (m, n): joints and last targets anywhere in their ranges.

    Args:
        robot: The robot.
        gait: The gait.
        n_rows: Number of rows (m).
        seed: Seed of what is drawn.
        imu: Whether it observes gravity's direction and the angular velocity.
        estimate: Whether it reads the estimate.
    """
    of_trunk = np.random.default_rng([seed, 1])
    generator = np.random.default_rng(seed)
    command = sample_commands(gait, n_rows, generator)
    shape = (n_rows, quadruped.N_JOINTS)
    position, target = (
        generator.uniform(robot.lower_limits, robot.upper_limits, size=shape) for _ in range(2)
    )
    counts = generator.integers(gait.dwell[1] + OVERDUE, endpoint=True, size=n_rows)
    own = proprioception(
        robot,
        command=command.velocity,
        joint_position=position,
        joint_velocity=generator.uniform(-robot.velocity, robot.velocity, size=shape),
        previous_action=(target - robot.default_stance) / robot.action_scale,
        rm_state=np.eye(gait.n_states)[generator.integers(gait.n_states, size=n_rows)],
        rm_iterations=counts.astype(float),
        commanded_dwell=command.dwell,
        imu=random_readings(n_rows, of_trunk) if imu else None,
    )
    body = of_trunk.normal(size=(n_rows, N_ESTIMATED if estimate else 0))
    return np.concatenate([own, body], axis=1)


def _apart(graph: Array, python: Array) -> float:
    """Returns the greatest difference; numbers that are finite in neither do not differ."""
    neither = ~np.isfinite(graph) & ~np.isfinite(python)
    difference = np.abs(np.where(neither, 0.0, graph) - np.where(neither, 0.0, python))
    return float(np.max(np.nan_to_num(difference, nan=np.inf), initial=0.0))


class OnnxFile(Exported):
    """The policy of one gait as a graph, from what is measured and known to actions."""

    title = "ONNX"

    def __init__(self, deployment: Deployment, real: Real) -> None:
        """
        Raises:
            InputError: if there is no graph for it, or its name can name no controller.
        """
        super().__init__(deployment, real)
        refuse_other_than_names(deployment.name)
        assert isinstance(deployment.gait, Gait)
        self.gait, self.policy = deployment.gait, deployment.controller.policy
        model = write_graph(
            self.gait,
            deployment.controller,
            policy_name=deployment.policy_name,
            version=version("glassgait"),
            real=real,
        )
        self.model: bytes = model.SerializeToString(deterministic=True)

    def check(self, effort: Effort) -> dict[str, pd.DataFrame]:
        graph, recorded, seed = LoadedGraph(self.model), effort.n_recorded, effort.seed
        say(f"acting on {effort.n_steps} observations, in Python and by ONNX Runtime")
        policy, controller = self.policy, self.deployment.controller
        rows = {
            "recorded": recorded_rows(self.gait, controller, recorded, seed),
            "random": random_rows(
                policy.robot,
                self.gait,
                effort.n_steps - recorded,
                seed,
                imu=policy.layout.imu,
                estimate=graph.reads_estimate,
            ),
        }
        agreement = check_graph(graph, policy, controller.expert, rows)
        return {"agreement": agreement} | self._walked(by_graph(graph), effort)

    def write(self, folder: Path) -> tuple[Path, ...]:
        path = folder / f"{self.deployment.name}.onnx"
        write_atomically(path, self.model)
        return (path,)
