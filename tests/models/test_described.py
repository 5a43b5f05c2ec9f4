"""Networks of other projects: descriptions, frames, history and actions."""

import pickle

import numpy as np
import pytest
import torch
from rsl_rl.modules import EmpiricalNormalization

from glassgait.models.errors import InputError
from glassgait.models.policies.described import load_described
from glassgait.models.policies.library import load_policy
from glassgait.models.task.command import Command
from glassgait.models.task.gait import gait_lines, load_gait, parse_gait
from glassgait.models.task.observation import proprioception

ORDER = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]


def observe(policy, generator, *, action=None, command=(0.5, 0.3)):
    """Returns the policy's observation of two robots, and the quantities in it."""
    told = {
        "joint_position": generator.normal(size=(2, 12)),
        "joint_velocity": generator.normal(size=(2, 12)),
        "previous_action": generator.normal(size=(2, 12)) if action is None else action,
        "imu": generator.normal(size=(2, 9)),
    }
    rest = {"rm_state": np.ones((2, 1)), "rm_iterations": np.zeros(2)}
    command = Command(np.tile(command, (2, 1)), np.full(2, 8.0))
    observed = proprioception(
        policy.robot, command=command.velocity, commanded_dwell=command.dwell, **told, **rest
    )
    return np.concatenate([observed, np.zeros((2, 7))], axis=1), told


def test_a_frame_has_the_terms_in_order_with_their_scales_and_the_network_s_joints(
    describe, generator
):
    policy = load_described(describe(("length: 3", "length: 1"), size=47))
    start = np.full((2, policy.n_memory), np.nan)
    first, _ = observe(policy, generator)
    observation, told = observe(policy, generator, command=(-0.9, 0.4))
    memory = policy.remember(policy.remember(start, first), observation)
    default = np.tile([0.0, 0.8, -1.5], 4)
    target = policy.robot.default_stance + 0.25 * told["previous_action"]
    last = (target - default) / np.tile([0.125, 0.25, 0.25], 4)
    phase = 2.0 * np.pi * 0.02 / 0.5
    expected = [
        0.25 * told["imu"][:, :3],
        told["imu"][:, 6:],
        np.tile([2.0 * -0.6, 0.0, 0.25 * 0.4], (2, 1)),  # within the range of commands
        (told["joint_position"] - default)[:, ORDER],
        0.05 * told["joint_velocity"][:, ORDER],
        last[:, ORDER],
        np.tile([np.sin(phase), np.cos(phase)], (2, 1)),
    ]
    np.testing.assert_allclose(
        memory[:, 1:], np.clip(np.concatenate(expected, axis=1), -10.0, 10.0), atol=1e-12
    )


@pytest.mark.parametrize("start", ["zeros", "repeat"])
@pytest.mark.parametrize("order", ["newest_first", "oldest_first"])
@pytest.mark.parametrize("by", ["frame", "term"])
def test_a_history_begins_and_is_ordered_as_described(describe, generator, start, order, by):
    changes = (
        ("start: zeros", f"start: {start}"),
        ("newest_first", order),
        ("by: term", f"by: {by}"),
    )
    policy = load_described(describe(*changes))
    memory, frames = np.full((2, policy.n_memory), np.nan), []
    for _ in range(2):
        memory = policy.remember(memory, observe(policy, generator)[0])
        frames.append(memory[:, -47:])
    frames.insert(0, np.zeros_like(frames[0]) if start == "zeros" else frames[0])
    frames = frames[::-1] if order == "newest_first" else frames
    cuts = [3, 6, 9, 21, 33, 45] if by == "term" else []
    terms = zip(*(np.split(frame, cuts, axis=1) for frame in frames), strict=True)
    expected = np.concatenate([part for term in terms for part in term], axis=1)
    np.testing.assert_array_equal(memory[:, policy._input_order], expected)


def test_robots_are_commanded_to_the_left_within_the_described_range(describe, generator):
    path = describe(
        ("length: 3", "length: 1"), ("{forward", "{left: [-0.2, 0.2], forward"), size=47
    )
    policy = load_described(path)
    start, (observation, _) = np.full((2, policy.n_memory), np.nan), observe(policy, generator)
    ahead = policy.remember(start, observation)
    sideways = policy.commanded_left(np.array([0.1, -0.5])).remember(start, observation)
    changed = np.zeros_like(ahead)
    changed[:, [*policy.inputs].index("command left") + 1] = [2.0 * 0.1, 2.0 * -0.2]
    np.testing.assert_allclose(sideways - ahead, changed, atol=1e-12)


def test_a_network_that_repeats_its_action_repeats_the_joints_targets(describe, generator):
    weights = np.zeros((47, 12))
    weights[33:45] = np.eye(12)
    path = describe(("length: 3", "length: 1"), ("action: 4.0", "action: 9.0"), weights=weights)
    policy = load_described(path)
    action = 0.5 * generator.normal(size=(2, 12))
    memory = np.full((2, policy.n_memory), np.nan)
    for _ in range(2):
        memory = policy.remember(memory, observe(policy, generator, action=action)[0])
    np.testing.assert_allclose(policy(memory), action, atol=1e-6)
    # At the first step, the last action is the network's zero.
    first = policy.remember(np.full_like(memory, np.nan), observe(policy, generator)[0])
    targets = policy.robot.joint_targets(policy(first))
    np.testing.assert_allclose(targets, np.tile([0.0, 0.8, -1.5], (2, 4)), atol=1e-6)


def test_it_is_kept_in_a_file_and_sent_to_another_process(describe, generator, tmp_path):
    policy = load_described(describe())
    memory = policy.remember(np.full((2, policy.n_memory), np.nan), observe(policy, generator)[0])
    expected = policy(memory)
    policy.save(tmp_path / "expert.safetensors")
    for other in (load_policy(tmp_path / "expert.safetensors"), pickle.loads(pickle.dumps(policy))):
        assert (other.digest(), other.joint_law) == (policy.digest(), policy.joint_law)
        assert (other.joint_law.gains, other.remembers, other.symmetric) == ((30.0, 0.7), 1, 0)
        np.testing.assert_array_equal(other(memory), expected)
    changed = load_described(describe(("scale: 0.25", "scale: 0.26")))
    assert changed.digest() != policy.digest()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("term: gravity", "term: height_scan", "'height_scan' is a scan of the ground; give"),
        ("term: gravity", "term: gravty", "unknown observation term 'gravty', perhaps 'gravity'"),
        ("{term: gravity}", "{term: gravity, scale: [1.0, 2.0]}", "'gravity' has 2 numbers"),
        ("period: 0.5", "scale: 1.0", "'period' belongs to the term 'clock'"),
        ("length: 3", "length: 2", "takes 141 numbers, but .* are 2 × 47; correct"),
        ("robot: go2", "robot: spot", "unknown robot 'spot'"),
        ("weights:", "period: 0.01\nweights:", "period is 0.01 s; give"),
        ("FR_hip, ", "FL_hip, ", "joints is .*; list these"),
        ("hip: 0.0, ", "", "default lacks FL_hip; add it"),
        ("hip: 0.0", "knee: 0.0", "'default.knee' names no joint"),
        ("hip: 0.125", "hip: 0", "action_scale is 0"),
        ("damping: 0.7", "damping: {hip: 1, thigh: 2, calf: -1}", "gains.damping.calf is -1; it"),
        ("hip: 0.0", "hip: 1.0e+9", "default.hip is .*; it must"),
        ("period: 0.5", "period: 1.0e-9", r"observation\[6\].period is .*; it must"),
        ("stiffness: 30.0", "stiffness: {hip: 20}", "stiffness lacks FL_thigh"),
        ("tiny.onnx", "tiny.pt", "tiny.pt: cannot be read, no such file"),
        ("tiny.onnx", '"a\\0b.onnx"', "null character"),
    ],
)
def test_bad_descriptions_are_refused_in_one_sentence(describe, old, new, message):
    path = describe((old, new))
    with pytest.raises(InputError, match=message) as raised:
        load_described(path)
    assert str(path.parent) in str(raised.value)
    assert len(str(raised.value)) < 500


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (np.full((141, 12), np.nan), "'weights' is not finite"),
        (np.ones((141, 10)), r"to actions .robots, 12"),
    ],
)
def test_bad_weights_are_refused(describe, weights, message):
    with pytest.raises(InputError, match=message):
        load_described(describe(weights=weights))


def test_networks_act_in_double_precision_and_must_take_one_robot(describe, tmp_path):
    path, weights, onnx = describe(), tmp_path / "tiny.onnx", pytest.importorskip("onnx")
    memory = np.ones((2, load_described(path).n_memory))
    expected, model = load_described(path)(memory), onnx.load(weights)
    graph, double = model.graph, onnx.TensorProto.DOUBLE
    for value in (graph.input[0], graph.output[0]):
        value.type.tensor_type.elem_type = double
    numbers = onnx.numpy_helper.to_array(graph.initializer[0]).astype(float)
    graph.initializer[0].CopyFrom(onnx.numpy_helper.from_array(numbers, "weights"))
    onnx.save(model, weights)
    np.testing.assert_allclose(load_described(path)(memory), expected, atol=1e-6)
    graph.input[0].type.tensor_type.shape.dim[0].dim_value = 4
    onnx.save(model, weights)
    with pytest.raises(InputError, match=r"cannot act .*; give a network from one array"):
        load_described(path)


class Actor(torch.nn.Module):
    """An actor as in rsl_rl, for two sizes of observations with a normaliser."""

    def __init__(self, name, normalizer):
        super().__init__()
        layers = [torch.nn.Linear(141, 8), torch.nn.ELU(), torch.nn.Linear(8, 12)]
        self.add_module(name, torch.nn.Sequential(*layers))
        self.add_module(normalizer, EmpiricalNormalization(141))
        self.parts = self._modules[normalizer], self._modules[name]
        self.parts[0].update(3.0 + 2.0 * torch.randn(500, 141))

    def forward(self, x):
        return self.parts[1](self.parts[0](x))


@pytest.mark.parametrize("version", [2, 4, 5])
def test_the_actor_of_a_checkpoint_acts_as_in_rsl_rl(describe, tmp_path, version):
    names = ("mlp", "obs_normalizer") if version == 5 else ("actor", "actor_obs_normalizer")
    actor = Actor(*names)
    state = actor.state_dict() | {"std": torch.ones(12)}
    saved = {"actor_state_dict" if version == 5 else "model_state_dict": state}
    if version == 2:
        saved = {"model_state_dict": {k: x for k, x in state.items() if "norm" not in k}}
        saved["obs_norm_state_dict"] = actor.parts[0].state_dict()
    torch.save(saved | {"iter": 7, "infos": None}, tmp_path / "tiny.pt")
    policy = load_described(describe(("tiny.onnx", "tiny.pt")))
    seen = torch.randn(5, 141)
    expected = actor.eval()(seen).detach()
    np.testing.assert_allclose(policy._network(seen.numpy()), expected, atol=1e-5)


def tensors(*shape):
    return {f"actor.0.{name}": x for name, x in torch.nn.Linear(*shape).state_dict().items()}


NORMALIZER = {f"actor_obs_normalizer.{name}": torch.ones(1, 9) for name in ("_mean", "_std")}


@pytest.mark.parametrize(
    ("saved", "message"),
    [
        (tensors(9, 12), "takes 9 numbers, but history and observation are 3 × 47"),
        (tensors(141, 12) | NORMALIZER, r"shapes \(12,141\) \(1,9\).*; give an ONNX file"),
        ({"memory_a.weight": torch.ones(2, 2)}, r"'memory_a.weight'.*; give an ONNX file"),
        ({"std": torch.ones(12)}, r"'std'.*, so it is no actor"),
        (torch.nn.Linear(141, 12), "is no checkpoint of tensors"),
    ],
)
def test_checkpoints_of_anything_but_an_actor_of_that_size_are_refused(
    describe, tmp_path, saved, message
):
    path = describe(("tiny.onnx", "tiny.pt"))
    torch.save({"model_state_dict": saved}, tmp_path / "tiny.pt")
    with pytest.raises(InputError, match=message):
        load_described(path)


def test_torchscript_is_refused_with_the_command_that_exports_it(describe, tmp_path):
    path = describe(("tiny.onnx", "tiny.pt"))
    torch.jit.script(torch.nn.Linear(141, 12)).save(tmp_path / "tiny.pt")
    with pytest.raises(InputError, match=r"TorchScript.*jit.load\('tiny.pt'\).*dynamo=False"):
        load_described(path)


def test_a_gait_without_transitions_is_a_machine_of_one_state():
    free = load_gait("free")
    assert (free.n_states, free.transitions) == (1, ())
    assert parse_gait("\n".join(gait_lines(free)), name="free") == free
