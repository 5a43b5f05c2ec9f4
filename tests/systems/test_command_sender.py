"""What is sent of a command."""

from glassgait.systems.command_sender import CommandSender


def test_sends_the_command_of_an_instant(fix_inputs):
    system = CommandSender(session=3)
    context = fix_inputs(system, command=[0.5, -0.2], commanded_dwell=8)
    context.SetTime(0.04)
    clone = context.Clone()
    fix_inputs(system, clone, commanded_dwell=9)
    message = system.get_message_output_port().Eval(context)
    assert (message.session, message.sequence, message.utime) == (3, 2, 40_000)
    assert (message.speed, message.yaw_rate, message.dwell) == (0.5, -0.2, 8.0)
    assert system.get_message_output_port().Eval(clone).dwell == 9.0
    assert message.requested_mode == 0
    fix_inputs(system, clone, requested_mode=2)
    assert system.get_message_output_port().Eval(clone).requested_mode == 2
