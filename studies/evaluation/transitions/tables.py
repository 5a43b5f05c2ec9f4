"""Tables of transitions: a row each pair of gaits, and the pairs that fall."""

import pandas as pd

from glassgait.studies.distillation.students.registry import policy_title

KEYS = ["policy", "scenario", "from", "to", "speed"]

TITLES = {
    "policy": "policy",
    "world": "scenario",
    "from": "from",
    "to": "to",
    "speed": "speed (m/s)",
    "robots": "robots",
    "falls": "falls",
    "before": "of them before the request",
    "wait": "wait (s)",
    "longest_wait": "longest wait (s)",
    "settling": "rhythm kept after (s)",
    "longest_settling": "at the latest after (s)",
    "unsettled": "never kept",
    "share": "share of the return",
}
"""What people call the columns of `transition_table`."""


def transition_table(robots: pd.DataFrame) -> pd.DataFrame:
    """Sums up every pair of gaits at every speed, in the order in which they were rolled out.

    Args:
        robots: What `roll_transition` returned of every pair, and of every gait that does not
            change.

    Returns:
        A row a policy, world, pair and speed: robots, their falls, how many of these came before
        the request; means and greatest values of `wait` and `settling` (s); robots whose rhythm was
        never kept; the share of the reward that robots earn which walked in the new gait all the
        time.
    """
    groups = robots.groupby(KEYS, sort=False)
    table = groups.agg(
        robots=("robot", "size"),
        falls=("fell", "sum"),
        before=("before", "sum"),
        wait=("wait", "mean"),
        longest_wait=("wait", "max"),
        settling=("settling", "mean"),
        longest_settling=("settling", "max"),
        unsettled=("settling", lambda own: int(own.isna().sum())),
        reward=("reward", "mean"),
    ).reset_index()
    stayed = table["from"] == table["to"]
    references = table[stayed].set_index(["policy", "scenario", "to", "speed"])["reward"]
    own = pd.MultiIndex.from_frame(table[["policy", "scenario", "to", "speed"]])
    table["share"] = table["reward"].to_numpy() / references.reindex(own).to_numpy()
    return table


def readable_table(table: pd.DataFrame, titles: dict[str, str]) -> pd.DataFrame:
    """Names the policies, worlds and columns of `transition_table` as people do.

    Args:
        table: What `transition_table` returned.
        titles: What people call each scenario.
    """
    named = table.assign(
        policy=[policy_title(name) for name in table["policy"]],
        world=[titles[name] for name in table["scenario"]],
    )
    return named[list(TITLES)].rename(columns=TITLES)


def summary_table(table: pd.DataFrame, titles: dict[str, str]) -> pd.DataFrame:
    """Tells of each policy and world how many pairs change without a fall, and which do not."""
    pairs = table[table["from"] != table["to"]]
    rows = []
    for (policy, scenario), own in pairs.groupby(["policy", "scenario"], sort=False):
        falls = own.groupby(["from", "to"], sort=False)["falls"].sum()
        ends = zip(*(falls.index.get_level_values(name) for name in ("from", "to")), strict=True)
        told = [
            f"{source} to {target} {count}"
            for (source, target), count in zip(ends, falls, strict=True)
            if count > 0
        ]
        rows.append(
            {
                "policy": policy_title(str(policy)),
                "scenario": titles[str(scenario)],
                "pairs without a fall": f"{(falls == 0).sum()} of {len(falls)}",
                "falls": f"{falls.sum()} of {own['robots'].sum()}",
                "who falls": ", ".join(told) or "–",
                "longest wait (s)": own["longest_wait"].max(),
            }
        )
    return pd.DataFrame(rows)
