{{ signature }}
{
    /* What the formulas speak of, in the robot's units. */
{% if 'cmd' in quantities %}
    const struct {
        {{ real }} v;   /* commanded forward speed, m/s */
        {{ real }} yaw; /* commanded yaw rate, to the left, rad/s */
        {{ real }} t;   /* commanded control steps in a state */
    } cmd = {observation[COMMAND_X], observation[COMMAND_YAW],
        observation[{{ OWN }}COMMAND_RM_ITERATIONS] / {{ 0.1 | number }}};
{% endif %}
{% if 'q' in quantities %}
    const Joints q = joints(&observation[JOINT_POSITION], {{ 1.0 | number }}, {{ 1.0 | number }}); /* angle, rad */
{% endif %}
{% if 'dq' in quantities %}
    const Joints dq = joints(&observation[JOINT_VELOCITY], {{ 0.05 | number }}, {{ 0.0 | number }}); /* velocity, rad/s */
{% endif %}
{% if 'a' in quantities %}
    const Joints a = joints(&observation[PREVIOUS_ACTION], {{ 4.0 | number }}, {{ 1.0 | number }}); /* last target, rad */
{% endif %}
{% for name in quantities if name[0] == 's' and name[1:].isdigit() %}
    const {{ real }} {{ name }} = observation[RM_STATE + {{ name[1:] }}]; /* 1 in that state, else 0 */
{% endfor %}
{% if 't' in quantities %}
    const {{ real }} t = observation[{{ OWN }}RM_ITERATIONS] / {{ 0.1 | number }}; /* control steps {{ 'in the state' if own else 'since the state began' }} */
{% endif %}
{% if 'v' in quantities %}
    const struct {
        {{ real }} x, y, z; /* estimated velocity of the trunk, forward, left and up, m/s */
    } v = {observation[{{ OWN }}BASE_VELOCITY] / {{ 2.0 | number }},{{ '\n        ' if own else ' ' }}observation[{{ OWN }}BASE_VELOCITY + 1] / {{ 2.0 | number }},
        observation[{{ OWN }}BASE_VELOCITY + 2] / {{ 2.0 | number }}};
{% endif %}
{% if 'g' in quantities %}
    const struct {
        {{ real }} x, y, z; /* direction of gravity, forward, left and up */
    } g = {observation[GRAVITY_DIRECTION], observation[GRAVITY_DIRECTION + 1],
        observation[GRAVITY_DIRECTION + 2]};
{% endif %}
{% if 'w' in quantities %}
    const struct {
        {{ real }} x, y, z; /* angular velocity of the trunk about these axes, rad/s */
    } w = {observation[ANGULAR_VELOCITY] / {{ 0.25 | number }}, observation[ANGULAR_VELOCITY + 1] / {{ 0.25 | number }},
        observation[ANGULAR_VELOCITY + 2] / {{ 0.25 | number }}};
{% endif %}
{% if 'h' in quantities %}
    const struct {
        {{ real }} FL, FR, RL, RR; /* estimated height of a foot, m */
    } h = {observation[{{ OWN }}FOOT_HEIGHT],{{ '\n        ' if own else ' ' }}observation[{{ OWN }}FOOT_HEIGHT + 1],{{ '\n        ' if own else ' ' }}observation[{{ OWN }}FOOT_HEIGHT + 2],
        observation[{{ OWN }}FOOT_HEIGHT + 3]};
{% endif %}
{% if groups %}

    /* What the policy defines by these. */
{% endif %}
{% for group in groups %}
{% if group.members %}
    const struct {
        {{ real }} {{ group.members | join(', ') | wordwrap(84, wrapstring='\n            ') }};
    } {{ group.name }} = {
{% endif %}
{% for line in group.lines %}
{{ line }}
{% endfor %}
{% if group.members %}
    };
{% endif %}
{% endfor %}
    {{ real }} target[12];

{% if statewise %}
    switch (state) {
{% for constant, formulas in states %}
    case {{ constant }}:{{ ' default:' if loop.last }}{{ ' /* %s in the mirror */' % mirror[loop.index0] if mirror and mirror[loop.index0] != constant }}
{% for lines in formulas %}
{% for line in lines %}
{{ line }}{{ ';' if loop.last }}
{% endfor %}
{% endfor %}
        break;
{% endfor %}
    }
{% else %}
{% for lines in states[0][1] %}
{% for line in lines %}
{{ line }}{{ ';' if loop.last }}
{% endfor %}
{% endfor %}
{% endif %}

    for (int joint = 0; joint < 12; joint++)
        action[joint] = (target[joint] - STANCE[joint]) / ACTION_SCALE;
}
