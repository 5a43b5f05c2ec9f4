"""Simplification: the pull to a page, its schedule, and the run."""

from dataclasses import replace

import pandas as pd
import pytest
import torch
from tensordict import TensorDict

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.errors import InputError
from glassgait.models.files import read_yaml
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.common.policies import EXPERT, find_policies
from glassgait.studies.distillation.simplification.page_pull import PagePull
from glassgait.studies.distillation.simplification.study import (
    SIMPLIFYING,
    SimplificationConfig,
    SimplificationRun,
)
from glassgait.studies.training.environment import observed_by_actor
from glassgait.studies.training.record import read_config

TINY = SimplificationConfig(
    updates=4,
    terms=40,
    weight_rise=(0, 4),
    fit_updates=2,
    fit_samples=64,
    n_robots=8,
    worlds=DomainRandomization(n_groups=2, fine_steps=()),
    ppo=replace(SIMPLIFYING, steps_per_update=8, critic_updates=0, critic_layers=(16,), epochs=2),
)
SMALL = ["--updates", "2", "--fit-updates", "2", "--terms", "40", "--n-robots", "8"]
SMALL += ["--weight-rise", "0", "2"]
SMALL += ["--worlds.n-groups", "2", "--worlds.fine-steps", "--ppo.steps-per-update", "8"]
SMALL += ["--ppo.epochs", "1", "--ppo.critic-layers", "16"]


def begin(folder, config=TINY, **resume):
    return SimplificationRun(config, load_gait("trot"), load_expert("trot"), folder, **resume)


def silent(run, row):
    pass


class Actor:
    """An actor whose means are known."""

    def __init__(self, means):
        self.output_distribution_params = (means, torch.ones_like(means))


class Batch:
    """A mini-batch of observations."""

    def __init__(self, observations):
        own, estimate = observations[:, :-7], observations[:, -7:]
        self.observations = TensorDict(
            {"proprioception": own, "estimate": estimate}, batch_size=[len(observations)]
        )


def test_the_pull_is_the_mean_squared_difference_from_the_page():
    pull, observations = PagePull(), torch.arange(40.0).reshape(2, 20)
    means = torch.full((2, 12), 3.0, requires_grad=True)
    assert pull.compute_loss(Actor(means), Batch(observations), 2) == 0.0  # type: ignore
    pull.page = torch.nn.Linear(20, 12)
    loss = pull.compute_loss(Actor(means), Batch(observations), 2)  # type: ignore
    asked = pull.page(observations)
    assert loss.item() == pytest.approx((means - asked).square().mean().item())
    loss.backward()
    # The page stays where it is: the actor alone moves.
    assert pull.page.weight.grad is None
    torch.testing.assert_close(means.grad, (2.0 * (means - asked) / 24).detach())


def test_the_weight_rises_by_equal_factors():
    config = SimplificationConfig(first_weight=0.5, last_weight=8.0, weight_rise=(10, 50))
    weights = [config.weight(update) for update in (0, 10, 20, 30, 50, 90)]
    assert weights == pytest.approx([0.5, 0.5, 1.0, 2.0, 8.0, 8.0])


def test_a_run_leaves_an_expert_and_its_page(tmp_path):
    run = begin(tmp_path)
    run.run(silent)
    trot = load_gait("trot")
    found = find_policies(trot, tmp_path)
    assert found.expert.digest() != load_expert("trot").digest()
    assert found.expert.joint_law == load_expert("trot").joint_law
    page = found.policy("sparse_formula")
    assert isinstance(page, FormulaPolicy) and page.n_terms() <= 40
    assert page.to_text() == run.page().to_text()
    record = read_yaml(tmp_path / "trot.yaml")
    assert (record["simplification"]["terms"], record["simplification"]["last_weight"]) == (40, 2.0)
    assert read_config(tmp_path / "trot.yaml") == run.config
    curve = pd.read_csv(tmp_path / "trot.csv")
    assert curve["page_error"].isna().tolist() == [True, True, False, False]
    rising = [0.2 * 10 ** (n / 4) for n in range(4)]
    assert curve["weight"].tolist() == pytest.approx(rising, rel=1e-4)


def test_a_strong_pull_brings_the_expert_to_its_page(tmp_path):
    def gap_left(weight):
        free = replace(TINY.ppo, desired_kl=10.0, final_kl=10.0, epochs=8)
        config = replace(TINY, first_weight=weight, last_weight=weight, ppo=free)
        run = begin(tmp_path / str(weight), config)
        run.update()
        run.update()
        page, observed = run.pull.page, observed_by_actor(run.environment.observe())
        assert page is not None

        def gap():
            with torch.no_grad():
                difference = run.learner.ppo.actor.mlp(observed) - page(observed)
            return float(difference.square().mean())

        before = gap()
        run.update()
        return gap() / before

    assert gap_left(1000.0) < 0.9 < gap_left(1e-6)


def test_a_run_that_is_continued_ends_with_the_same_policies(tmp_path):
    begin(tmp_path / "whole").run(silent)
    halted = begin(tmp_path / "halted")
    for _ in range(2):
        halted.update()
    halted.save()
    halted.update()
    again = begin(tmp_path / "halted", resume=True)
    assert again.progress.update == 2
    again.run(silent)
    for made in ("trot.safetensors", "sparse_formula.formulas"):
        halted_bytes = (tmp_path / "halted" / made).read_bytes()
        assert halted_bytes == (tmp_path / "whole" / made).read_bytes()


def test_the_command_simplifies_and_goes_on(tmp_path):
    arguments = ["simplify", *SMALL, "--output", str(tmp_path)]
    main(arguments)
    main([*arguments, "--updates", "4", "--resume"])
    assert len((tmp_path / "trot.csv").read_text().splitlines()) == 1 + 4
    # What it leaves can be distilled, and simplified again.
    assert isinstance(find_policies(load_gait("trot"), tmp_path).policy(EXPERT), NeuralPolicy)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--updates", "405"], "a multiple of fit_updates = 10"),
        (["--updates", "100"], "give --weight-rise 20 80"),
        (["--fit-samples", "90"], "fewer samples than terms"),
        (["--last-weight", "1e30"], "last_weight"),
        (["--ppo.actor-layers", "8"], "layers of (256, 128, 64), which it keeps"),
        (["--terms", "493"], "ask for 12 to 492"),
        (["--n-robots", "4"], "fewer than n_groups"),
        (["--gait", "walk", "--source", str(__file__)], "--source"),
    ],
)
def test_what_cannot_be_simplified_is_refused(arguments, message, refused, tmp_path):
    folder = tmp_path / "simplified"
    assert message in refused(["simplify", *arguments, "--output", str(folder)])
    assert not folder.exists()


def test_an_expert_with_a_learned_estimator_is_refused(learned_expert):
    with pytest.raises(InputError, match=r"estimator is a network.*--senses"):
        TINY.training("trot", learned_expert)
