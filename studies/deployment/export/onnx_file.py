"""A policy with its estimator as one ONNX file, compared with Python by ONNX Runtime."""

from importlib.metadata import version
from pathlib import Path

import pandas as pd

from glassgait.models.export.controller import refuse_other_than_names
from glassgait.models.export.graphs.policy_graph import write_graph
from glassgait.models.export.graphs.runtime import LoadedGraph
from glassgait.models.export.language import Real
from glassgait.models.files import write_atomically
from glassgait.studies.common.console import say
from glassgait.studies.deployment.export.closed_loop import by_graph
from glassgait.studies.deployment.export.exported import Acting, Effort, ExportedPolicy
from glassgait.studies.deployment.export.graph_agreement import (
    check_graph,
    random_rows,
    recorded_rows,
)


class OnnxFile(ExportedPolicy):
    """A policy as a graph, from what is measured and known to actions."""

    title = "ONNX"

    def __init__(self, acting: Acting, real: Real) -> None:
        """
        Args:
            acting: What is exported.
            real: Type of what the graph reads and gives.

        Raises:
            InputError: if there is no graph for it, or its name can name no controller.
        """
        super().__init__(acting)
        refuse_other_than_names(acting.name)
        model = write_graph(
            acting.gait,
            acting.policy,
            acting.expert,
            policy_name=acting.policy_name,
            version=version("glassgait"),
            real=real,
        )
        self.model: bytes = model.SerializeToString(deterministic=True)

    def check(self, effort: Effort) -> dict[str, pd.DataFrame]:
        gait, policy, expert = self.acting.gait, self.acting.policy, self.acting.expert
        graph, recorded, seed = LoadedGraph(self.model), effort.n_recorded, effort.seed
        say(f"acting on {effort.n_steps} observations, in Python and by ONNX Runtime")
        rows = {
            "recorded": recorded_rows(gait, policy, expert, recorded, seed),
            "random": random_rows(policy.robot, gait, effort.n_steps - recorded, seed),
        }
        agreement = check_graph(graph, policy, expert, rows)
        return {"agreement": agreement} | self._walked(by_graph(graph), effort)

    def write(self, folder: Path) -> tuple[Path, ...]:
        path = folder / f"{self.acting.name}.onnx"
        write_atomically(path, self.model)
        return (path,)
