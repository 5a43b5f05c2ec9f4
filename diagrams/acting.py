"""Who acts in the loop: policies, and what chooses between them."""

from pydrake.systems.framework import DiagramBuilder, InputPortIndex, OutputPort
from pydrake.systems.primitives import PortSwitch

from glassgait.models.policies.assured import ActingPolicy, AssuredPolicy
from glassgait.models.robots import quadruped
from glassgait.systems.alternation import AlternationSchedule
from glassgait.systems.assurance_monitor import AssuranceMonitor
from glassgait.systems.policy import PolicySystem


def AddActingPolicies(  # noqa: N802
    builder: DiagramBuilder, policy: ActingPolicy, observation: OutputPort
) -> dict[str, OutputPort]:
    """Adds expert and student, a switch between them, and what selects its input.

    Args:
        builder: Where they are added.
        policy: Who acts.
        observation: What they observe.

    Returns:
        `actions` (12), of who acts; under assurance also `expert_acts` (1) and `overrun` (1).
    """
    switch = builder.AddNamedSystem("alternation", PortSwitch(quadruped.N_JOINTS))
    ports: dict[str, InputPortIndex] = {}
    for name, one in {"expert": policy.acting_expert, "student": policy.acting_student}.items():
        # One that never acts has no port, and is never chosen.
        if one is not None:
            system = builder.AddNamedSystem(name, PolicySystem(one))
            builder.Connect(observation, system.get_observation_input_port())
            port = switch.DeclareInputPort(name)
            builder.Connect(system.get_action_output_port(), port)
            ports[name] = port.get_index()
    only = next(iter(ports.values()))
    expert, student = ports.get("expert", only), ports.get("student", only)
    told = {"actions": switch.get_output_port()}
    if isinstance(policy, AssuredPolicy):
        monitor = AssuranceMonitor(policy.region, policy.hysteresis, expert, student)
        builder.AddNamedSystem("assurance_monitor", monitor)
        builder.Connect(observation, monitor.get_observation_input_port())
        selector = monitor.get_port_selector_output_port()
        told["expert_acts"] = monitor.get_expert_acts_output_port()
        told["overrun"] = monitor.get_overrun_output_port()
    else:
        schedule = AlternationSchedule(policy.period, expert_port=expert, student_port=student)
        builder.AddNamedSystem("alternation_schedule", schedule)
        selector = schedule.get_port_selector_output_port()
    builder.Connect(selector, switch.get_port_selector_input_port())
    return told
