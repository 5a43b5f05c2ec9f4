{% for power in powers %}
static {{ real }} {{ power }}({{ real }} x)
{
    return {{ 'x * x' if power == 'square' else 'x * x * x' }};
}

{% endfor %}
{% if needs_axes %}
typedef struct { {{ real }} x, y, z; } Axes;

{% endif %}
{% if needs_feet %}
typedef struct { {{ real }} {{ legs | join(', ') }}; } Feet;

{% endif %}
{% if needs_joints %}
typedef struct {
    {{ real }} FL_hip, FL_thigh, FL_calf, FR_hip, FR_thigh, FR_calf;
    {{ real }} RL_hip, RL_thigh, RL_calf, RR_hip, RR_thigh, RR_calf;
} Joints;

/* Converts observations of the joints to the robot's units. If from_stance is 1, they are relative
 * to the default stance; if it is 0, they are not. */
static Joints joints(const {{ real }} observed[12], {{ real }} scale, {{ real }} from_stance)
{
    const Joints quantities = {
{% for joint in joints %}
        .{{ joint }} = observed[{{ joint | upper }}] / scale + from_stance * STANCE[{{ joint | upper }}],
{% endfor %}
    };
    return quantities;
}

{% endif %}
{% if limits_joints %}
/* Clips quantities of joints to ranges of hips, thighs and calves. Right hips, whose angles have
 * the opposite sign, have the mirror image of the range. */
static Joints nearest_joints(Joints value, {{ real }} hip_low, {{ real }} hip_high,
    {{ real }} thigh_low, {{ real }} thigh_high, {{ real }} calf_low, {{ real }} calf_high)
{
    const Joints clipped = {
{% for joint in joints %}
{% if joint.endswith('R_hip') %}
        .{{ joint }} = nearest(value.{{ joint }}, -hip_high, -hip_low),
{% else %}
        .{{ joint }} = nearest(value.{{ joint }}, {{ joint[3:] }}_low, {{ joint[3:] }}_high),
{% endif %}
{% endfor %}
    };
    return clipped;
}

{% endif %}
{{ signature }}
{
    /* Quantities of the formulas, in the robot's units. */
{% if 'cmd' in quantities %}
    {{ 'struct' if 'cmd' in limited else 'const struct' }} {
        {{ real }} v;   /* commanded forward speed, m/s */
        {{ real }} yaw; /* commanded yaw rate, to the left, rad/s */
        {{ real }} t;   /* commanded control steps in a state */
    } cmd = {observation[COMMAND_X], observation[COMMAND_YAW],
        observation[COMMAND_RM_ITERATIONS] / {{ 0.1 | number }}};
{% endif %}
{% if 'q' in quantities %}
    {{ 'Joints' if 'q' in limited else 'const Joints' }} q = joints(&observation[JOINT_POSITION], {{ 1.0 | number }}, {{ 1.0 | number }}); /* angle, rad */
{% endif %}
{% if 'dq' in quantities %}
    {{ 'Joints' if 'dq' in limited else 'const Joints' }} dq = joints(&observation[JOINT_VELOCITY], {{ 0.05 | number }}, {{ 0.0 | number }}); /* velocity, rad/s */
{% endif %}
{% if 'a' in quantities %}
    const Joints a = joints(&observation[PREVIOUS_ACTION], {{ 4.0 | number }}, {{ 1.0 | number }}); /* last target, rad */
{% endif %}
{% for name in quantities if name[0] == 's' and name[1:].isdigit() %}
    const {{ real }} {{ name }} = observation[RM_STATE + {{ name[1:] }}]; /* 1 in that state, else 0 */
{% endfor %}
{% if 't' in quantities %}
    const {{ real }} t = observation[RM_ITERATIONS] / {{ 0.1 | number }}; /* control steps since the state began */
{% endif %}
{% if 'v' in quantities %}
    /* Estimated velocity of the trunk, forward, left and up, m/s. */
    {{ 'Axes' if 'v' in limited else 'const Axes' }} v = {observation[BASE_VELOCITY] / {{ 2.0 | number }}, observation[BASE_VELOCITY + 1] / {{ 2.0 | number }},
        observation[BASE_VELOCITY + 2] / {{ 2.0 | number }}};
{% endif %}
{% if 'g' in quantities %}
    /* Direction of gravity, forward, left and up. */
    {{ 'Axes' if 'g' in limited else 'const Axes' }} g = {observation[GRAVITY_DIRECTION], observation[GRAVITY_DIRECTION + 1],
        observation[GRAVITY_DIRECTION + 2]};
{% endif %}
{% if 'w' in quantities %}
    /* Angular velocity of the trunk about these axes, rad/s. */
    {{ 'Axes' if 'w' in limited else 'const Axes' }} w = {observation[ANGULAR_VELOCITY] / {{ 0.25 | number }}, observation[ANGULAR_VELOCITY + 1] / {{ 0.25 | number }},
        observation[ANGULAR_VELOCITY + 2] / {{ 0.25 | number }}};
{% endif %}
{% if 'h' in quantities %}
    /* Estimated height of a foot, m. */
    {{ 'Feet' if 'h' in limited else 'const Feet' }} h = {observation[FOOT_HEIGHT], observation[FOOT_HEIGHT + 1],
        observation[FOOT_HEIGHT + 2], observation[FOOT_HEIGHT + 3]};
{% endif %}
{% if ranges %}

    /* Readings: quantities are clipped to their ranges. */
{% for line in ranges %}
    {{ line }}
{% endfor %}
{% endif %}
{% if groups %}

    /* Definitions: named formulas of these. */
{% endif %}
{% for group in groups %}
{% if group.type %}
    const {{ group.type }} {{ group.name }} = {
{% elif group.members %}
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
{% if not mirror %}
    {{ real }} target[12];
{% endif %}

{% if per_state %}
    switch (state) {
{% for constant, formulas in states %}
    case {{ constant }}:{{ ' default:' if loop.last and not mirror }}
{% for lines in formulas %}
{% for line in lines %}
{{ line }}{{ ';' if loop.last }}
{% endfor %}
{% endfor %}
        break;
{% endfor %}
{% if mirror %}
    default:
        break;
{% endif %}
    }
{% else %}
{% for lines in states[0][1] %}
{% for line in lines %}
{{ line }}{{ ';' if loop.last }}
{% endfor %}
{% endfor %}
{% endif %}
{% if not mirror %}

{% endif %}
{% if mirror %}
}

/* The mirror image of an observation or target is this one times this sign. */
{% for array in mirror.arrays %}
{{ array.definition }}
{% endfor %}

/* Evaluates the formulas, and those of the mirrored robot for joints without a formula. */
{{ outer_signature }}
{
{% if per_state %}
    static const int mirrored[] = { {{- mirror.states | join(', ') -}} };
    static const unsigned has_formula[] = { {{- mirror.written | join(', ') -}} }; /* a bit per joint */
    const unsigned written = has_formula[state];
{% else %}
    const unsigned written = {{ mirror.written[0] }}; /* joints with a formula, a bit per joint */
{% endif %}
    {{ real }} target[12] = {0}, image[12] = {0}, reflected[N_OBSERVATIONS];

    if (written != 0)
        formulas({{ 'state, ' if per_state }}observation, target);
    if (written != 0xfff) {
        for (int i = 0; i < N_OBSERVATIONS; i++)
            reflected[i] = OBSERVATION_SIGN[i] * observation[OBSERVATION_IMAGE[i]];
        formulas({{ 'mirrored[state], ' if per_state }}reflected, image);
    }
    for (int joint = 0; joint < 12; joint++)
        if (!(written >> joint & 1))
            target[joint] = TARGET_SIGN[joint] * image[TARGET_IMAGE[joint]];
{% endif %}
    for (int joint = 0; joint < 12; joint++)
        action[joint] = (target[joint] - STANCE[joint]) / ACTION_SCALE;
}
