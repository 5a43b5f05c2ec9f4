{% for power in powers %}
static {{ real }} {{ power }}({{ real }} x)
{
    return {{ 'x * x' if power == 'square' else 'x * x * x' }};
}

{% endfor %}
{% if 'q' in quantities or 'dq' in quantities or 'a' in quantities %}
typedef struct {
    {{ real }} FL_hip, FL_thigh, FL_calf, FR_hip, FR_thigh, FR_calf;
    {{ real }} RL_hip, RL_thigh, RL_calf, RR_hip, RR_thigh, RR_calf;
} Joints;

/* Returns what is observed of the joints in its own unit. What counts from the default stance has
 * all of it added, from_stance 1, and the rest nothing, from_stance 0. */
static Joints joints(const {{ real }} observed[12], {{ real }} scale, {{ real }} from_stance)
{
    const Joints own = {
{% for joint in joints %}
        .{{ joint }} = observed[{{ joint | upper }}] / scale + from_stance * STANCE[{{ joint | upper }}],
{% endfor %}
    };
    return own;
}

{% endif %}
static void act({{ 'int state, ' if statewise }}const {{ real }} observation[N_OBSERVATIONS], {{ real }} action[12])
{
    /* What the formulas speak of, in the robot's units. */
{% if 'cmd' in quantities %}
    const struct {
        {{ real }} v;   /* commanded forward speed, m/s */
        {{ real }} yaw; /* commanded yaw rate, to the left, rad/s */
        {{ real }} t;   /* commanded control steps in a state */
    } cmd = {observation[COMMAND_X], observation[COMMAND_YAW],
        observation[COMMAND_RM_ITERATIONS] / {{ 0.1 | number }}};
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
{% for own in quantities if own[0] == 's' and own[1:].isdigit() %}
    const {{ real }} {{ own }} = observation[RM_STATE + {{ own[1:] }}]; /* 1 in that state, else 0 */
{% endfor %}
{% if 't' in quantities %}
    const {{ real }} t = observation[RM_ITERATIONS] / {{ 0.1 | number }}; /* control steps since the state began */
{% endif %}
{% if 'v' in quantities %}
    const struct {
        {{ real }} x, y, z; /* estimated velocity of the trunk, forward, left and up, m/s */
    } v = {observation[BASE_VELOCITY] / {{ 2.0 | number }}, observation[BASE_VELOCITY + 1] / {{ 2.0 | number }},
        observation[BASE_VELOCITY + 2] / {{ 2.0 | number }}};
{% endif %}
{% if 'h' in quantities %}
    const struct {
        {{ real }} FL, FR, RL, RR; /* estimated height of a foot, m */
    } h = {observation[FOOT_HEIGHT], observation[FOOT_HEIGHT + 1], observation[FOOT_HEIGHT + 2],
        observation[FOOT_HEIGHT + 3]};
{% endif %}
{% if groups %}

    /* What the policy defines by these. */
{% endif %}
{% for group in groups %}
{% if group.members %}
    const struct {
        {{ real }} {{ group.members | join(', ') }};
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
