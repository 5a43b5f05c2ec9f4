"""Boosted trees in C: ours, and what treelite and tl2cgen compile them to.

Both are optional packages: `pip install "glassgait[tl2cgen]"`.
"""

import tempfile
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import tl2cgen
from treelite import Model
from treelite.model_builder import Metadata, ModelBuilder, PostProcessorFunc, TreeAnnotation

from glassgait.models.arrays import Array
from glassgait.models.export.controller import write_controller
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.controller import alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait
from glassgait.studies.export.files import FLAGS, compile_c, write_source
from glassgait.studies.reproduction.benchmark.controllers import (
    COUNT,
    compile_harness,
    fastest,
    run_harness,
)

LOOSE_FLAGS = tuple(flag for flag in FLAGS if not flag.startswith("-W"))
"""What others write is compiled with its warnings."""


def tree_times(
    gait: Gait,
    policy: BoostedTreesPolicy,
    expert: NeuralPolicy,
    observations: Array,
    count: int = COUNT,
) -> pd.DataFrame:
    """Times trees in C on the same observations.

    Args:
        gait: The gait.
        policy: The trees.
        expert: Their expert.
        observations: What they act on (m, n), one after the other.
        count: Actions that are timed, in each repetition; m or more.

    Returns:
        A row a writer of C: median and 99.9th percentile of an action (µs), size of the program
        that times it (kB), time to write and compile it (s), the greatest difference of an action
        from Python's, the machine's load.
    """
    rows = []
    for name, write in {"glassgait": _ours, "tl2cgen": _theirs}.items():
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            begun = time.perf_counter()
            source, objects = write(gait, policy, expert, folder)
            taken = time.perf_counter() - begun
            observations.tofile(folder / "observations.bin")
            n_rows, n_columns = observations.shape
            values = {
                "source": source,
                "count": count,
                "n_rows": n_rows,
                "n_columns": n_columns,
                "tl2cgen": name == "tl2cgen",
                "intercepts": policy.intercepts.tolist(),
            }
            program = compile_harness(folder, "tree_times.c", values, objects)
            (times,), load = fastest(lambda: run_harness(program))  # noqa: B023
            actions = np.fromfile(folder / "actions.bin").reshape(n_rows, -1)
            rows.append(
                {
                    "trees by": name,
                    "action (µs)": times.median,
                    "action, 99.9 % (µs)": times.late,
                    "program (kB)": round(program.stat().st_size / 1000),
                    "made in (s)": round(taken, 1),
                    "greatest difference": float(np.abs(actions - policy(observations)).max()),
                    "load": load,
                }
            )
    return pd.DataFrame(rows)


def _ours(
    gait: Gait, policy: BoostedTreesPolicy, expert: NeuralPolicy, folder: Path
) -> tuple[str, tuple[Path, ...]]:
    """Writes our C, which the harness includes, and returns its name."""
    own = version("glassgait")
    written = write_controller(
        gait, alone(policy, expert), name="trees", policy_name=policy.kind, version=own
    )
    source = write_source(written, folder)
    compile_c(source, folder / "trees.o", (*FLAGS, "-c"))
    return source.name, ()


def _theirs(
    gait: Gait, policy: BoostedTreesPolicy, expert: NeuralPolicy, folder: Path
) -> tuple[str, tuple[Path, ...]]:
    """Writes and compiles tl2cgen's C, a file a joint, and returns its header and its objects."""
    tl2cgen.generate_c_code(treelite_model(policy), folder, {"parallel_comp": quadruped.N_JOINTS})
    objects = []
    for source in sorted(folder.glob("*.c")):
        objects.append(source.with_suffix(".o"))
        compile_c(source, objects[-1], (*LOOSE_FLAGS, "-c"))
    return "header.h", tuple(objects)


def treelite_model(policy: BoostedTreesPolicy) -> Model:
    """Builds treelite's model of boosted trees, with a target a joint and without intercepts.

    tl2cgen 1.0 adds the first target's to all of them.
    """
    n_joints, n_trees, _ = policy.features.shape
    builder = ModelBuilder(
        threshold_type="float64",
        leaf_output_type="float64",
        metadata=Metadata(
            num_feature=len(policy.observation_names),
            task_type="kRegressor",
            average_tree_output=False,
            num_target=n_joints,
            num_class=[1] * n_joints,
            leaf_vector_shape=(1, 1),
        ),
        tree_annotation=TreeAnnotation(
            num_tree=n_joints * n_trees,
            target_id=np.repeat(np.arange(n_joints), n_trees).tolist(),
            class_id=[0] * (n_joints * n_trees),
        ),
        postprocessor=PostProcessorFunc("identity"),
        base_scores=[0.0] * n_joints,
    )
    for joint, tree in np.ndindex(n_joints, n_trees):
        asked = policy.features[joint, tree].tolist(), policy.thresholds[joint, tree].tolist()
        _add_tree(builder, *asked, policy.leaves[joint, tree].tolist())
    return builder.commit()


def _add_tree(
    builder: ModelBuilder, features: list[int], thresholds: list[float], leaves: list[float]
) -> None:
    """Adds a complete tree, without the questions that all go left of."""

    def asking(node: int) -> int:
        while node < len(thresholds) and thresholds[node] == np.inf:
            node = 2 * node + 1
        return node

    builder.start_tree()
    pending = [asking(0)]
    while pending:
        node = pending.pop()
        builder.start_node(node)
        if node >= len(thresholds):
            builder.leaf(leaves[node - len(thresholds)])
        else:
            left, right = asking(2 * node + 1), asking(2 * node + 2)
            builder.numerical_test(
                features[node],
                thresholds[node],
                default_left=True,
                opname="<=",
                left_child_key=left,
                right_child_key=right,
            )
            pending += [left, right]
        builder.end_node()
    builder.end_tree()
