"""Compiled controllers and a robot's day over both wires: as in Python, and as in one diagram."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.lcm import DrakeLcm

from glassgait.diagrams.acting import CompiledActing, PolicyActing
from glassgait.diagrams.answering import Answering
from glassgait.diagrams.commands import FixedCommand, SliderCommand
from glassgait.diagrams.link import ControllerEnd, RobotEnd
from glassgait.diagrams.linked_controller import MakeAnsweringController
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.unitree_controller_end import UnitreeControllerEnd
from glassgait.diagrams.unitree_robot_end import UNTOUCHED, Drive, UnitreeRobotEnd
from glassgait.models.errors import InputError
from glassgait.models.export.contract import CONTRACT
from glassgait.models.link.channels import Channels
from glassgait.models.link.dds import Heard
from glassgait.models.link.messages import command_t, sensors_t
from glassgait.models.link.motors import unpack_low_cmd
from glassgait.models.link.operator import RemoteOperator
from glassgait.models.link.remote import REQUESTED_BY, Button, Remote, Sticks, write_remote
from glassgait.models.link.supervision import Fault, Stage, Supervision
from glassgait.models.link.watchdog import Phase, Watchdog
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.day import REQUESTS, load_day, lying_state
from glassgait.models.task.gait import load_gait
from glassgait.models.task.request import RequestGate
from glassgait.studies.export.files import (
    CFile,
    Deployment,
    has_compiler,
    load_contract,
)

A1, DAY, TROT = load_robot(), load_day(), load_gait("trot")
PARTS = ((40, "sit"), (180, "stand"), (60, "walk"), (40, "stand"), (140, "sit"))
"""Control steps, and what is requested in them."""
ORDER = ["rest", "fold", "rise", "stand", "walk", "stand", "sit", "rest"]
CALM = Scenario(sensor_noise=0.0, command=FixedCommand(speed=0.4, dwell=8))
LYING = 0.06
"""Height of the trunk that lies, at most (m)."""


@pytest.fixture(scope="module")
def page():
    return alone(load_student("trot", "sparse_formula"), load_expert("trot"))


@pytest.fixture(scope="module")
def compiled(page, tmp_path_factory):
    """Loads what was exported by its contract, with a day and without."""
    if not has_compiler():
        pytest.skip("needs a C compiler, cc")

    def load(day):
        folder = tmp_path_factory.mktemp("exported")
        CFile(Deployment(TROT, page, "page", "page", day), "double").write_all(folder)
        contract, loaded, robot = load_contract(folder / CONTRACT, tmp_path_factory.mktemp("so"))
        return CompiledActing(robot, loaded, contract, day)

    return {"day": load(DAY), "always": load(None)}


class Shadow:
    """Answers what another controller is asked, beside it."""

    def __init__(self, acting):
        self.diagram = MakeAnsweringController(acting)
        self.answering, self.n_answers = Answering(self.diagram), 0

    def take(self, sensors, command):
        self.answering.take(sensors, command)
        self.n_answers += 1
        return self.answer

    @property
    def answer(self):
        context = self.answering.simulator.get_context()
        return self.diagram.GetOutputPort("targets").Eval(context)

    @property
    def mode(self):
        context = self.answering.simulator.get_context()
        return DAY.names[int(self.diagram.GetOutputPort("mode").Eval(context)[0])]


def same(answer, other):
    """Compares two answers."""
    np.testing.assert_allclose(answer.joint_position, other.joint_position, rtol=0, atol=1e-6)
    assert answer.damped == other.damped


class Lcm:
    """Both ends over LCM, in one process and simulated time, and a shadow beside them."""

    def __init__(self, gait, acting, shadow, day=None, *, scenario=CALM, meshcat=None):
        self.lcm, channels = DrakeLcm("memq://"), Channels("DAY_")
        self.robot = RobotEnd(
            gait,
            scenario,
            self.lcm,
            channels,
            watchdog=Watchdog(),
            session=4,
            seed=3,
            meshcat=meshcat,
            day=day,
        )
        self.controller, self.shadow = ControllerEnd(acting, self.lcm, channels), Shadow(shadow)
        self.command = command_t()
        self.lcm.Subscribe(channels.command, self._hear_command)
        self.lcm.Subscribe(
            channels.sensors, lambda data: self.shadow.take(sensors_t.decode(data), self.command)
        )

    def _hear_command(self, data):
        self.command = command_t.decode(data)

    def run(self, n_steps, *, answered=True):
        """Returns states before each step, modes and phases."""
        states, modes, phases = [], [], []
        for _ in range(n_steps):
            states.append(self.robot.output("state").copy())
            self.robot.send()
            for part in range(self.robot.n_parts):
                if part == 0 and answered:
                    self.lcm.HandleSubscriptions(0)
                    assert self.controller.answer()
                    context = self.controller.simulator.get_context()
                    sender = self.controller.diagram.GetSubsystemByName("targets_sender")
                    own = sender.get_message_output_port().Eval(
                        sender.GetMyContextFromRoot(context)
                    )
                    same(own, self.shadow.answer)
                    if self.robot._lives:
                        modes.append(self.shadow.mode)
                self.robot.advance(part)
            phases.append(self.robot.phase)
        return np.array(states), modes, phases


def order(names):
    return [name for i, name in enumerate(names) if i == 0 or name != names[i - 1]]


def test_a_compiled_controller_moves_the_robot_over_lcm_as_one_diagram_does(trot, page, compiled):
    ends = Lcm(trot, compiled["always"], PolicyActing(A1, trot, page))
    states, _, phases = ends.run(60)
    assert set(phases) == {Phase.FOLLOWING}
    one = record(make_simulator(MakeLocomotion(trot, CALM, policy=page), seed=3), 60)
    np.testing.assert_allclose(states, one["state"][:-1], rtol=0, atol=1e-6)
    assert kinematics.foot_heights(A1, states).max() > 0.02


def test_a_robot_lives_through_its_day_over_lcm_as_in_one_diagram(trot, page, compiled):
    """Compiled C acts; Python answers the same beside it, and moves a robot without messages."""
    ends = Lcm(trot, compiled["day"], PolicyActing(A1, trot, page, DAY), day=DAY)
    diagram = MakeLocomotion(trot, CALM, policy=page, day=DAY)
    lying = lying_state(A1, DAY, np.zeros((1, quadruped.N_JOINTS)))[0]
    one = make_simulator(diagram, state=lying)
    heights, modes, phases = [], [], []
    for n_steps, name in PARTS:
        ends.robot.request_mode(name)
        states, own_modes, own_phases = ends.run(n_steps)
        modes, phases = modes + own_modes, phases + own_phases
        requested = [float(REQUESTS.index(name))]
        diagram.GetInputPort("requested_mode").FixValue(one.get_mutable_context(), requested)
        found = record(one, n_steps, stop_on_failure=False)
        assert own_modes == [DAY.names[int(mode)] for mode in found["mode"][:-1].ravel()]
        heights.append(np.abs(states[:, 6] - found["state"][:-1, 6]))
        if name == "walk":
            ahead = [one_state[-1, 4] - one_state[0, 4] for one_state in (states, found["state"])]
    assert order(modes) == ORDER
    assert order(phases) == [Phase.DAMPED, Phase.FOLLOWING, Phase.DAMPED]
    # Damped joints brake at each step of the plant, and in one diagram are sent to where they are
    # at each control step: so robots lie a little otherwise before they rise.
    assert np.concatenate(heights)[30:].max() < 0.005
    assert ahead[0] > 0.25
    assert abs(ahead[0] - ahead[1]) < 0.05
    assert ends.robot.output("state")[6] < LYING


def test_a_damped_robot_stays_so_without_its_controller_and_goes_on_with_it(trot, page):
    acting = PolicyActing(A1, trot, page, DAY)
    ends = Lcm(trot, acting, acting, day=DAY)
    ends.robot.request_mode("sit")
    ends.run(40)
    states, _, phases = ends.run(100, answered=False)
    assert phases[-1] is Phase.LEFT
    assert states[-1, 6] < LYING
    ends.robot.request_mode("stand")
    _, modes, phases = ends.run(200)
    assert order(modes)[-1] == "stand"
    assert phases[-1] is Phase.FOLLOWING
    # Walking off without a controller: it is lowered, and a day that begins anew damps it.
    ends.run(80, answered=False)
    assert ends.robot.phase is Phase.LOWERED
    ends.robot.request_mode("sit")
    _, _, phases = ends.run(60)
    assert phases[-1] is Phase.DAMPED
    assert not ends.robot.fallen


def test_a_click_on_walk_while_the_robot_rises_is_dropped_over_lcm(
    trot, page, meshcat, click, caplog
):
    acting = PolicyActing(A1, trot, page, DAY)
    world = replace(CALM, command=SliderCommand(attended=True))
    ends = Lcm(trot, acting, acting, day=DAY, scenario=world, meshcat=meshcat)
    click("walk")  # Before any controller answers.
    ends.run(3, answered=False)
    ends.run(20)
    assert ends.command.requested_mode == REQUESTS.index("sit")
    click("stand")
    _, modes, _ = ends.run(80)
    assert modes[-1] == "rise"
    click("walk")
    _, modes, _ = ends.run(80)
    assert modes[-1] == "stand"
    assert ends.command.requested_mode == REQUESTS.index("stand")
    assert "walk *" not in meshcat.GetButtonNames()
    assert len(caplog.records) == 2
    click("walk")
    ends.run(3)
    assert ends.command.requested_mode == REQUESTS.index("walk")


def test_over_lcm_a_robot_of_another_day_takes_no_click(trot, page, meshcat, click, caplog):
    """Modes have their numbers by the controller's day, which the robot does not know."""
    acting, other = PolicyActing(A1, trot, page, DAY), replace(DAY, description="another")
    world = replace(CALM, command=SliderCommand(attended=True))
    ends = Lcm(trot, acting, acting, day=other, scenario=world, meshcat=meshcat)
    ends.run(10)
    click("stand")
    ends.run(3)
    assert ends.command.requested_mode == REQUESTS.index("sit")
    assert caplog.text.count("day is another one than the robot's") == 1


def test_over_lcm_sliders_of_meshcat_begin_at_rest(trot, page, meshcat):
    acting = PolicyActing(A1, trot, page)
    world = replace(CALM, command=SliderCommand(attended=True))
    ends = Lcm(trot, acting, acting, scenario=world, meshcat=meshcat)
    ends.run(3)
    assert (ends.command.speed, ends.command.yaw_rate) == (0.0, 0.0)


class Pipe:
    """An end of Unitree's wire within one process."""

    def __init__(self, publisher):
        self.publisher, self.waiting, self.sent = publisher, [], []

    def take(self, wait=0.0):
        waiting, self.waiting = self.waiting, []
        return waiting

    def send(self, message):
        self.sent.append(message.copy().reshape(()))
        self.other.waiting.append(Heard(message, self.publisher))


class Unitree:
    """Both ends over Unitree's messages, in one process, and a shadow beside them."""

    def __init__(self, acting, shadow, supervision):
        robots, self.controllers = Pipe(1), Pipe(2)
        robots.other, self.controllers.other = self.controllers, robots
        self.robot, self.shadow = UnitreeRobotEnd(CALM, robots, seed=3), Shadow(shadow)
        self.controller = UnitreeControllerEnd(
            acting,
            self.controllers,
            operator=RemoteOperator(
                acting.limits,
                Sticks(),
                8.0,
                n_gaits=len(acting.gaits),
                gate=RequestGate(acting.day) if acting.has_day else None,
            ),
            supervision=supervision,
            clock=lambda: self.robot.simulator.get_context().get_time(),
        )
        take = self.controller._answering.take

        def both(sensors, command):
            take(sensors, command)
            self.shadow.take(sensors, command)

        self.controller._answering.take = both

    def press(self, buttons, forward=0.0):
        self.robot.remote = write_remote(Remote(buttons, 0.0, forward, 0.0, 0.0))

    def request(self, name):
        """Presses a button for a moment; the stick is held while the robot is to walk."""
        forward = 0.4 if name == "walk" else 0.0
        self.press(REQUESTED_BY[name], forward)
        self.run(1)
        self.press(Button(0), forward)

    def run(self, n_steps):
        """Returns stages, modes, and motor commands."""
        stages, modes, begun = [], [], len(self.controllers.sent)
        for _ in range(n_steps):
            self.robot.send()
            for part in range(self.robot.n_parts):
                self.controller.listen(0.0)
                if self.controller.answer():
                    context = self.controller._answering.simulator.get_context()
                    own = self.controller.diagram.GetOutputPort("targets").Eval(context)
                    same(own, self.shadow.answer)
                self.robot.advance(part)
            stages.append(self.controller.course.stage)
            if self.controller.diagram.HasOutputPort("mode") or self.shadow.diagram.HasOutputPort(
                "mode"
            ):
                modes.append(self.shadow.mode)
        sent = [unpack_low_cmd(A1, message) for message in self.controllers.sent[begun:]]
        return stages, modes, sent


AT_ONCE = Supervision(self_test=False)


def test_a_compiled_controller_answers_over_unitrees_wire_as_python_does(trot, page, compiled):
    supervision = Supervision(rising=0.5, self_test=False)
    ends = Unitree(compiled["always"], PolicyActing(A1, trot, page), supervision)
    ends.press(Button(0), forward=0.6)
    stages, _, _ = ends.run(80)
    assert order(stages) == [Stage.RISING, Stage.FOLLOWING]
    assert ends.shadow.n_answers == 80
    assert ends.robot.output("state")[4] > 0.1


def test_a_robot_lives_through_its_day_by_its_remote_over_unitrees_wire(trot, page, compiled):
    ends = Unitree(compiled["day"], PolicyActing(A1, trot, page, DAY), AT_ONCE)
    modes, heights = [], []
    for n_steps, name in PARTS:
        ends.request(name)
        stages, own, sent = ends.run(n_steps - 1)
        assert set(stages) == {Stage.FOLLOWING}
        modes += own
        heights.append(ends.robot.output("state")[6])
        if own[0] == own[-1] == "rest":
            # What the day damps is on the wire what supervision's damping is.
            for command in sent[10:]:
                assert command.is_damping
                np.testing.assert_array_equal(command.kd, AT_ONCE.damping)
            assert ends.robot.phase is Drive.DAMPED
        if own[-1] in ("stand", "walk"):
            np.testing.assert_array_equal(sent[-1].kp, A1.stiffness)
            assert ends.robot.phase is Drive.DRIVEN
    assert order(modes) == ORDER
    assert heights[0] < LYING and heights[-1] < LYING
    assert min(heights[1:4]) > 0.2
    assert ends.robot.output("state")[4] > 0.2


@pytest.fixture(scope="module")
def both(switched_pages, tmp_path_factory):
    """What was exported of two gaits."""
    if not has_compiler():
        pytest.skip("needs a C compiler, cc")
    folder = tmp_path_factory.mktemp("both")
    switch = switched_pages.switch
    own = Deployment(switch, alone(switched_pages), "both", "pages", None)
    CFile(own, "double").write_all(folder)
    contract, loaded, robot = load_contract(folder / CONTRACT, tmp_path_factory.mktemp("so"))
    return CompiledActing(robot, loaded, contract)


def running(controller):
    """The number of the gait that a compiled controller of several runs."""
    diagram, simulator = controller.diagram, controller._answering.simulator
    acting = diagram.GetSubsystemByName("compiled_controller")
    context = acting.GetMyContextFromRoot(simulator.get_context())
    memory = context.get_discrete_state(0).value()
    return acting._controller.gait_of(memory)


def test_shoulder_buttons_change_the_gait_over_unitrees_wire(both):
    supervision = Supervision(rising=0.5, self_test=False)
    ends = Unitree(both, both, supervision)
    ends.shadow.take = lambda *_: None
    found = []
    # What is held from before the robot follows on does not count until it is pressed again.
    pressed = ((Button.R1, 35), (Button(0), 2), (Button.R1, 2), (Button(0), 60))
    for buttons, n_steps in pressed:
        ends.press(buttons, forward=0.3)
        for _ in range(n_steps):
            ends.robot.send()
            for part in range(ends.robot.n_parts):
                ends.controller.listen(0.0)
                ends.controller.answer()
                ends.robot.advance(part)
        found.append(running(ends.controller))
    assert (found[0], found[-1]) == (0, 1)
    assert ends.controller.course.stage is Stage.FOLLOWING


@pytest.mark.parametrize("gait", [0, 1])
def test_over_lcm_the_gait_that_was_named_runs(both, gait):
    lcm, channels = DrakeLcm("memq://"), Channels("GAITS_")
    first = load_gait(both.gaits[0])
    robot = RobotEnd(first, CALM, lcm, channels, watchdog=Watchdog(), session=5)
    controller = ControllerEnd(both, lcm, channels, gait=gait)
    for _ in range(40):
        robot.send()
        for part in range(robot.n_parts):
            if part == 0:
                lcm.HandleSubscriptions(0)
                assert controller.answer()
            robot.advance(part)
    assert running(controller) == gait
    assert robot.phase is Phase.FOLLOWING


@pytest.mark.slow
@pytest.mark.parametrize("of", ["page", "compiled"])
def test_start_while_the_robot_rises_is_dropped_and_does_not_act_later(
    of, trot, page, compiled, caplog
):
    python = PolicyActing(A1, trot, page, DAY)
    ends = Unitree(python if of == "page" else compiled["day"], python, AT_ONCE)
    ends.run(3)
    ends.request("stand")
    assert ends.run(90)[1][-1] == "rise"
    ends.request("walk")
    _, modes, _ = ends.run(120)
    assert order(modes) == ["rise", "stand"]
    assert "the mode 'rise', which does not take it" in caplog.text
    assert len(caplog.records) == 1
    ends.request("walk")
    assert ends.run(5)[1][-1] == "walk"


def test_two_buttons_damp_a_day_for_good(trot, page):
    acting = PolicyActing(A1, trot, page, DAY)
    ends = Unitree(acting, acting, AT_ONCE)
    ends.request("stand")
    ends.run(40)
    ends.press(Button.L2 | Button.B)
    ends.run(1)
    ends.robot.remote = UNTOUCHED
    ends.request("stand")
    stages, _, sent = ends.run(30)
    assert set(stages) == {Stage.DAMPED}
    assert ends.controller.course.fault is Fault.ASKED
    assert all(command.is_damping for command in sent)


def test_a_day_begins_lying_after_the_self_test(trot, page, caplog):
    acting = PolicyActing(A1, trot, page, DAY)
    ends = Unitree(acting, acting, Supervision(rising=1.0))
    ends.request("walk")
    stages, modes, sent = ends.run(260)
    assert "dropped: the robot follows no controller" in caplog.text
    assert len(caplog.records) == 1
    expected = [Stage.RISING, Stage.TESTING, Stage.LOWERING, Stage.FOLLOWING]
    assert order(stages) == expected
    assert modes[-1] == "rest"
    assert sent[-1].is_damping
    assert ends.robot.output("state")[6] < LYING


def test_a_compiled_controller_without_limits_is_refused(compiled):
    wide = compiled["always"].compiled
    law = wide.joint_law
    try:
        wide.joint_law = type(law)(law.gains, limited=False)
        with pytest.raises(InputError, match="beyond the joints' ranges"):
            MakeAnsweringController(compiled["always"])
    finally:
        wide.joint_law = law
