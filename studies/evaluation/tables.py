"""Tables of closed-loop scores."""

import pandas as pd

from studies.evaluation.scores import summarize

POLICY_TITLES = {
    "expert": "Neural expert",
    "linear": "Linear",
    "statewise_linear": "Linear per RM state",
    "gbm": "GBM",
    "ebm": "EBM",
    "symbolic": "Symbolic",
}


def alternation_table(scores: pd.DataFrame) -> pd.DataFrame:
    """Means of every policy at every ratio."""
    return summarize(scores, ["policy", "ratio"])


def standalone_table(scores: pd.DataFrame) -> pd.DataFrame:
    """The students alone beside the expert alone: the table that matters."""
    means = alternation_table(scores)
    expert = means[means["policy"] == "expert"].iloc[0]
    alone = means[(means["policy"] == "expert") | (means["ratio"] == "0")]
    return pd.DataFrame(
        {
            "policy": [POLICY_TITLES[name] for name in alone["policy"]],
            "reward": _with_interval(alone, "reward", 0),
            "share of expert": (alone["reward"] / expert["reward"]).round(3),
            "plain reward": _with_interval(alone, "plain_reward", 1),
            "falls": [
                f"{falls} of {n}" for falls, n in zip(alone["falls"], alone["robots"], strict=True)
            ],
            "rhythm": alone["rhythm"].round(3),
            "speed error (m/s)": alone["speed_error"].round(3),
            "yaw-rate error (rad/s)": alone["yaw_rate_error"].round(3),
        }
    )


def world_table(scores: pd.DataFrame) -> pd.DataFrame:
    """One policy in every world."""
    means = summarize(scores, ["world"])
    return pd.DataFrame(
        {
            "world": means["world"],
            "falls": [
                f"{falls} of {n}" for falls, n in zip(means["falls"], means["robots"], strict=True)
            ],
            "speed error (m/s)": _with_interval(means, "speed_error", 3),
            "yaw-rate error (rad/s)": _with_interval(means, "yaw_rate_error", 3),
            "rhythm": _with_interval(means, "rhythm", 3),
            "reward": _with_interval(means, "reward", 0),
            "plain reward": _with_interval(means, "plain_reward", 1),
        }
    )


def _with_interval(means: pd.DataFrame, name: str, digits: int) -> list[str]:
    pairs = zip(means[name], means[f"{name}_ci"], strict=True)
    return [f"{mean:,.{digits}f} ± {half:,.{digits}f}" for mean, half in pairs]
